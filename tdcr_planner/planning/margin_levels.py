"""The margins of states whose error bound follows the state: a few levels, each a scene with its body grown by it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import FloatArray

Levels = NDArray[np.int8]

# Parts of the largest bound; a state keeps the smallest that covers its own bound at every disk.
FRACTIONS = np.array([0.0, 0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.125, 0.15, 0.18, 0.22, 0.27, 0.33, 0.4, 0.5, 0.7, 1.0])
_LEAST_M = 1e-5  # the lowest level's bound at every disk
_ROUNDING = 1e-12


class MarginLevels:
    """Scenes grown by the levels of a bound that follows the state, each made when a state first needs it."""

    def __init__(self, scene: Any, base: FloatArray, error_bound: FloatArray) -> None:
        """Prepares the levels.

        Args:
            scene: The scene; see `tdcr_planner.collision.scene.CollisionScene`.
            base: What each disk keeps besides the bound, shape (d,), m.
            error_bound: The largest bound of each disk, shape (d,), m.
        """
        self._scene = scene
        self._margins = [
            base + np.minimum(np.maximum(fraction * error_bound, _LEAST_M), error_bound) for fraction in FRACTIONS
        ]
        self._bounds = np.stack([margins - base for margins in self._margins])

    def of(self, bounds: FloatArray) -> Levels:
        """Returns the lowest level that covers each state's bound at every disk, shape (n,).

        Args:
            bounds: Shape (n, d), m; none above the largest bound.
        """
        covered = np.asarray((bounds[:, None] <= self._bounds + _ROUNDING).all(axis=2))
        covered[:, -1] = True
        return np.argmax(covered, axis=1).astype(np.int8)

    def bound(self, level: int) -> FloatArray:
        """Returns the bound of a level, shape (d,), m."""
        return np.asarray(self._bounds[level])

    def scene(self, level: int) -> Any:
        """Returns the scene whose body is grown by a level's margins."""
        return self._scene.with_margins(self._margins[level])
