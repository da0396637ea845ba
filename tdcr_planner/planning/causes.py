"""Why configurations and edges are rejected, and the codes that stand for it."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.collision.scene import Verdict

Codes = NDArray[np.int8]


class Cause(StrEnum):
    """Why a configuration or an edge is rejected."""

    OBSTACLE = "obstacle"
    CAVITY = "cavity"
    SELF_COLLISION = "self_collision"
    NOT_FINITE = "nan"
    TENSION_LIMIT = "tension_limit"
    MODEL_DOMAIN = "model_domain"
    NO_SHAPE = "statics"
    TENDON_DISPLACEMENT = "tendon_displacement"
    STRAIN = "strain"
    RULED_OUT = "ruled_out"
    EDGE = "edge"

    @property
    def code(self) -> int:
        """The code of this cause in what `ValidityChecker.check` returns; 0 stands for a valid state."""
        return _CODES[self]


_VERDICTS = {
    Cause.OBSTACLE: Verdict.OBSTACLE,
    Cause.CAVITY: Verdict.CAVITY,
    Cause.SELF_COLLISION: Verdict.SELF,
    Cause.NOT_FINITE: Verdict.UNDEFINED,
}
_OTHERS = [cause for cause in Cause if cause not in _VERDICTS]
# The scene's verdicts keep their codes; the causes that it does not know follow them.
_CODES = {cause: int(verdict) for cause, verdict in _VERDICTS.items()} | {
    cause: max(Verdict) + number for number, cause in enumerate(_OTHERS, start=1)
}
CAUSES = tuple(sorted(_CODES, key=lambda cause: _CODES[cause]))
"""The causes in the order of their codes, of which the first is 1."""
