"""Fitting the robot to measured shapes, and training a model for the robot that they describe."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomli_w
from scipy.optimize import least_squares

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError
from tdcr_planner.learning.checkpoint import write_bytes
from tdcr_planner.learning.dataset import Progress, no_progress
from tdcr_planner.learning.measured import MeasuredShapes, read_measured_shapes
from tdcr_planner.learning.settings import TrainSettings
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Calibration, ModelCard
from tdcr_planner.statics.solver import RodSolution, SolverSettings, solve_statics
from tdcr_planner.workers import Backend

# Prior on the logarithm of the stiffness: handbooks' values of Young's modulus spread by about this much.
_PRIOR_SPREAD = 0.3
# Part of the shapes' distance from the straight robot that friction and noise may leave over after the fit.
_LARGEST_UNEXPLAINED = 0.2


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
        FormatError: No stiffness makes the robot able to take the measured loads, or none explains the shapes.
    """
    seen = np.isfinite(measured.positions)
    latest: list[RodSolution | None] = [None]

    def distances(scale: float) -> FloatArray:
        cases = measured.cases
        solution = solve_statics(
            robot.scaled(stiffness=scale),
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
    straight = np.zeros_like(measured.positions)
    straight[:, :, 2] = robot.arc_lengths[list(measured.disks)]
    bent_mm = 1e3 * _point_rms((measured.positions - straight)[seen])
    if calibration.rms_after_mm > _LARGEST_UNEXPLAINED * bent_mm:
        raise FormatError(
            measured.path,
            f"no stiffness explains the shapes: they lie {bent_mm:.3g} mm from the straight robot, and "
            f"{calibration.rms_after_mm:.3g} mm from robot {robot.name!r} with {scale:.2g} times its stiffness; "
            "are the units newton, metre and m/s^2, and is it this robot?",
        )
    return robot.scaled(stiffness=scale), calibration


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
    return tomli_w.dumps({"format": content.pop("format"), "name": content.pop("name"), **content})


def _point_rms(differences: FloatArray) -> float:
    return float(np.sqrt(3.0 * np.mean(differences**2)))
