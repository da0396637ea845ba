"""Training: it learns, from physics alone too; it is seeded; it survives being stopped."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.learning import train as train_module
from tdcr_planner.learning.checkpoint import checkpoint_path
from tdcr_planner.learning.dataset import draw_cases, solve_cases
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.learning.train import train_model, train_shooting_network
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.shape.rod_kernel import rod_constants
from tdcr_planner.shape.shooting import ShootingFunction
from tdcr_planner.shape.shooting_network import ShootingNetwork, learned_weights


class StoppedError(Exception):
    """Stands for a kill in the middle of a training."""


def stop_after(epochs):
    def progress(stage, done, total, remark):
        if stage == "training" and done >= epochs:
            raise StoppedError

    return progress


def median_error(robot, network):
    solved = solve_cases(
        robot, draw_cases(robot, DomainSettings().for_robot(robot), "uniform", 400, np.random.default_rng(33))
    )
    function = ShootingFunction(rod_constants(robot), learned_weights(network))
    positions, _, _ = function(solved.cases.tensions, solved.cases.gravity, solved.cases.tip_force)
    return 1e3 * float(np.median(np.linalg.norm(positions - solved.positions, axis=2)[:, 1:]))


def same_weights(a, b):
    return all(torch.equal(x, y) for x, y in zip(a.state_dict().values(), b.state_dict().values(), strict=True))


def test_a_small_model_is_accurate(small_model):
    uniform = small_model.card.accuracy[0]
    assert uniform.sample == "uniform"
    assert uniform.overall["position_median_mm"] < 0.3
    assert small_model.card.error_bound.alpha == 0.01
    assert not checkpoint_path(small_model.path).exists()


def test_physics_alone_trains(small_robot, small_settings, tmp_path):
    changes = {"loss": {"reference": 0.0, "physics": 1.0}, "optimiser": {"epochs": 6, "batch_size": 128}}
    untrained = ShootingNetwork(small_robot, (24, 24), 1, 9.81, 0.05)
    trained = train_shooting_network(small_robot, small_settings(**changes), tmp_path / "model.pt")
    before, after = median_error(small_robot, untrained), median_error(small_robot, trained)
    # Untrained, the network is the arc with one Newton step of the unloaded rod.
    assert after < before / 5.0, (before, after)


def test_a_stopped_training_ends_as_if_never_stopped(small_robot, small_settings, tmp_path):
    settings = small_settings(
        dataset={"cases": 600, "validation_cases": 50, "threads": 1}, optimiser={"epochs": 5, "batch_size": 100}
    )
    whole = train_shooting_network(small_robot, settings, tmp_path / "whole.pt")
    with pytest.raises(StoppedError):
        train_shooting_network(small_robot, settings, tmp_path / "stopped.pt", progress=stop_after(2))
    resumed = train_shooting_network(small_robot, settings, tmp_path / "stopped.pt")
    assert same_weights(whole, resumed)
    again = train_shooting_network(small_robot, settings, tmp_path / "again.pt")
    assert same_weights(whole, again)
    other = train_shooting_network(small_robot, settings.model_copy(update={"seed": 2}), tmp_path / "other.pt")
    assert not same_weights(whole, other)


def test_checkpoints_of_others_are_refused(small_robot, paper_robot, small_settings, tmp_path):
    settings = small_settings(
        dataset={"cases": 200, "validation_cases": 20, "threads": 1}, optimiser={"epochs": 3, "batch_size": 100}
    )
    out = tmp_path / "model.pt"
    with pytest.raises(StoppedError):
        train_shooting_network(small_robot, settings, out, progress=stop_after(1))
    with pytest.raises(FormatError, match=r"robot differs.*delete it"):
        train_shooting_network(paper_robot, settings, out)
    with pytest.raises(FormatError, match="settings differs"):
        train_shooting_network(small_robot, settings.model_copy(update={"seed": 5}), out)
    whole = checkpoint_path(out).read_bytes()
    checkpoint_path(out).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match="broken checkpoint"):
        train_shooting_network(small_robot, settings, out)
    checkpoint_path(out).write_bytes(b"")
    with pytest.raises(FormatError, match="broken checkpoint"):
        train_shooting_network(small_robot, settings, out)


def test_a_full_disk_leaves_the_good_model(small_model, small_robot, small_settings, tmp_path, monkeypatch):
    out = tmp_path / "model.pt"
    good = small_model.path.read_bytes()
    out.write_bytes(good)

    def full(self, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    settings = small_settings(
        dataset={"cases": 200, "validation_cases": 20, "threads": 1}, optimiser={"epochs": 1, "batch_size": 100}
    )
    with pytest.raises(FormatError, match="No space left"):
        train_model(small_robot, settings, out)
    assert out.read_bytes() == good
    assert [path.name for path in tmp_path.iterdir()] == ["model.pt"]


def test_a_kill_while_judging_leaves_the_good_model(small_model, small_robot, small_settings, tmp_path, monkeypatch):
    out = tmp_path / "model.pt"
    good = small_model.path.read_bytes()
    out.write_bytes(good)
    settings = small_settings(
        dataset={"cases": 200, "validation_cases": 20, "threads": 1}, optimiser={"epochs": 1, "batch_size": 100}
    )
    with monkeypatch.context() as patch:

        def interrupt(*args, **kwargs):
            raise KeyboardInterrupt

        patch.setattr(train_module, "judge_model", interrupt)
        with pytest.raises(KeyboardInterrupt):
            train_model(small_robot, settings, out)
    assert out.read_bytes() == good
    assert checkpoint_path(out).exists()
    train_model(small_robot, settings, out)
    assert load_shape_model(out).card.training["optimiser"]["epochs"] == 1


def test_an_unwritable_place_is_named(small_robot, small_settings, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    settings = small_settings(
        dataset={"cases": 200, "validation_cases": 20, "threads": 1}, optimiser={"epochs": 1, "batch_size": 100}
    )
    with pytest.raises(FormatError, match="cannot be written"):
        train_model(small_robot, settings, blocked / "model.pt")


def test_without_loads_the_network_is_exact_untrained(paper_robot):
    network = ShootingNetwork(paper_robot, (8,), 0, 9.81, 0.05)
    torch.nn.init.normal_(network.head.weight)
    tensions = np.array([[2.0, 1.0, 0.0]])
    zero = np.zeros((1, 3))
    positions, _, residual = ShootingFunction(rod_constants(paper_robot), learned_weights(network))(
        tensions, zero, zero
    )
    assert (residual == 0.0).all()
    assert positions[0, -1, 2] > 0.05


def test_robots_with_four_tendons_and_rest_curvature_train_too(small_robot, small_settings, tmp_path):
    content = small_robot.model_dump()
    segment = content["segments"][0] | {"tendon_angles_deg": (0.0, 90.0, 180.0, 270.0), "pretension_n": 0.2}
    backbone = content["backbone"] | {"rest_curvature_1_m": (1.0, 0.5, 0.3)}
    robot = RobotSpec.model_validate(content | {"segments": [segment], "backbone": backbone})
    card = train_model(robot, small_settings(), tmp_path / "model.pt")
    assert card.accuracy[0].overall["position_median_mm"] < 0.5


@pytest.mark.parametrize(
    ("domain", "words"),
    [
        ({"gravity_m_s2": 9810.0}, r"domain.gravity_m_s2: expected at most 100 m/s\^2 \(Earth: 9.81\), got 9810"),
        (
            {"tip_force_n": 50.0},
            "loads that robot 'small' can carry.*tip_force_n = 50 .*is the unit of the force newton",
        ),
    ],
)
def test_loads_in_the_wrong_unit_are_refused(small_robot, small_settings, tmp_path, domain, words):
    with pytest.raises(InputError, match=words):
        train_model(small_robot, small_settings(domain=domain), tmp_path / "model.pt")
    assert not list(tmp_path.iterdir())


def test_a_model_file_names_no_folder_of_the_machine_that_made_it(small_model):
    with zipfile.ZipFile(small_model.path) as archive:
        records = {name: archive.read(name) for name in archive.namelist()}
    assert any("/code/" in name for name in records)
    folder = str(Path(train_module.__file__).parents[2]).encode()
    assert [name for name, content in records.items() if folder in content] == []
