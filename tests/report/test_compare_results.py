import csv
import json

import numpy as np
import pytest
from matplotlib.image import imread

from tdcr_planner.compare.comparison import Comparison, Disagreement
from tdcr_planner.compare.paths import PlannedPath
from tdcr_planner.compare.timing import CheckTime
from tdcr_planner.compare.verdicts import MODELS, Verdicts, variants_of
from tdcr_planner.errors import FormatError
from tdcr_planner.planning.causes import Cause
from tdcr_planner.report.compare_results import (
    agreement_rows,
    comparison_content,
    coordinate_names,
    state_rows,
    verdict_rows,
    write_comparison,
)


@pytest.fixture
def comparison(make_scenario):
    """Six states: one right by all, two that constant curvature calls valid and are not, one without a shape."""
    scenario = make_scenario()
    disks = scenario.robot.disk_count
    straight = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, 0.1], disks)
    #                    learned, bare, arc, learned planned, arc planned
    wall, limit, none = Cause.CAVITY.code, Cause.TENSION_LIMIT.code, Cause.NO_SHAPE.code
    codes = np.array(
        [
            [0, 0, 0, 0, 0],
            [wall, wall, 0, wall, 0],
            [wall, 0, 0, wall, wall],
            [wall, 0, wall, wall, wall],
            [limit] * 5,
            [none, none, wall, none, wall],
        ]
    )
    verdicts = Verdicts(
        rows=np.zeros((6, len(_names(scenario)))),
        reference=np.array([0, 3, 3, 0, 2, 1], dtype=np.int8),
        clearance=np.array([0.01, -0.002, 0.0004, 0.0006, 0.02, np.nan]),
        codes=codes.astype(np.int8),
        deviation=np.array([[1e-5, 0.03], [1e-5, 0.04], [2e-5, 0.01], [1e-5, 0.02], [1e-5, 0.02], [np.nan, np.nan]]),
    )
    wrong = Disagreement(
        "constant_curvature", "false_valid", 1, "clearance", verdicts.rows[1], -0.002, 0.04, straight,
        np.tile(np.eye(3), (disks, 1, 1)), straight + np.array([0.02, 0.0, 0.0]), np.tile(np.eye(3), (disks, 1, 1)),
    )  # fmt: skip
    return Comparison(
        scenario=scenario,
        seed=1,
        drawn=9,
        verdicts=verdicts,
        error_bound=np.full(disks, 2e-4),
        times=tuple(
            CheckTime(name, 6, shape, shape + 10.0)
            for name, shape in (("learned", 5.0), ("constant_curvature", 8.0), ("reference", 90.0))
        ),
        paths=(
            PlannedPath("learned", 1, "verified", 0, 0.001, 1e-5, 0.4),
            PlannedPath("constant_curvature", 1, "unverified", 2, float("nan"), None, 9.0),
        ),
        disagreements=(wrong,),
        hashes={"scenario": scenario.sha256},
        seconds={"load": 1.0},
    )


def _names(scenario):
    count = 2 * scenario.robot.segment_count
    return range(count + (scenario.file.base.insertion_m is not None) + (scenario.file.base.roll_deg is not None))


def test_compare_json_has_the_counts_and_rates(comparison):
    content = comparison_content(comparison)
    assert content["format"] == "tdcr-compare/1"
    assert (content["samples"], content["draws"], content["beyond_tension_limits"]) == (6, 9, 3)
    assert content["reference"] == {"valid": 2, "no_shape": 1, "limits": 1, "clearance": 2, "self_collision": 0}
    arc = content["variants"]["constant_curvature"]
    assert arc["confusion"] == {"both_valid": 1, "false_valid": 2, "false_invalid": 1, "both_invalid": 2}
    assert (arc["rates"]["false_valid"]["count"], arc["rates"]["false_valid"]["total"]) == (2, 6)
    # 2 of 6: Clopper and Pearson's interval from their table for 95 %.
    assert arc["rates"]["false_valid"]["low"] == pytest.approx(0.0433, abs=5e-5)
    assert arc["rates"]["false_valid"]["high"] == pytest.approx(0.7772, abs=5e-5)
    assert arc["deviation_m"]["false_valid"]["max"] == 0.04
    assert arc["missing_clearance_m"]["max"] == pytest.approx(comparison.scenario.planner.clearance_m + 0.002)
    assert content["variants"]["learned"]["rates"]["false_valid"]["count"] == 0
    ratio = content["false_valid_ratio"]["states"]
    assert ratio["value"] is None
    assert 0.0 < ratio["at_least"] < 1.0
    assert [path["verified_at_once_of_found"]["count"] for path in content["paths"]] == [1, 0]
    assert content["disagreements"][0]["state"] == 1
    assert content["disagreements"][0]["cause"] == "clearance"


def test_all_files_are_there_and_pictures_show_something(comparison, tmp_path):
    content = json.loads(write_comparison(comparison, tmp_path / "out").read_text(encoding="utf-8"))
    assert content["pictures"] == ["disagreement_1_constant_curvature_false_valid.png"]
    for name in (*content["pictures"], "rates.png", "agreement.png", "deviation.png", "times.png", "paths.png"):
        assert np.ptp(imread(tmp_path / "out" / name)[..., :3]) > 0.5
        if not name.startswith("disagreement"):
            assert (tmp_path / "out" / name).with_suffix(".pdf").read_bytes().startswith(b"%PDF")
    for name, count in (("states", 6), ("verdicts", len(variants_of(MODELS))), ("paths", 2)):
        with (tmp_path / "out" / f"{name}.csv").open(newline="") as stream:
            assert len(list(csv.DictReader(stream))) == count


def test_tables_name_states_and_causes(comparison):
    states = state_rows(comparison)
    assert [row["reference"] for row in states] == ["valid", "clearance", "clearance", "valid", "limits", "no_shape"]
    assert [row["learned"] for row in states] == ["valid", "cavity", "cavity", "cavity", "tension_limit", "statics"]
    assert set(coordinate_names(comparison)) <= set(states[0])
    assert len(coordinate_names(comparison)) == comparison.verdicts.rows.shape[1]
    verdicts = verdict_rows(comparison)
    assert [row["variant"] for row in verdicts] == [variant.name for variant in variants_of(MODELS)]
    assert verdicts[2]["false_valid"] == pytest.approx(2 / 6)
    assert verdicts[2]["deviation_false_valid_median_m"] == pytest.approx(0.025)
    assert verdicts[2]["missing_clearance_max_m"] == pytest.approx(comparison.scenario.planner.clearance_m + 0.002)
    assert verdicts[0]["deviation_false_valid_median_m"] is None
    agreement = [row for row in agreement_rows(comparison) if row["variant"] == "constant_curvature"]
    assert sum(row["states"] for row in agreement) == 5


def test_without_paths_and_disagreements(comparison, tmp_path):
    from dataclasses import replace

    write_comparison(comparison, tmp_path / "out")
    (tmp_path / "out" / "paths_of_mine.csv").write_text("")
    write_comparison(replace(comparison, paths=(), disagreements=()), tmp_path / "out")
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert "paths_of_mine.csv" in names
    names.remove("paths_of_mine.csv")
    assert not any("disagreement" in name or "paths" in name for name in names)


def test_refuses_a_folder_that_cannot_be_written(comparison, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="cannot be written"):
        write_comparison(comparison, tmp_path / "file" / "out")
