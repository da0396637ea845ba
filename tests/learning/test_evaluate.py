"""Evaluation of a model, and the two commands that train and evaluate."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.cli.evaluate import evaluate
from tdcr_planner.cli.train import train
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.learning.checkpoint import checkpoint_path
from tdcr_planner.learning.evaluate import evaluate_model
from tdcr_planner.robot import format_robot
from tdcr_planner.shape.learned import load_shape_model

CONFIG = """
format = "tdcr-train/1"
[domain]
gravity_m_s2 = 0.0
tip_force_n = 0.0
[dataset]
cases = 300
validation_cases = 20
threads = 1
[shooting]
hidden = [8]
[optimiser]
epochs = 2
batch_size = 100
[bound]
alpha = 0.01
cases = 500
"""


@pytest.fixture
def files(small_robot, tmp_path):
    robot, config = tmp_path / "robot.toml", tmp_path / "train.toml"
    robot.write_text(format_robot(small_robot))
    config.write_text(CONFIG)
    return robot, config, tmp_path / "model.pt"


def test_evaluation_measures_what_the_card_says(small_model):
    evaluation = evaluate_model(small_model, 400, seed=5)
    planner, uniform = evaluation.accuracy
    stated = small_model.card.accuracy[0].overall["position_median_mm"]
    assert 0.5 * stated < uniform.overall["position_median_mm"] < 2.0 * stated
    assert planner.sample == "planner"
    assert evaluation.constant_curvature.overall["position_median_mm"] > 20.0 * stated
    # alpha = 0.01; 400 cases: four expected, more than 16 have a probability below 1e-5.
    assert min(evaluation.coverage.values()) >= 1.0 - 16 / 400
    assert evaluation.rotation_violation < 1e-12
    # Axial strain of at most 10.5 N / 47 kN.
    assert evaluation.arc_length_violation < 3e-4
    assert [timing.batch for timing in evaluation.timings] == [1000, 10, 1]
    assert evaluation.by_load.shape == (4, 2)
    # Without loads there is nothing to learn: errors grow with them.
    assert evaluation.by_load[0, 0] < evaluation.by_load[-1, 0]


def test_the_same_seed_measures_the_same(small_model):
    first, second = (evaluate_model(small_model, 50, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.errors, second.errors)
    assert first.accuracy == second.accuracy


def test_too_few_samples_are_refused(small_model):
    with pytest.raises(InputError, match="samples"):
        evaluate_model(small_model, 3)


def test_train_command_writes_a_model(files, capsys):
    robot, config, out = files
    assert train(robot, out=out, config=config) == 0
    assert load_shape_model(out).card.training["dataset"]["cases"] == 300
    assert not checkpoint_path(out).exists()
    told = capsys.readouterr().out
    assert told.startswith("gravity up to 0 m/s^2: moves the unactuated tip by 0 mm")
    assert "error bound" in told
    assert told.splitlines()[-1].startswith("fit for planning: the error bound of")


def test_train_command_ends_with_1_for_a_model_that_is_not_fit(files, capsys, monkeypatch):
    monkeypatch.setattr("tdcr_planner.learning.fitness._BLAME_CASES", 200)
    robot, config, out = files
    config.write_text(CONFIG.replace("gravity_m_s2 = 0.0", "gravity_m_s2 = 20.0"))
    assert train(robot, out=out, config=config) == 1
    told = capsys.readouterr().out
    assert "NOT fit for planning" in told
    assert "most to blame: " in told
    assert load_shape_model(out).card.domain.gravity_m_s2 == 20.0


def test_train_command_says_what_an_interrupt_kept(files, capsys, monkeypatch):
    robot, config, out = files

    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("tdcr_planner.learning.train.judge_model", interrupt)
        assert train(robot, out=out, config=config) == 1
    assert "goes on from there" in capsys.readouterr().err
    assert not out.exists()
    assert train(robot, out=out, config=config) == 0
    assert not checkpoint_path(out).exists()


def test_train_command_names_a_bad_config(files):
    robot, config, out = files
    config.write_text("[dataset]\ncasse = 3\n")
    with pytest.raises(FormatError, match="did you mean 'cases'"):
        train(robot, out=out, config=config)


def test_evaluate_command_writes_tables_and_plots(small_model, tmp_path, capsys):
    out = tmp_path / "report"
    assert evaluate((small_model.path,), samples=60, out=out) == 0
    text = capsys.readouterr().out
    assert "constant curvature" in text
    assert {path.name for path in out.iterdir()} == {
        "evaluation.json",
        "evaluation.md",
        "error_by_disk.png",
        "error_by_load.png",
        "error_over_actuation.png",
    }
    content = json.loads((out / "evaluation.json").read_text(encoding="utf-8"))
    assert content["model_sha256"] == small_model.sha256
    assert len(content["accuracy"][0]["position_median_mm"]) == small_model.robot.disk_count


def test_evaluate_command_says_when_the_bound_does_not_hold(small_model, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "tdcr_planner.shape.learned.LearnedShape.__init__", with_a_tenth_of_the_bound(type(small_model).__init__)
    )
    assert evaluate((small_model.path,), samples=200) == 1


def with_a_tenth_of_the_bound(build):
    def init(self, *arguments, **options):
        build(self, *arguments, **options)
        self.error_bound = 0.1 * self.error_bound

    return init


def test_evaluate_command_sets_several_models_side_by_side(root, tmp_path, capsys):
    files = tuple(root / f"models/shape/paper/{name}.pt" for name in ("model", "published"))
    out = tmp_path / "out"
    assert evaluate(files, samples=60, out=out) == 0
    shown = capsys.readouterr().out
    assert "| model | robot | median mm |" in shown
    assert "Bound by state, planner cases" in shown
    assert {path.name for path in out.iterdir()} == {"evaluation.json", "evaluation.md", "error_against_time.png"}
    models = json.loads((out / "evaluation.json").read_text(encoding="utf-8"))["models"]
    assert [Path(model["model"]).name for model in models] == ["model.pt", "published.pt"]
    assert len(models[1]["margin"]["planner"]["deciles"]) == 10
    with pytest.raises(InputError, match="a model file or more"):
        evaluate(())
