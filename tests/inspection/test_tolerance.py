from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.inspection.inspect import inspect
from tdcr_planner.inspection.tolerance import CoverageSpread, spread_coverage
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.report.coverage_files import SPREAD_COLUMNS, write_inspection_data
from tdcr_planner.robustness import Tolerances

NONE = Tolerances(0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def answer(write_inspection: Callable[..., Scenario], tmp_path_factory: pytest.TempPathFactory) -> Inspection:
    face = [{"mesh": "plate.stl", "facing": [0.0, 0.0, -1.0]}]
    return inspect(PlanningSession(write_inspection(tmp_path_factory.mktemp("plate"), surfaces=face, time_limit_s=1.0)))


def test_robots_without_tolerance_see_what_the_path_sees(answer: Inspection) -> None:
    spread = spread_coverage(answer, NONE, samples=2)
    for seen in spread.seen:
        np.testing.assert_array_equal(seen, answer.coverage.sight.seen)


def test_robots_within_tolerances_differ_and_the_seed_decides_how(answer: Inspection) -> None:
    wide = Tolerances(youngs_modulus=0.2, tension=0.1, base_angle_deg=2.0)
    first, second = (spread_coverage(answer, wide, samples=6, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.seen, second.seen)
    assert len(np.unique(first.shares)) > 1
    for rate, count in zip(first.rates, first.seen.sum(axis=0), strict=True):
        assert rate.low <= count / 6 <= rate.high


# The published table of one-sided 95 % / 95 % limits: 59 samples for the least, 93 for the second, 124 for the third.
@pytest.mark.parametrize(("samples", "rank"), [(58, 0), (59, 1), (92, 1), (93, 2), (123, 2), (124, 3)])
def test_the_sure_share_is_a_tolerance_limit(samples: int, rank: int) -> None:
    shares = np.random.default_rng(samples).permutation(samples) + 1
    # Point i of `samples` is seen by all robots whose share is above it.
    seen = shares[:, None] > np.arange(samples)[None]
    spread = CoverageSpread(NONE, 1, seen, np.ones(samples))
    assert spread.sure == pytest.approx(rank / samples)


def test_the_files_say_how_likely_each_point_is_seen(answer: Inspection, tmp_path: Path) -> None:
    spread = spread_coverage(answer, samples=3)
    write_inspection_data(answer, tmp_path / "out", spread)
    with (tmp_path / "out/coverage.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    found = np.array([[float(row[name]) for name in SPREAD_COLUMNS] for row in rows])
    np.testing.assert_allclose(found[:, 0], spread.seen.mean(axis=0), atol=1e-8)
    assert (found[:, 1] <= found[:, 0]).all()
    assert (found[:, 0] <= found[:, 2]).all()
