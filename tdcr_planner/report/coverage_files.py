"""The files of an inspection: result.json with its coverage, trajectory, shapes and a table of all points."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.files import real_path, sha256_of_file, write_folder_whole
from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.inspection.coverage import Coverage
from tdcr_planner.inspection.tolerance import CoverageSpread
from tdcr_planner.report.plain import plain_json
from tdcr_planner.report.results import result_content
from tdcr_planner.report.state_files import write_shapes, write_trajectory_csv

INSPECTION_FILES = (
    "result.json",
    "trajectory.csv",
    "shapes.npz",
    "coverage.csv",
    "coverage.png",
    "coverage.html",
    "coverage.glb",
    "coverage.ply",
    "tip_view.gif",
)
"""What `tdcr inspect` writes."""

COLUMNS = (
    "point",
    "mesh",
    "x_m",
    "y_m",
    "z_m",
    "normal_x",
    "normal_y",
    "normal_z",
    "area_m2",
    "state",
    "first_seen_s",
    "states_that_see_it",
    "best_distance_m",
    "best_incidence_deg",
    "best_pixel_m",
    "cause",
)


SPREAD_COLUMNS = ("probability_of_being_seen", "probability_low", "probability_high")
"""What coverage.csv holds besides where robots within tolerances were drawn."""


def write_inspection_data(inspection: Inspection, folder: str | Path, spread: CoverageSpread | None = None) -> Path:
    """Writes result.json, trajectory.csv, shapes.npz and coverage.csv, all or none; returns the path of result.json.

    Args:
        inspection: The answer to an inspection.
        folder: Where to write; made when missing.
        spread: What robots within tolerances see along the path; None where it was not asked for.

    Raises:
        FormatError: The folder cannot be written.
    """
    target = real_path(folder)
    result = inspection.plan
    with write_folder_whole(target) as staging:
        write_shapes(result, staging / "shapes.npz")
        write_trajectory_csv(result, staging / "trajectory.csv")
        write_coverage_csv(inspection, staging / "coverage.csv", spread)
        content = result_content(result, target)
        coverage = coverage_content(inspection.coverage)
        if spread is not None:
            coverage["tolerances"] = spread_content(spread)
        content["coverage"] = plain_json(coverage)
        content["shapes_sha256"] = sha256_of_file(staging / "shapes.npz")
        text = json.dumps(content, indent=1, allow_nan=False)
        (staging / "result.json").write_text(text + "\n", encoding="utf-8")
    return target / "result.json"


def coverage_content(coverage: Coverage) -> dict[str, Any]:
    """Returns what result.json says of the coverage; shares are by area."""
    return {
        "points": len(coverage.targets),
        "area_m2": float(coverage.targets.areas.sum()),
        "spacing_m": coverage.targets.spacing_m,
        "of_all": coverage.of_all,
        "of_what_can_be_seen": coverage.of_what_can_be_seen,
        "can_be_seen": coverage.visible,
        "asked": coverage.asked,
        "reached": coverage.reached,
        "cannot_be_seen": coverage.cause_shares,
        "trace": {
            "time_s": [item[0] for item in coverage.trace],
            "of_all": [item[1] for item in coverage.trace],
            "body_motion_m": [item[2] for item in coverage.trace],
            "can_be_seen": [item[3] for item in coverage.trace],
        },
    }


def spread_content(spread: CoverageSpread) -> dict[str, Any]:
    """Returns what result.json says of the coverage on robots within tolerances."""
    low, middle = (float(np.quantile(spread.shares, level)) for level in (0.05, 0.5))
    return {
        "robots": spread.samples,
        "seed": spread.seed,
        "standard_deviations": dict(spread.tolerances.items()),
        "of_all_median": middle,
        "of_all_5_percent": low,
        "of_all_sure": spread.sure,
    }


def write_coverage_csv(inspection: Inspection, file: str | Path, spread: CoverageSpread | None = None) -> None:
    """Writes a row a point: where it is, whether and when it is seen, how well, and otherwise why not.

    With a spread, three columns more: how likely it is seen by robots within tolerances, and the interval of that.
    """
    rates = None if spread is None else spread.rates
    coverage, path = inspection.coverage, inspection.plan.path
    targets, sight = coverage.targets, coverage.sight
    names = [Path(entry.file).name for entry in inspection.plan.scenario.file.meshes]
    incidence = sight.incidence_deg
    with Path(file).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS if rates is None else (*COLUMNS, *SPREAD_COLUMNS))
        for index, state in enumerate(coverage.states()):
            first = int(sight.first[index])
            cause = coverage.causes[index]
            likely = [] if rates is None else _numbers(rates[index].value, rates[index].low, rates[index].high)
            writer.writerow(
                [
                    index + 1,
                    names[int(targets.meshes[index])],
                    *_numbers(*targets.points[index], *targets.normals[index], targets.areas[index]),
                    state,
                    "" if path is None or first < 0 else f"{path.times[first]:.6g}",
                    int(sight.looks[index]),
                    *_numbers(sight.distance[index], incidence[index], sight.pixel[index]),
                    "" if cause is None else cause.value,
                    *likely,
                ]
            )


def _numbers(*values: Any) -> list[str]:
    return ["" if not math.isfinite(value) else f"{np.float64(value):.9g}" for value in values]
