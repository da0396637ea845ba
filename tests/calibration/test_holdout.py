"""States held out: whole stretches of time, and no pattern of motion in two of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdcr_planner.calibration.holdout import blocks_in_time


def test_stretches_follow_one_another_and_are_about_as_long(states):
    folds = blocks_in_time(states, 4)
    assert (np.diff(folds) >= 0).all()
    assert np.bincount(folds).tolist() == [15, 15, 15, 15]


def test_no_pattern_is_in_two_stretches(states):
    patterns = tuple(["a"] * 25 + ["b"] * 5 + ["c"] * 30)
    folds = blocks_in_time(replace(states, patterns=patterns), 3)
    for name in "abc":
        assert len({fold for fold, pattern in zip(folds, patterns, strict=True) if pattern == name}) == 1
    assert folds[-1] >= 1
