"""Rotations of disks of which only the centres are known: along the curve through them, without twist."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray

_FEWEST = 3  # centres up to which the curve's free end is straight
_BACKWARDS = -1.0 + 1e-9  # cosine of two tangents beyond which no turn without twist is defined


def rotations_along(arc_lengths: FloatArray, positions: FloatArray) -> FloatArray:
    """Returns rotations whose z axes are the tangents and that do not twist about them (Bishop 1975).

    The tangents are those of the cubic spline through the centres that leaves the base along its z axis. Each frame is
    the one before it, turned by the smallest rotation between their tangents.

    Args:
        arc_lengths: Shape (d,), m.
        positions: Shape (n, d, 3), m, base frame.

    Returns:
        Shape (n, d, 3, 3); NaN where positions are.
    """
    # Imported where it is needed: every model file leads here, few need it.
    from scipy.interpolate import CubicSpline

    count, disks = positions.shape[:2]
    rotations = np.full((count, disks, 3, 3), np.nan)
    known = np.isfinite(positions).all(axis=(1, 2))
    if not known.any():
        return rotations
    start = np.zeros((int(known.sum()), 3))
    start[:, 2] = 1.0
    end = "not-a-knot" if disks > _FEWEST else (2, np.zeros_like(start))
    spline = CubicSpline(arc_lengths, positions[known], axis=1, bc_type=((1, start), end))
    tangents = spline(arc_lengths, 1)
    tangents = tangents / np.linalg.norm(tangents, axis=2, keepdims=True)
    frames = np.empty((len(tangents), disks, 3, 3))
    frames[:, 0] = np.eye(3)
    for disk in range(1, disks):
        frames[:, disk] = _smallest_turns(frames[:, disk - 1, :, 2], tangents[:, disk]) @ frames[:, disk - 1]
    rotations[known] = frames
    return rotations


def _smallest_turns(first: FloatArray, second: FloatArray) -> FloatArray:
    """Returns the smallest rotations that take unit vectors (n, 3) to others, shape (n, 3, 3)."""
    axis = np.cross(first, second)
    cosine = np.maximum((first * second).sum(axis=1), _BACKWARDS)
    x, y, z = axis.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + skew + skew @ skew / (1.0 + cosine)[:, None, None]
