"""The files of a calibration: the robot, its parameters, every state's residual, and figures."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.calibrate import MODELS, Calibration
from tdcr_planner.files import write_folder_whole
from tdcr_planner.query.result import library_versions
from tdcr_planner.report.calibration_plots import plot_residuals
from tdcr_planner.report.drawing import draw_pictures
from tdcr_planner.report.plain import plain_json
from tdcr_planner.robot import format_robot

CALIBRATION_FORMAT = "tdcr-calibration/1"
FILES = ("robot.toml", "parameters.csv", "residuals.csv", "calibration.json")
PICTURES = ("residuals.png",)


def write_calibration(found: Calibration, folder: str | Path, source: str | Path) -> None:
    """Writes robot.toml, parameters.csv, residuals.csv and calibration.json, all or none.

    Args:
        found: The calibration.
        folder: Where to write; made when missing.
        source: The robot's file that was calibrated.

    Raises:
        FormatError: The folder cannot be written.
    """
    with write_folder_whole(folder, last="calibration.json") as staging:
        (staging / "robot.toml").write_text(format_robot(found.robot, _comment(found, source)), encoding="utf-8")
        _write_parameters(found, staging / "parameters.csv")
        _write_residuals(found, staging / "residuals.csv")
        text = json.dumps(plain_json(calibration_content(found, source)), indent=1, allow_nan=False)
        (staging / "calibration.json").write_text(text + "\n", encoding="utf-8")


def draw_calibration(found: Calibration, folder: str | Path) -> list[str]:
    """Draws the figures and returns the names of what was drawn; a picture that cannot be drawn is a warning."""
    return draw_pictures(folder, {"residuals.png": lambda file: plot_residuals(found, file)})


def error_numbers(errors: FloatArray) -> dict[str, float]:
    """Returns root mean square, median, 95th percentile and largest of distances, m; NaN counts as not seen."""
    seen = errors[np.isfinite(errors)]
    return {
        "rms_m": float(np.sqrt(np.mean(seen**2))),
        "median_m": float(np.median(seen)),
        "p95_m": float(np.quantile(seen, 0.95)),
        "max_m": float(seen.max()),
    }


def parameter_rows(found: Calibration) -> list[dict[str, Any]]:
    """Returns the table of parameters: name, unit, value, standard error, value in the file, whether determined."""
    rows = []
    numbers, deviations = found.fit.numbers, found.uncertainty.deviations
    for parameter, number, deviation in zip(found.fit.parameters, numbers, deviations, strict=True):
        rows.append(
            {
                "parameter": parameter.label,
                "unit": parameter.unit,
                "value": parameter.value(float(number)),
                "standard_error": parameter.error(float(number), float(deviation)),
                "nominal": parameter.nominal,
                "determined": parameter.label in found.uncertainty.determined,
            }
        )
    return rows


def calibration_content(found: Calibration, source: str | Path) -> dict[str, Any]:
    """Returns the content of calibration.json."""
    known = found.uncertainty
    return {
        "format": CALIBRATION_FORMAT,
        "robot": str(source),
        "data": str(found.states.path),
        "data_sha256": found.robot.bench.data_sha256 if found.robot.bench else "",
        "versions": library_versions(),
        "states": len(found.states),
        "points": found.states.point_names(),
        "fitted": found.selection.names,
        "not_fitted": dict(found.selection.left_out),
        "parameters": parameter_rows(found),
        "correlations": known.correlations,
        "undetermined": known.undetermined,
        "inseparable": known.inseparable,
        "told_apart_badly": [{"parameters": pair[:2], "correlation": pair[2]} for pair in known.alike],
        "variance_inflation": known.inflation,
        "noise_position_m": found.fit.noise.position,
        "error_fitted": error_numbers(np.linalg.norm(found.fitted, axis=2)),
        "error_held_out": {model: error_numbers(found.errors(model)) for model in MODELS},
        "held_out_stretches": int(found.folds.max()) + 1,
        "measured_error": found.robot.measured_error.model_dump() if found.robot.measured_error else None,
        "sequences_solved": found.fit.evaluations,
    }


def _comment(found: Calibration, source: str | Path) -> str:
    error = error_numbers(found.errors())
    return (
        f"Calibrated by `tdcr calibrate` from {Path(source).name} and {len(found.states)} states in "
        f"{found.states.path.name}.\nFitted: {', '.join(found.selection.names)}.\n"
        f"Held-out error: {1e3 * error['rms_m']:.2f} mm root mean square, {1e3 * error['p95_m']:.2f} mm at 95 %."
    )


def _write_parameters(found: Calibration, path: Path) -> None:
    rows = parameter_rows(found)
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]) if rows else ["parameter"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _write_residuals(found: Calibration, path: Path) -> None:
    states = found.states
    names = [name.replace(" ", "_") for name in states.point_names()]
    header = ["line", "time_s", "stretch"]
    for kind in ("fitted", "held_out"):
        header += [f"{kind}_{name}_{axis}_m" for name in names for axis in "xyz"]
    held_out = found.held_out["calibrated"]
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        for row in range(len(states)):
            numbers = [*found.fitted[row].ravel(), *held_out[row].ravel()]
            texts = [f"{value:.7f}" if np.isfinite(value) else "" for value in numbers]
            writer.writerow([states.table.lines[row], f"{states.times[row]:.6f}", int(found.folds[row]) + 1, *texts])
