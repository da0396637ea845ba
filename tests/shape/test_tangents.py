"""Rotations along a curve of known centres."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_planner.shape.tangents import rotations_along


def test_an_arc_has_the_frames_of_its_turns() -> None:
    s = np.linspace(0.0, 0.2, 81)
    u = 6.0
    positions = np.stack([(1 - np.cos(u * s)) / u, np.zeros_like(s), np.sin(u * s) / u], axis=1)
    frames = rotations_along(s, positions[None])[0]
    exact = Rotation.from_rotvec(np.outer(u * s, [0.0, 1.0, 0.0])).as_matrix()
    # The spline's slope errs by (u h)^3 / 24, h = 2.5 mm.
    np.testing.assert_allclose(frames, exact, atol=1e-6)


def test_frames_do_not_twist() -> None:
    s = np.linspace(0.0, 1.0, 201)
    positions = np.stack([0.1 * (1 - np.cos(3 * s)), 0.1 * (3 * s - np.sin(3 * s)), s], axis=1)
    frames = rotations_along(s, positions[None])[0]
    np.testing.assert_allclose(
        np.swapaxes(frames, -1, -2) @ frames, np.broadcast_to(np.eye(3), frames.shape), atol=1e-12
    )
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], -1, -2) @ frames[1:]).as_rotvec() / np.diff(s)[:, None]
    assert np.abs(turns[:, 2]).max() < 1e-2 * np.abs(turns).max()


def test_centres_that_are_not_finite_have_no_rotations() -> None:
    positions = np.zeros((2, 3, 3))
    positions[:, :, 2] = [0.0, 0.1, 0.2]
    positions[1, 1, 0] = np.nan
    frames = rotations_along(np.array([0.0, 0.1, 0.2]), positions)
    np.testing.assert_allclose(frames[0], np.broadcast_to(np.eye(3), (3, 3, 3)), atol=1e-12)
    assert np.isnan(frames[1]).all()
