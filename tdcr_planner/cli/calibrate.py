"""tdcr calibrate: a robot file from what a test bench has measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.calibration.calibrate import Calibration


def calibrate(
    robot: tyro.conf.Positional[Path],
    data: tyro.conf.Positional[Path],
    *,
    out: Path,
    fit: str | None = None,
    marker_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    stretches: int = 6,
    progress: bool = True,
) -> int:
    """Fit a robot to measured states, judge it on states held out, and write the robot file of the real robot.

    Example: tdcr calibrate models/robots/opencr.toml bench.csv --marker-mm 0 0 8 --out out/calibrated

    The CSV file has a row a state, in the order in time: tendon_displacement_1_m ... or tension_1_n ..., any of
    tip_x_m ..., disk_<k>_x_m ..., marker_x_m ..., and optional time_s, pattern, gravity_x_m_s2 ..., tip_force_x_n ....
    docs/calibrate.md describes columns, parameters and what is written.

    Args:
        robot: The robot's file, to start from.
        data: Measured states, CSV.
        out: Folder for robot.toml, parameters.csv, residuals.csv, calibration.json and residuals.png.
        fit: Names of what to fit, separated by commas: modulus, transmission, friction, pretension, angles, radii,
            offsets, drift, base, marker, mass. Without it: what the data can determine. Where base is not among them,
            positions are in the base frame.
        marker_mm: Place of the marker in the last disk's frame, mm.
        stretches: Stretches of time, each held out once to judge the fit.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    import numpy as np

    from tdcr_planner.bounds import STRETCHES
    from tdcr_planner.calibration.calibrate import calibrate as calibrate_robot
    from tdcr_planner.calibration.data import read_measured_states
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import StageBar
    from tdcr_planner.files import check_folder
    from tdcr_planner.report.calibration_results import FILES, draw_calibration, write_calibration
    from tdcr_planner.robot import load_robot

    STRETCHES.check("--stretches", stretches)
    names = None if fit is None else [name.strip() for name in fit.split(",") if name.strip()]
    spec = load_robot(robot)
    check_folder(out, FILES)
    states = read_measured_states(data, spec, base_is_known=names is not None and "base" not in names)
    with StageBar(shown=progress) as bar:
        found = calibrate_robot(
            spec, states, names, marker=1e-3 * np.array(marker_mm), folds=stretches, progress=bar.update
        )
    write_calibration(found, out, robot)
    print(describe(found), flush=True)
    drawn = draw_after("calibration.json", lambda: draw_calibration(found, out))
    print(f"files: {' '.join(f'{out}/{name}' for name in [*FILES, *drawn])}")
    return 0


def describe(found: Calibration) -> str:
    """Returns a calibration as tables for a terminal."""
    from tdcr_planner.calibration.calibrate import MODELS
    from tdcr_planner.report.calibration_results import error_numbers, parameter_rows

    lines = [f"{'parameter':<26}{'value':>12}{'std error':>12}  {'unit':<6}{'in the file':>12}"]
    for row in parameter_rows(found):
        note = "" if row["determined"] else "  not determined"
        lines.append(
            f"{row['parameter']:<26}{row['value']:>12.5g}{row['standard_error']:>12.2g}  {row['unit']:<6}"
            f"{row['nominal']:>12.5g}{note}"
        )
    for name, reason in found.selection.left_out:
        lines.append(f"not fitted: {name}: {reason}")
    for group in found.uncertainty.inseparable:
        lines.append(f"cannot be told apart: {' and '.join(group)}")
    for first, second, correlation in found.uncertainty.alike[:5]:
        lines.append(f"told apart badly: {first} and {second} (correlation {correlation:.3f})")
    stretches = int(found.folds.max()) + 1
    lines.append(f"error on held-out states, {stretches} stretches of time, mm")
    lines.append(f"{'':<22}{'rms':>8}{'median':>8}{'95 %':>8}{'largest':>9}")
    for model in MODELS:
        numbers = error_numbers(found.errors(model))
        lines.append(
            f"  {model:<20}{1e3 * numbers['rms_m']:>8.2f}{1e3 * numbers['median_m']:>8.2f}"
            f"{1e3 * numbers['p95_m']:>8.2f}{1e3 * numbers['max_m']:>9.2f}"
        )
    measured = found.robot.measured_error
    if measured is not None:
        lines.append(
            f"error bound of the last disk, {100 * measured.level:g} %: {1e3 * measured.disks_m[-1]:.2f} mm, "
            "[measured_error] in robot.toml"
        )
    return "\n".join(lines)
