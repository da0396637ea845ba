"""The reference as what predicts measured states: the mechanics that planning verifies with, under all loads."""

from __future__ import annotations

import os

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.data import MeasuredStates
from tdcr_planner.calibration.forward import Shapes, displacements_of, tensions_of
from tdcr_planner.calibration.unloaded import solve_arcs, springs_of
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solver import RodSolution, SolverSettings, solve_statics


class ReferenceMechanics:
    """The Cosserat rod under gravity and tip force, with slack and straight tendons between disks.

    Friction in the sheaths comes before the robot: how much of the tension it takes follows from the motion of the
    tendons, which the arcs give to first order in the loads; the rod is then solved with what arrives at its base.
    Friction along the robot is left out.
    """

    name = "reference"

    def __init__(self) -> None:
        self._settings = SolverSettings(threads=min(os.cpu_count() or 1, 4))
        self._last: RodSolution | None = None

    def shapes(self, bench: Bench, states: MeasuredStates, start: FloatArray | None) -> Shapes:
        """Returns the shapes of all states."""
        displacements, tensions = displacements_of(bench, states), tensions_of(bench, states)
        arcs = solve_arcs(bench.robot, displacements, tensions, start)
        smooth = _without_friction(bench.robot)
        initial = self._last if self._last is not None and len(self._last.tensions) == len(states) else None
        if initial is not None and not initial.stable.all():
            initial = None
        if bench.drives_displacement:
            arriving = displacements + _lost_displacement(bench, displacements, tensions, arcs.changes, arcs.tensions)
            solution = solve_statics(
                smooth, displacements=arriving, gravity=states.gravity, tip_force=states.tip_force, initial=initial,
                settings=self._settings,
            )  # fmt: skip
        else:
            solution = solve_statics(
                smooth, arcs.tensions, gravity=states.gravity, tip_force=states.tip_force, initial=initial,
                settings=self._settings,
            )  # fmt: skip
        if start is None:
            self._last = solution
        return Shapes(solution.positions, solution.rotations, solution.tensions, solution.stable, arcs.bends)


def _lost_displacement(
    bench: Bench, displacements: FloatArray, rest: FloatArray, changes: FloatArray, arriving: FloatArray
) -> FloatArray:
    """Returns the displacement that has the effect of the sheaths' friction, shape (n, t), m; 0 for slack tendons."""
    springs = springs_of(bench.robot)
    driven = rest + springs * (displacements + changes)
    return np.asarray(np.where(driven > 0.0, (arriving - driven) / springs, 0.0))


def _without_friction(robot: RobotSpec) -> RobotSpec:
    tables = [{**table.model_dump(), "friction_coefficient": 0.0} for table in robot.tendon_tables]
    return robot.model_copy(update={"tendons": tables})
