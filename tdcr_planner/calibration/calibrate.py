"""Calibration: selects and fits parameters, judges them on states held out, and makes the robot that was measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.calibration import checks
from tdcr_planner.calibration.bench import Bench, check_calibratable
from tdcr_planner.calibration.bound import LEVEL, bound_per_disk
from tdcr_planner.calibration.comparison import align_base, constant_curvature_shapes
from tdcr_planner.calibration.data import MeasuredStates
from tdcr_planner.calibration.fit import Fit, fit_bench
from tdcr_planner.calibration.fit import Progress as FitProgress
from tdcr_planner.calibration.forward import Forward, UnloadedMechanics, place_points
from tdcr_planner.calibration.holdout import FOLDS, blocks_in_time
from tdcr_planner.calibration.mapping import fit_reference
from tdcr_planner.calibration.parameters import Block, check_names, make_blocks
from tdcr_planner.calibration.reference import ReferenceMechanics
from tdcr_planner.calibration.selection import Selection, check_separable, select_names
from tdcr_planner.calibration.uncertainty import Uncertainty, assess_uncertainty
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.files import sha256_of_file
from tdcr_planner.robot import RobotSpec
from tdcr_planner.robot.measured import BenchTable, MeasuredError

LEAST_STATES = 10
UNEXPLAINED = 0.5
"""A fit that leaves over more than this fraction of how far the points move is no fit."""
MODELS = ("calibrated", "uncalibrated", "constant curvature")

Progress = Callable[[str, int, int, str], None]


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated robot and how it was judged; n states, k tracked points.

    Attributes:
        robot: The calibrated robot with its bench and its measured error, version 2.
        states: What was measured.
        nominal: The robot as its file has it.
        selection: What was fitted, and why not the rest.
        fit: The fit to all states.
        uncertainty: What the measurements say of each parameter.
        folds: Stretch of time to which each state belongs, shape (n,).
        held_out: Differences between predicted and measured points by model, when the state's stretch was held out of
            what the model was fitted to: shape (n, k, 3), m, NaN where a point was not seen.
        fitted: The same of the calibrated model fitted to all states.
    """

    robot: RobotSpec
    states: MeasuredStates
    nominal: Bench
    selection: Selection
    fit: Fit
    uncertainty: Uncertainty
    folds: IntArray
    held_out: dict[str, FloatArray]
    fitted: FloatArray

    def errors(self, model: str = "calibrated") -> FloatArray:
        """Returns distances between predicted and measured points of held-out states, shape (n, k), m."""
        return np.asarray(np.linalg.norm(self.held_out[model], axis=2))


def calibrate(
    robot: RobotSpec,
    states: MeasuredStates,
    names: Sequence[str] | None = None,
    *,
    marker: FloatArray | None = None,
    use_reference: bool = True,
    folds: int = FOLDS,
    progress: Progress = lambda *_: None,
) -> Calibration:
    """Returns a robot calibrated from measured states.

    Args:
        robot: The robot as its file has it.
        states: What was measured of it.
        names: What to fit, see `parameters.DESCRIPTIONS`; None for what the measurements can determine.
        marker: Place of the marker in the last disk's frame, shape (3,), m; None for its centre.
        use_reference: Whether the reference predicts; else arcs do, which know no loads.
        folds: Stretches of time, each of which is held out once.
        progress: Called with a stage, the steps that are done, their number, and a message.

    Raises:
        FormatError: There are too few states, or no numbers explain them.
        InputError: A name is unknown or means nothing here, two cannot be told apart, or the robot has what
            calibration does not know.
    """
    check_calibratable(robot)
    if len(states) < LEAST_STATES:
        raise FormatError(states.path, f"expected {LEAST_STATES} states or more, got {len(states)}")
    bench = Bench.nominal(robot, marker)
    check_names(bench, names or ())
    predictor = _Predictor(states, use_reference=use_reference)
    everything = np.ones(len(states), dtype=np.bool_)
    start = _place_if_far(predictor.final, bench, names)
    progress("selecting parameters", 0, 1, "")
    selection = select_names(predictor.fitted, start, everything) if names is None else Selection(tuple(names), ())
    blocks = make_blocks(start, selection.names, float(states.times[-1]))
    if names is not None:
        check_separable(predictor.fitted, start, blocks, everything)
    if "friction" in selection.names and states.timed:
        checks.check_gaps(states.table, states.times)
    progress("fitting", 0, 1, ", ".join(selection.names))
    fit = predictor.fit(start, blocks, everything, progress=lambda text: progress("fitting", 0, 1, text))
    forward = predictor.final
    fitted = forward.points(fit.bench) - states.positions
    _check_explained(states, fitted)
    fold = blocks_in_time(states, folds)
    held_out = {model: np.full_like(states.positions, np.nan) for model in MODELS}
    uncalibrated = {
        "uncalibrated": forward.shapes(start, keep=False),
        "constant curvature": constant_curvature_shapes(start, states),
    }
    for index in range(int(fold.max()) + 1):
        progress("holding out stretches", index, int(fold.max()) + 1, "")
        rest, here = fold != index, fold == index
        part = predictor.fit(start, blocks, rest, near=fit.numbers)
        held_out["calibrated"][here] = (forward.points(part.bench, keep=False) - states.positions)[here]
        for model, shapes in uncalibrated.items():
            placed = align_base(start, states, shapes, rest) if "base" in selection.names else start
            held_out[model][here] = (place_points(placed, states, shapes) - states.positions)[here]
    errors = np.linalg.norm(held_out["calibrated"], axis=2)
    measured = MeasuredError(
        level=LEVEL,
        disks_m=tuple(float(value) for value in bound_per_disk(predictor.fitted, fit.bench, errors)),
        states=int(np.isfinite(errors).any(axis=1).sum()),
    )
    return Calibration(
        robot=_robot_of(fit.bench, states, measured),
        states=states,
        nominal=start,
        selection=selection,
        fit=fit,
        uncertainty=assess_uncertainty(fit),
        folds=fold,
        held_out=held_out,
        fitted=fitted,
    )


class _Predictor:
    """What predicts the states, and how it is fitted.

    Without loads the reference is fitted by way of the arcs, see `mapping`; under loads by itself.

    Attributes:
        fitted: What the numbers are fitted with.
        final: What predicts once they are found.
    """

    def __init__(self, states: MeasuredStates, *, use_reference: bool) -> None:
        reference = Forward(states, ReferenceMechanics()) if use_reference else None
        loaded = bool(states.gravity.any() or states.tip_force.any())
        if reference is None and loaded:
            raise InputError("use_reference", "true for states under gravity or a tip force", False)
        self.fitted = reference if reference is not None and loaded else Forward(states, UnloadedMechanics())
        self.final = self.fitted if reference is None else reference

    def fit(
        self,
        bench: Bench,
        blocks: tuple[Block, ...],
        chosen: BoolArray,
        *,
        near: FloatArray | None = None,
        progress: FitProgress = lambda _: None,
    ) -> Fit:
        """Returns a fit; near known numbers it takes the correction that holds there."""
        if self.fitted is self.final or near is not None:
            return fit_bench(self.fitted, bench, blocks, chosen, start=near, progress=progress)
        return fit_reference(self.fitted, self.final, bench, blocks, chosen, progress=progress)


FAR_ROTATION = np.deg2rad(20.0)
FAR_POSITION = 0.2
"""In lengths of the robot."""


def _place_if_far(forward: Forward, bench: Bench, names: Sequence[str] | None) -> Bench:
    """Returns the bench with its base placed where the frame of the measurements is quite another one."""
    if names is not None and "base" not in names:
        return bench
    everything = np.ones(len(forward.states), dtype=np.bool_)
    placed = align_base(bench, forward.states, forward.shapes(bench), everything)
    far = np.linalg.norm(placed.base_rotation) > FAR_ROTATION
    return placed if far or np.linalg.norm(placed.base_position) > FAR_POSITION * bench.robot.length else bench


def _check_explained(states: MeasuredStates, differences: FloatArray) -> None:
    """Refuses measurements that no numbers explain."""
    centre = np.nanmedian(states.positions, axis=0)
    moved = float(np.nanmedian(np.linalg.norm(states.positions - centre, axis=2)))
    left = float(np.nanmedian(np.linalg.norm(differences, axis=2)))
    if not left <= UNEXPLAINED * moved:
        raise FormatError(
            states.path,
            f"no parameters explain the positions: they lie {1e3 * moved:.3g} mm from their middle in the median, and "
            f"{1e3 * left:.3g} mm of it is left over; are the columns of tendons in the order of the robot's file, x, "
            "y and z in place, the units metre and newton, and is it this robot?",
        )


def _robot_of(bench: Bench, states: MeasuredStates, measured: MeasuredError) -> RobotSpec:
    """Returns the robot with how it stood and how far it was from its model."""
    first = float(states.table.numbers(["time_s"])[0, 0]) if states.timed else 0.0

    def three(values: FloatArray) -> tuple[float, float, float]:
        return (float(values[0]), float(values[1]), float(values[2]))

    table = BenchTable(
        data=states.path.name,
        data_sha256=sha256_of_file(states.path),
        base_position_m=three(bench.base_position),
        base_rotation_rad=three(bench.base_rotation),
        marker_m=three(bench.marker),
        displacement_offset_m=tuple(bench.zeros.tolist()) if bench.drives_displacement else (),
        displacement_drift_m_s=bench.drift,
        time_s=first,
    )
    return bench.robot.model_copy(update={"bench": table.model_dump(), "measured_error": measured.model_dump()})


def bench_of_robot(robot: RobotSpec, time_s: float | None = None) -> Bench:
    """Returns the bench of a calibrated robot, to predict further measurements.

    Args:
        robot: A robot with a table [bench].
        time_s: Time of the first further state, on the clock of the calibration's measurements; None for that of the
            calibration's first state.
    """
    bench = Bench.nominal(robot)
    table = robot.bench
    if table is None:
        return bench
    elapsed = 0.0 if time_s is None else time_s - table.time_s
    zeros = np.array(table.displacement_offset_m or np.zeros(robot.tendon_count))
    return replace(
        bench,
        base_position=np.array(table.base_position_m),
        base_rotation=np.array(table.base_rotation_rad),
        marker=np.array(table.marker_m),
        zeros=zeros + elapsed * table.displacement_drift_m_s,
        drift=table.displacement_drift_m_s,
    )
