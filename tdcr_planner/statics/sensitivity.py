"""Derivatives of disk poses with respect to tensions and loads, from the variational equations of the rod."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import skew
from tdcr_planner.statics.batch import variations_of_cases
from tdcr_planner.statics.drive_settings import drive_arrays
from tdcr_planner.statics.profile import record_solution, solved_rod
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.solution import RodSolution
from tdcr_planner.statics.tendons import tendon_lengths


@dataclass(frozen=True)
class PoseDerivative:
    """Derivatives of n shapes with respect to k parameters of one kind; NaN where there is no equilibrium.

    Attributes:
        positions: Of disk centres, shape (n, d, 3, k), m per unit, base frame.
        rotations: Of disk rotations as the vector theta with dR = [theta]x R, shape (n, d, 3, k), rad per unit, base
            frame.
        base_moment: Of the moment across the cut at the base, shape (n, 3, k), N m per unit, base frame.
    """

    positions: FloatArray
    rotations: FloatArray
    base_moment: FloatArray

    def rotation_matrices(self, solution: RodSolution) -> FloatArray:
        """Returns the derivatives of the rotation matrices, shape (n, d, 3, 3, k)."""
        turned = skew(np.moveaxis(self.rotations, 3, 2)) @ solution.rotations[:, :, None]
        return np.moveaxis(turned, 2, 4)


@dataclass(frozen=True)
class StaticsJacobian:
    """Derivatives of a batch of shapes, one `PoseDerivative` for each kind of parameter.

    Attributes:
        tensions: k = t, per N.
        gravity: k = 3, per m/s^2.
        tip_force: k = 3, per N.
        tip_moment: k = 3, per N m.
        distributed_force: k = 3, per N/m.
        disk_forces: k = 3 d, per N, x y z of disk 0, then of disk 1 and so on; None where not asked for.
        displacements: k = t, per m; None where tensions were given. Zero for slack tendons.

    Where displacements were given, the loads' derivatives hold the displacements, and `tensions` holds the loads and
    the other tensions.
    """

    tensions: PoseDerivative
    gravity: PoseDerivative
    tip_force: PoseDerivative
    tip_moment: PoseDerivative
    distributed_force: PoseDerivative
    disk_forces: PoseDerivative | None
    displacements: PoseDerivative | None = None


def statics_jacobian(robot: RobotSpec, solution: RodSolution, *, with_disk_forces: bool = False) -> StaticsJacobian:
    """Returns the derivatives of solved shapes with respect to tensions and loads.

    The variational equations of the rod are integrated with the integrator's own stages, and the boundary condition
    M(l) = M_tip gives how M(0) follows (implicit function theorem). No differences are taken; like the shapes, the
    derivatives are of fourth order in the step. At an equilibrium without a derivative (a buckling load) they are
    huge or infinite.

    Args:
        robot: The robot that was solved.
        solution: Its solution.
        with_disk_forces: Whether to return derivatives with respect to a force at each disk as well.
    """
    if solution.pulls is not None:
        raise InputError(
            "solution", "a solution without friction (with it derivatives depend on the history)", "one with"
        )
    rod = solved_rod(robot, solution)
    profiles = _force_profiles(rod, with_disk_forces)
    count, disks, tendons = len(solution.tensions), robot.disk_count, robot.tendon_count
    columns = 3 + tendons + 3 * len(profiles)
    at_disks = np.full((count, disks, 6, columns), np.nan)
    end = np.full((count, 3, columns), np.nan)
    record = record_solution(rod, solution)
    lengths = np.full((count, tendons, columns), np.nan)
    variations_of_cases(rod, solution.tensions, solution.converged, record, profiles, at_disks, end, lengths)
    _subtract_payload(rod, solution, at_disks, end)
    # delta M(l) = B dM(0) + (parameters) - dM_tip = 0, so dM(0) = B^-1 (dM_tip - parameters).
    changes = np.concatenate([-end[:, :, 3:], np.tile(np.eye(3), (count, 1, 1))], axis=2)
    base = np.full_like(changes, np.nan)
    found = np.flatnonzero(solution.converged)
    base[found] = np.linalg.solve(end[found, :, :3], changes[found])
    poses = at_disks[..., :3] @ base[:, None]
    poses[..., : columns - 3] += at_disks[..., 3:]
    held_poses = held_base = None
    if solution.displacements is not None:
        follows = lengths[..., :3] @ base
        follows[..., : columns - 3] += lengths[..., 3:]
        pulls = _tension_changes(robot, rod, solution, follows)
        held_poses = poses[..., :tendons] @ pulls[:, None, :, :tendons]
        held_base = base[..., :tendons] @ pulls[:, :, :tendons]
        poses[..., tendons:] += poses[..., :tendons] @ pulls[:, None, :, tendons:]
        base[..., tendons:] += base[..., :tendons] @ pulls[:, :, tendons:]

    def part(start: int, width: int) -> PoseDerivative:
        chosen = slice(start, start + width)
        return PoseDerivative(poses[:, :, 3:, chosen], poses[:, :, :3, chosen], base[:, :, chosen])

    return StaticsJacobian(
        tensions=part(0, tendons),
        gravity=part(tendons, 3),
        tip_force=part(tendons + 3, 3),
        distributed_force=part(tendons + 6, 3),
        disk_forces=part(tendons + 9, 3 * disks) if with_disk_forces else None,
        tip_moment=part(columns - 3, 3),
        displacements=None
        if held_poses is None or held_base is None
        else PoseDerivative(held_poses[:, :, 3:], held_poses[:, :, :3], held_base),
    )


def _tension_changes(robot: RobotSpec, rod: RodArrays, solution: RodSolution, length_rates: FloatArray) -> FloatArray:
    """Returns how the tensions follow the displacements, and the loads at held displacements; taut tendons only.

    0 = d gap = dq + (1 - tau / EA) dl - (1/k + l / EA) d tau, with dl by the tensions and by the loads.

    Args:
        robot: The robot.
        rod: Its arrays.
        solution: The solution.
        length_rates: Derivative of the path lengths by tensions and loads, shape (n, t, t + k), at M(l) = M_tip.

    Returns:
        Shape (n, t, t + k), by displacements and loads.
    """
    tendons = solution.tensions.shape[1]
    drive, path = drive_arrays(robot, rod), tendon_lengths(robot, solution)
    changes = np.full_like(length_rates, np.nan)
    for case in np.flatnonzero(solution.converged):
        taut = np.flatnonzero(solution.tensions[case] > 0.0)
        rates = (1.0 - solution.tensions[case] * drive.stretch)[:, None] * length_rates[case]
        compliance = np.diag(drive.compliance + path[case] * drive.stretch) - rates[:, :tendons]
        right = np.concatenate([np.eye(tendons), rates[:, tendons:]], axis=1)
        changes[case] = 0.0
        changes[case, taut] = np.linalg.solve(compliance[np.ix_(taut, taut)], right[taut])
    return changes


def _subtract_payload(rod: RodArrays, solution: RodSolution, at_disks: FloatArray, end: FloatArray) -> None:
    """Takes the moment (R a) x m g of a payload off the axis from the variations of M(l)."""
    lever = solution.rotations[:, -1] @ rod.payload[1:]
    turned = np.cross(at_disks[:, -1, :3], lever[:, :, None], axis=1)
    end -= np.cross(turned, (rod.payload[0] * solution.loads.gravity)[:, :, None], axis=1)
    gravity = 3 + rod.tendons.shape[1]
    end[:, :, gravity : gravity + 3] -= rod.payload[0] * skew(lever)


def _force_profiles(rod: RodArrays, with_disk_forces: bool) -> FloatArray:
    """Returns the force across the cut at each stage point for a unit of each family of forces.

    Families: gravity, tip force, distributed force, and where asked for the force at each disk.

    Returns:
        Shape (families, c, 3).
    """
    steps, disks = len(rod.step_lengths), len(rod.disk_masses)
    ends_at = np.where(rod.step_disks >= 0, rod.step_disks, 0)
    point_masses = np.where(rod.step_disks >= 0, rod.disk_masses[ends_at], 0.0)
    along = np.insert(rod.step_masses, 0, 0.0, axis=1)
    profiles = np.zeros((3 + (disks if with_disk_forces else 0), steps, 3))
    profiles[0] = np.cumsum((point_masses + rod.step_masses[:, 1])[::-1])[::-1][:, None] - along
    profiles[1] = 1.0
    profiles[2] = np.cumsum(rod.step_lengths[::-1])[::-1][:, None] - rod.step_lengths[:, None] * [0.0, 0.5, 1.0]
    if with_disk_forces:
        last_step = np.array([-1, *np.flatnonzero(rod.step_disks >= 0)])
        profiles[3:] = (np.arange(steps)[None, :] <= last_step[:, None])[..., None]
    return profiles
