"""Measured shapes from a test bench: reading them, and fitting the robot and its model to them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError
from tdcr_planner.files import read_text
from tdcr_planner.learning.checkpoint import write_bytes
from tdcr_planner.learning.dataset import Cases, Progress, no_progress
from tdcr_planner.learning.settings import TrainSettings
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Calibration, ModelCard
from tdcr_planner.statics.solver import RodSolution, SolverSettings, solve_statics
from tdcr_planner.workers import Backend

# Prior on the logarithm of the stiffness: handbooks' values of Young's modulus spread by about this much.
_PRIOR_SPREAD = 0.3


@dataclass(frozen=True)
class MeasuredShapes:
    """Tracked points of a real robot.

    Attributes:
        path: The CSV file.
        cases: Tensions and loads, n of them.
        disks: Indices of the tracked disks, shape (k,).
        positions: Their centres, shape (n, k, 3), m, base frame; NaN where a marker was not seen.
    """

    path: Path
    cases: Cases
    disks: tuple[int, ...]
    positions: FloatArray


def read_measured_shapes(path: str | Path, robot: RobotSpec) -> MeasuredShapes:
    """Returns the measured shapes in a CSV file.

    One row a shape, with a header. Columns, in any order:

    - `tension_0_n` ... one a tendon, in the robot file's order, N;
    - `disk_<i>_x_m`, `disk_<i>_y_m`, `disk_<i>_z_m` for one or more disks i from 1 to d - 1, m, base frame; an empty
      field where the marker was not seen;
    - optional `gravity_x_m_s2`, `gravity_y_m_s2`, `gravity_z_m_s2`, base frame (else no gravity);
    - optional `tip_force_x_n`, `tip_force_y_n`, `tip_force_z_n`, base frame (else none).

    Raises:
        FormatError: Columns are missing or unknown, a field is no finite number, a tension is negative or far beyond
            its limit, or positions lie beyond the robot's reach, as they do in the wrong unit.
    """
    header, rows = _read_table(path)
    disks = _check_columns(path, header, robot)
    columns = {name: index for index, name in enumerate(header)}

    def vectors(names: list[str], *, may_be_empty: bool = False) -> FloatArray:
        return np.array(
            [[_parse(path, line, name, row[columns[name]], may_be_empty) for name in names] for line, row in rows]
        )

    tensions = vectors([f"tension_{i}_n" for i in range(robot.tendon_count)])
    loads = []
    for names in (_axes("gravity_{}_m_s2"), _axes("tip_force_{}_n")):
        loads.append(vectors(names) if names[0] in columns else np.zeros((len(rows), 3)))
    names = [name for disk in disks for name in _axes(f"disk_{disk}_{{}}_m")]
    positions = vectors(names, may_be_empty=True).reshape(len(rows), len(disks), 3)
    _check_values(path, rows, tensions, positions, disks, robot)
    return MeasuredShapes(Path(path), Cases(tensions, *loads), disks, positions)


def fit_stiffness(
    robot: RobotSpec, measured: MeasuredShapes, weight: float, noise_m: float
) -> tuple[RobotSpec, Calibration]:
    """Returns the robot whose stiffness fits measured shapes, by least squares through the reference.

    Minimises weight * sum |p - p_measured|^2 / noise^2 + (ln scale / 0.3)^2 over one factor on Young's modulus of all
    backbones. It is the part of the loss that measured shapes decide: given the stiffness, the shape is mechanics.

    Args:
        robot: The robot as its file has it.
        measured: Measured shapes.
        weight: Weight of the measured part of the loss.
        noise_m: Standard deviation of a measured coordinate, m.

    Returns:
        The robot with the identified Young's modulus, and what was found.

    Raises:
        FormatError: No stiffness makes the robot able to take the measured loads.
    """
    seen = np.isfinite(measured.positions)
    latest: list[RodSolution | None] = [None]

    def distances(scale: float) -> FloatArray:
        cases = measured.cases
        solution = solve_statics(
            scale_stiffness(robot, scale),
            cases.tensions,
            gravity=cases.gravity,
            tip_force=cases.tip_force,
            initial=latest[0],
            settings=SolverSettings(),
        )
        if not solution.converged.all():
            row = int(np.flatnonzero(~solution.converged)[0])
            raise FormatError(
                measured.path,
                f"the robot has no equilibrium there (stiffness factor {scale:.3g}, status {solution.status[row]}); "
                "check tensions and loads",
                f"shape {row + 1}",
            )
        latest[0] = solution
        return np.asarray((solution.positions[:, list(measured.disks)] - measured.positions)[seen])

    def residuals(parameters: FloatArray) -> FloatArray:
        scaled = np.sqrt(weight) / noise_m * distances(float(np.exp(parameters[0])))
        return np.append(scaled, parameters[0] / _PRIOR_SPREAD)

    fit = least_squares(residuals, np.zeros(1), bounds=(np.log(0.2), np.log(5.0)), diff_step=1e-4, x_scale=0.1)
    scale = float(np.exp(fit.x[0]))
    calibration = Calibration(
        measured_file=measured.path.name,
        shapes=len(measured.cases),
        stiffness_scale=scale,
        rms_before_mm=1e3 * _point_rms(distances(1.0)),
        rms_after_mm=1e3 * _point_rms(distances(scale)),
    )
    return scale_stiffness(robot, scale), calibration


def scale_stiffness(robot: RobotSpec, scale: float) -> RobotSpec:
    """Returns a robot with Young's modulus of all its backbones multiplied."""
    backbone = robot.backbone.model_copy(update={"youngs_modulus_pa": scale * robot.backbone.youngs_modulus_pa})
    segments = tuple(
        segment
        if segment.backbone is None
        else segment.model_copy(
            update={
                "backbone": segment.backbone.model_copy(
                    update={"youngs_modulus_pa": scale * segment.backbone.youngs_modulus_pa}
                )
            }
        )
        for segment in robot.segments
    )
    # Built anew: a copy would keep what the old one has computed and cached.
    content = robot.model_dump()
    content |= {"backbone": backbone.model_dump(), "segments": [segment.model_dump() for segment in segments]}
    return RobotSpec.model_validate(content)


def train_on_measured(
    robot: RobotSpec,
    settings: TrainSettings,
    out: Path,
    *,
    progress: Progress = no_progress,
    log_folder: Path | None = None,
    backend: Backend | None = None,
) -> ModelCard:
    """Fits the robot to measured shapes, then trains (or fine-tunes) a model for that robot.

    Writes the model, and beside it `<out>.robot.toml`, the robot that the measurements describe: it is the one to name
    in scenarios, so that search and verification speak of the same robot as the measurements.

    Args:
        robot: The robot as its file has it.
        settings: What train.toml says; with a table [measured].
        out: The model file.
        progress: Called with stage, steps done, steps in all and a remark.
        log_folder: Where to write TensorBoard logs; None for none.
        backend: Where the reference solves the cases; None for this process.
    """
    from tdcr_planner.learning.train import train_model

    assert settings.measured is not None
    measured = read_measured_shapes(settings.resolve(settings.measured.file), robot)
    progress("fitting", 0, 1, f"{len(measured.cases)} measured shapes")
    fitted, calibration = fit_stiffness(robot, measured, settings.loss.measured, settings.measured.noise_m)
    progress("fitting", 1, 1, f"stiffness times {calibration.stiffness_scale:.4g}")
    card = train_model(
        fitted, settings, out, progress=progress, log_folder=log_folder, calibration=calibration, backend=backend
    )
    write_bytes(out.with_suffix(".robot.toml"), format_robot(fitted).encode())
    return card


def format_robot(robot: RobotSpec) -> str:
    """Returns a robot as the TOML text of its file."""
    content = robot.model_dump(exclude_none=True)
    lines = [f'format = "{robot.format}"', f"name = {_toml_value(robot.name)}"]
    lines += ["", "[backbone]", *_toml_lines(content["backbone"])]
    for segment in content["segments"]:
        own = segment.pop("backbone", None)
        lines += ["", "[[segments]]", *_toml_lines(segment)]
        if own is not None:
            lines += ["", "[segments.backbone]", *_toml_lines(own)]
    lines += ["", "[tip]", *_toml_lines(content["tip"]), "", "[body]", *_toml_lines(content["body"])]
    return "\n".join(lines) + "\n"


def _toml_lines(table: dict[str, Any]) -> list[str]:
    return [f"{key} = {_toml_value(value)}" for key, value in table.items()]


def _toml_value(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    return repr(value)


def _point_rms(differences: FloatArray) -> float:
    return float(np.sqrt(3.0 * np.mean(differences**2)))


def _read_table(path: str | Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    table = list(csv.reader(read_text(path).splitlines()))
    if len(table) < 2:
        raise FormatError(path, "expected a header and at least one row of measured values")
    header = [name.strip() for name in table[0]]
    rows = []
    for line, row in enumerate(table[1:], start=2):
        if not row:
            continue
        if len(row) != len(header):
            raise FormatError(path, f"expected {len(header)} fields as in the header, got {len(row)}", f"line {line}")
        rows.append((line, row))
    return header, rows


def _check_columns(path: str | Path, header: list[str], robot: RobotSpec) -> tuple[int, ...]:
    """Returns the tracked disks, or says which columns are missing, doubled or unknown."""
    tensions = [f"tension_{i}_n" for i in range(robot.tendon_count)]
    optional = [_axes("gravity_{}_m_s2"), _axes("tip_force_{}_n")]
    tracked = {disk: _axes(f"disk_{disk}_{{}}_m") for disk in range(1, robot.disk_count)}
    present = set(header)
    if len(present) != len(header):
        doubled = next(name for name in header if header.count(name) > 1)
        raise FormatError(path, "column appears more than once", doubled)
    missing = [name for name in tensions if name not in present]
    for group in [*optional, *tracked.values()]:
        if present.intersection(group):
            missing += [name for name in group if name not in present]
    if missing:
        raise FormatError(path, f"missing columns: {', '.join(missing)}")
    known = {*tensions, *(name for group in [*optional, *tracked.values()] for name in group)}
    unknown = [name for name in header if name not in known]
    if unknown:
        raise FormatError(
            path,
            f"unknown column; expected {tensions[0]} to {tensions[-1]}, disk_1_x_m to disk_{robot.disk_count - 1}_z_m, "
            f"{', '.join(optional[0] + optional[1])}",
            unknown[0] or "empty column name",
        )
    disks = tuple(disk for disk, names in tracked.items() if names[0] in present)
    if not disks:
        raise FormatError(path, "missing columns: no disk is tracked, expected for example disk_1_x_m, _y_m, _z_m")
    return disks


def _axes(pattern: str) -> list[str]:
    return [pattern.format(axis) for axis in "xyz"]


def _parse(path: str | Path, line: int, name: str, text: str, may_be_empty: bool) -> float:
    place = f"line {line}, {name}"
    if not text.strip():
        if may_be_empty:
            return float("nan")
        raise FormatError(path, "is empty, expected a number", place)
    try:
        value = float(text)
    except ValueError as error:
        raise FormatError(path, f"expected a number, got {text!r}", place) from error
    if not np.isfinite(value):
        raise FormatError(path, f"expected a finite number, got {text.strip()}", place)
    return value


def _check_values(
    path: str | Path,
    rows: list[tuple[int, list[str]]],
    tensions: FloatArray,
    positions: FloatArray,
    disks: tuple[int, ...],
    robot: RobotSpec,
) -> None:
    """Finds what no robot can do: pushing tendons, tensions far over their limits, points out of reach or all at 0."""
    limits = 2.0 * robot.max_tensions
    wrong = np.argwhere((tensions < 0.0) | (tensions > limits))
    if len(wrong):
        row, column = wrong[0]
        raise FormatError(
            path,
            f"expected 0 to {limits[column] / 2.0:g} N, got {tensions[row, column]:g}; is the unit newton?",
            f"line {rows[row][0]}, tension_{column}_n",
        )
    reach = robot.arc_lengths[list(disks)]
    distance = np.linalg.norm(positions, axis=2)
    far = np.argwhere(distance > 1.05 * reach + robot.disk_radii[list(disks)])
    if len(far):
        row, column = far[0]
        raise FormatError(
            path,
            f"disk {disks[column]} is {distance[row, column]:g} m from the base, and the robot reaches "
            f"{reach[column]:g} m there; is the unit metre and the frame the base frame?",
            f"line {rows[row][0]}",
        )
    seen = np.isfinite(distance)
    if not seen.any():
        raise FormatError(path, "no marker was seen in any row")
    if np.nanmax(distance / reach) < 0.01:
        raise FormatError(
            path,
            f"all points lie within {np.nanmax(distance):g} m of the base of a robot of {robot.length:g} m; "
            "is the unit metre?",
        )
