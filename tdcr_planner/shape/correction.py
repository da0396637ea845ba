"""One step of correction by mechanics: the shape that a shape's own loads would give, and how far it is from rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.rod_kernel import RodConstants, integrate_poses, rod_constants

_DIFFERENCE = 1e-7  # N m, as in `rod_kernel.tip_residual_jacobian`
# Below it, as a part of the moment that the loads can exert, a shape is at rest within the integration's rounding.
_AT_REST = 1e-12
# A step of the base moment beyond this part of the moment that the loads can exert is no small correction.
_LONGEST_STEP = 2.0


Inputs = tuple[FloatArray, FloatArray, FloatArray]
"""Tensions (n, t) N, gravity (n, 3) m/s^2 and tip force (n, 3) N."""


@dataclass(frozen=True)
class Correction:
    """Shapes after one step.

    Attributes:
        positions: Shape (n, d, 3), m, base frame.
        rotations: Shape (n, d, 3, 3).
        residual: Moment left over at the tip, shape (n,), N m.
        remainder: How far the next step would move any point of each disk, shape (n, d), m, to first order.
    """

    positions: FloatArray
    rotations: FloatArray
    residual: FloatArray
    remainder: FloatArray


class Corrector:
    """Corrects shapes of a robot by the cut form of its equilibrium."""

    def __init__(self, robot: RobotSpec) -> None:
        """Prepares the rod's constants."""
        self._radii = robot.disk_radii
        self._length = robot.length
        self._constants: RodConstants = rod_constants(robot)

    def base_moments(self, positions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> FloatArray:
        """Returns the moment that the loads exert about the base of given shapes, shape (n, 3), N m, base frame.

        M(0) = sum p_k x m_k g + integral rho A p x g ds + p(l) x f, the equilibrium of moments of the whole rod beyond
        the clamp; the integral by the trapezoidal rule between disks.
        """
        gaps = self._constants.gaps
        line = gaps[:, 0] * gaps[:, 10]
        # Half of each gap's line mass at its two ends, and the disk's mass at its far one.
        mass = np.zeros(len(gaps) + 1)
        mass[:-1] += 0.5 * line
        mass[1:] += 0.5 * line + gaps[:, 11]
        centre = np.einsum("k,nka->na", mass, positions)
        return np.asarray(np.cross(centre, gravity) + np.cross(positions[:, -1], tip_force))

    def correct(
        self, positions: FloatArray, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
    ) -> Correction:
        """Returns shapes after one Newton step on the moment left over at the tip.

        The base moment follows from the shape, one integration measures what it leaves over at the tip, three more its
        derivative, and a last one gives the corrected shape.

        Args:
            positions: The shapes to correct, shape (n, d, 3), m, base frame.
            tensions: Shape (n, t), N.
            gravity: Shape (n, 3), m/s^2, base frame.
            tip_force: Shape (n, 3), N, base frame.
        """
        inputs = _contiguous(tensions, gravity, tip_force)
        size = self._largest_moments(gravity, tip_force)
        moment = _shortened(self.base_moments(positions, gravity, tip_force), size)
        p, rotation, left_over = self._integrate(inputs, moment)
        residual = np.linalg.norm(left_over, axis=1)
        remainder = np.zeros(positions.shape[:2])
        moving = np.flatnonzero(~(residual <= _AT_REST * np.maximum(size, 1e-6)))
        if len(moving):
            part = tensions[moving], gravity[moving], tip_force[moving]
            start = moment[moving], p[moving], rotation[moving], left_over[moving]
            corrected = self._step(part, *start, _LONGEST_STEP * np.maximum(size[moving], 1e-6))
            p[moving], rotation[moving], residual[moving], remainder[moving] = corrected
        return Correction(p, rotation, residual, remainder)

    def _largest_moments(self, gravity: FloatArray, tip_force: FloatArray) -> FloatArray:
        """Returns the moment that loads exert about the base at most, shape (n,), N m."""
        weight = self._constants.base_mass * np.linalg.norm(gravity, axis=1)
        return np.asarray(self._length * (weight + np.linalg.norm(tip_force, axis=1)))

    def _integrate(self, inputs: Inputs, moment: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        tensions, gravity, tip_force = inputs
        return integrate_poses(self._constants, tensions, gravity, tip_force, moment)

    def _step(
        self,
        inputs: Inputs,
        moment: FloatArray,
        positions: FloatArray,
        rotations: FloatArray,
        left_over: FloatArray,
        longest: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Returns positions, rotations, residual and remainder after one Newton step."""
        count = len(moment)
        moments = np.tile(moment, (3, 1))
        for axis in range(3):
            moments[axis * count : (axis + 1) * count, axis] += _DIFFERENCE
        tensions, gravity, tip_force = (np.tile(array, (3, 1)) for array in inputs)
        tiled = tensions, gravity, tip_force
        moved, turned, residuals = self._integrate(tiled, moments)
        jacobian = np.stack(
            [(residuals[axis * count : (axis + 1) * count] - left_over) / _DIFFERENCE for axis in range(3)], axis=2
        )
        step = _solve(jacobian, left_over)
        step = _shortened(step, longest)
        p, rotation, after = self._integrate(inputs, moment - step)
        ahead = _solve(jacobian, after)
        slope = (moved.reshape(3, count, -1, 3) - positions) / _DIFFERENCE
        # Rotation vectors of R' R^T to first order, from its skew part.
        change = turned.reshape(3, count, -1, 3, 3) @ np.swapaxes(rotations, -1, -2)
        turn = 0.5 * np.stack(
            [
                change[..., 2, 1] - change[..., 1, 2],
                change[..., 0, 2] - change[..., 2, 0],
                change[..., 1, 0] - change[..., 0, 1],
            ],
            axis=-1,
        ) / _DIFFERENCE  # fmt: skip
        moves = np.linalg.norm(np.einsum("andk,na->ndk", slope, ahead), axis=2)
        turns = np.linalg.norm(np.einsum("andk,na->ndk", turn, ahead), axis=2)
        return p, rotation, np.linalg.norm(after, axis=1), moves + self._radii * turns

    def scale(self, positions: FloatArray, rotations: FloatArray, step: Correction) -> FloatArray:
        """Returns how far one step moved any point of each disk, and the next one would move it, shape (n, d), m.

        It is measured as errors are: the distance of the centres plus disk radius times the chord of the rotation.
        """
        chord = 2.0 * np.sin(0.5 * rotation_distance(rotations, step.rotations))
        moved = np.linalg.norm(positions - step.positions, axis=2) + self._radii * chord
        return np.asarray(moved + step.remainder)


def _contiguous(tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> Inputs:
    return np.ascontiguousarray(tensions), np.ascontiguousarray(gravity), np.ascontiguousarray(tip_force)


def _shortened(vectors: FloatArray, longest: FloatArray) -> FloatArray:
    """Returns vectors (n, 3) of no more than some lengths (n,); zero for those that are not finite."""
    size = np.linalg.norm(vectors, axis=1)
    known = np.isfinite(size) & (size > 0.0)
    factor = np.zeros(len(size))
    factor[known] = np.minimum(longest[known] / size[known], 1.0)
    return np.ascontiguousarray(np.where(known[:, None], vectors, 0.0) * factor[:, None])


def _solve(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Returns the solutions of small systems, NaN where a matrix has no inverse or is not finite."""
    found = np.full_like(vectors, np.nan)
    with np.errstate(invalid="ignore", over="ignore"):
        good = np.isfinite(matrices).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(matrices))) > 1e-12)
    if good.any():
        found[good] = np.linalg.solve(matrices[good], vectors[good][..., None])[..., 0]
    return found
