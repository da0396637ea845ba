"""train.toml: what it may say and what is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.errors import FormatError
from tdcr_planner.learning.loads import tip_motion
from tdcr_planner.learning.settings import (
    DEFAULT_CORRECTIONS,
    TIP_DEFLECTION,
    DomainSettings,
    TrainSettings,
    load_train_settings,
)
from tdcr_planner.robot import load_robot


def write(tmp_path, text):
    path = tmp_path / "train.toml"
    path.write_text(text)
    return path


def test_without_a_file_the_defaults_stand():
    assert load_train_settings(None) == TrainSettings()


def test_values_are_read_and_paths_start_at_the_file(tmp_path):
    path = write(tmp_path, '[loss]\nmeasured = 2.0\n[measured]\nfile = "bench.csv"\n[optimiser]\nepochs = 3\n')
    settings = load_train_settings(path)
    assert settings.optimiser.epochs == 3
    assert settings.resolve(settings.measured.file) == tmp_path / "bench.csv"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[optimiser]\nepoch = 3\n", ["optimiser.epoch", "unknown key", "did you mean 'epochs'"]),
        ("[domain]\ntension_share = 0.0\n", ["domain.tension_share", "greater than 0"]),
        ("[domain]\ngravity_m_s2 = -1.0\n", ["domain.gravity_m_s2"]),
        ("[domain]\ntip_force_n = nan\n", ["domain.tip_force_n"]),
        ("[domain]\ntip_force_n = 0.1\ntip_deflection = 0.1\n", ["domain", "tip_force_n or tip_deflection"]),
        ("[dataset]\ncases = 0\n", ["dataset.cases"]),
        ("[loss]\nphysics = 0.0\nreference = 0.0\n", ["loss", "nothing would be learned"]),
        ("[loss]\nmeasured = 1.0\n", ["[measured]"]),
        ('[measured]\nfile = "a.csv"\n', ["loss.measured"]),
        ("[bound]\ncases = 100\n", ["bound", "at least 4604"]),
        ('network = "deep"\n', ["network", "shooting"]),
        ('format = "tdcr-train/2"\n', ["format"]),
        ("[paper.weights]\ntip_moment = -1.0\n", ["paper.weights.tip_moment", "greater than or equal to 0"]),
        ("[paper]\nplateau_from_epoch = 2000\n", ["paper", "at most cycle_epochs = 1500"]),
        ("seed = [", ["TOML"]),
    ],
)
def test_faults_are_named(tmp_path, text, words):
    with pytest.raises(FormatError) as caught:
        load_train_settings(write(tmp_path, text))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("name", ["paper", "inspection", "two_segment"])
def test_the_default_tip_force_moves_the_tip_by_a_tenth_of_the_length(root, name):
    robot = load_robot(root / f"models/robots/{name}.toml")
    domain = DomainSettings().for_robot(robot)
    assert domain.gravity_m_s2 == 10.0
    # Two digits of the force, and the difference between a large and a small deflection.
    assert tip_motion(robot, domain).tip_force_m == pytest.approx(TIP_DEFLECTION * robot.length, rel=0.06)


@given(stiffness=st.floats(1e-3, 1e3), deflection=st.floats(0.01, 0.3))
def test_the_default_tip_force_follows_the_stiffness(two_segment_robot, stiffness, deflection):
    domain = DomainSettings(tip_deflection=deflection)
    soft, scaled = (
        domain.tip_force(robot) for robot in (two_segment_robot, two_segment_robot.scaled(stiffness=stiffness))
    )
    assert scaled == pytest.approx(stiffness * soft, rel=0.1)


def test_what_is_stated_stands_and_what_is_not_follows_from_the_robot(two_segment_robot):
    stated = TrainSettings.model_validate({"domain": {"tip_force_n": 0.0}, "shooting": {"corrections": 0}})
    assert stated.for_robot(two_segment_robot) == stated
    filled = TrainSettings().for_robot(two_segment_robot)
    assert filled.for_robot(two_segment_robot) == filled
    assert filled.domain.tip_force_n == DomainSettings().tip_force(two_segment_robot)


@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_a_segment_more_is_a_newton_step_more(two_segment_robot, segments):
    robot = two_segment_robot.model_copy(update={"segments": (two_segment_robot.segments[0],) * segments})
    assert TrainSettings().for_robot(robot).shooting.corrections == min(segments, DEFAULT_CORRECTIONS)
