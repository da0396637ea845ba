"""The files of an inspection: result.json with its coverage, trajectory, shapes and a table of all points."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.files import real_path, sha256_of_file, write_folder_whole
from tdcr_planner.inspection.coverage import Coverage
from tdcr_planner.inspection.inspect import Inspection
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


def write_inspection_data(inspection: Inspection, folder: str | Path) -> Path:
    """Writes result.json, trajectory.csv, shapes.npz and coverage.csv, all or none; returns the path of result.json.

    Raises:
        FormatError: The folder cannot be written.
    """
    target = real_path(folder)
    result = inspection.plan
    with write_folder_whole(target) as staging:
        write_shapes(result, staging / "shapes.npz")
        write_trajectory_csv(result, staging / "trajectory.csv")
        write_coverage_csv(inspection, staging / "coverage.csv")
        content = result_content(result, target)
        content["coverage"] = plain_json(coverage_content(inspection.coverage))
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


def write_coverage_csv(inspection: Inspection, file: str | Path) -> None:
    """Writes a row a point: where it is, whether and when it is seen, how well, and otherwise why not."""
    coverage, path = inspection.coverage, inspection.plan.path
    targets, sight = coverage.targets, coverage.sight
    names = [Path(entry.file).name for entry in inspection.plan.scenario.file.meshes]
    incidence = sight.incidence_deg
    with Path(file).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        for index, state in enumerate(coverage.states()):
            first = int(sight.first[index])
            cause = coverage.causes[index]
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
                ]
            )


def _numbers(*values: Any) -> list[str]:
    return ["" if not math.isfinite(value) else f"{np.float64(value):.9g}" for value in values]
