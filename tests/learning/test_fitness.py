"""The verdict on a model: its bound against its robot's disks, and what is to blame for a large one."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.learning import fitness
from tdcr_planner.learning.fitness import FIT_IN_RADII, judge_fitness
from tdcr_planner.shape.learned import load_shape_model


@pytest.fixture
def model(small_model):
    return load_shape_model(small_model.path)


@pytest.mark.parametrize(("factor", "fit"), [(0.99, True), (1.01, False)])
def test_the_bound_is_measured_in_disk_radii(model, monkeypatch, factor, fit):
    monkeypatch.setattr(fitness, "_BLAME_CASES", 200)
    model.error_bound = np.zeros(model.robot.disk_count)
    model.error_bound[4] = factor * FIT_IN_RADII * model.robot.disk_radii[4]
    found = judge_fitness(model)
    assert found.fit is fit
    assert found.disk == 4
    text = found.describe()
    assert text.startswith("fit for planning" if fit else "NOT fit for planning")
    assert "at disk 4" in text


def test_an_unfit_model_says_which_part_of_the_domain_is_to_blame(model, monkeypatch):
    monkeypatch.setattr(fitness, "_BLAME_CASES", 400)
    model.error_bound = np.full(model.robot.disk_count, 0.02)
    found = judge_fitness(model)
    assert {name for name, _ in found.blame} == {"tensions", "gravity", "tip force"}
    bounds = [bound for _, bound in found.blame]
    assert bounds == sorted(bounds)
    # Errors of this model grow with its loads: without half of the worst, less than the whole bound is left.
    assert bounds[0] < found.bound_m
    assert f"most to blame: {found.blame[0][0]}" in found.describe()
