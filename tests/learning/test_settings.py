"""train.toml: what it may say and what is refused."""

from __future__ import annotations

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.learning.settings import TrainSettings, load_train_settings


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
