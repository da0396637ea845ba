"""OMPL's planners: which can be named, what the search must know of each, their parameters, why others are refused."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass

from tdcr_planner.errors import MissingLibraryError

FIRST_TREE = 512
"""Iterations after which planners that begin anew do so, twice as many each time."""


@dataclass(frozen=True)
class OmplTraits:
    """What the search must know of an OMPL planner; see docs/planning.md.

    Attributes:
        begins_anew: Its search ends at the first path and its luck rests on its first samples.
        improves: It goes on improving its path until the time is over.
        single_shot: It draws all of its samples at once and ends with them.
        chatty: It logs as an error that its first path is the straight one, which it cannot improve.
        keeps_valid_part: It keeps the valid part of a motion, which the binding gives it no way to ask about.
    """

    begins_anew: bool = False
    improves: bool = False
    single_shot: bool = False
    chatty: bool = False
    keeps_valid_part: bool = False


OMPL_TRAITS: dict[str, OmplTraits] = {
    "RRTConnect": OmplTraits(begins_anew=True),
    "RRT": OmplTraits(begins_anew=True),
    "RRTstar": OmplTraits(improves=True),
    "InformedRRTstar": OmplTraits(improves=True),
    "SORRTstar": OmplTraits(improves=True),
    "AORRTC": OmplTraits(improves=True, chatty=True),
    "BITstar": OmplTraits(improves=True),
    "FMT": OmplTraits(single_shot=True),
    "BFMT": OmplTraits(single_shot=True),
    "KPIECE1": OmplTraits(begins_anew=True, keeps_valid_part=True),
    "BKPIECE1": OmplTraits(begins_anew=True),
    "LBKPIECE1": OmplTraits(),
}
# What every planner takes besides its own: an end by iterations, and what is tried before it.
COMMON_PARAMETERS: dict[str, type] = {"iterations": int, "plain_motions": bool, "retraction": bool}
REFUSED: dict[str, str] = {
    "PRM": "it runs a second thread, in which an exception or Ctrl-C ends the process",
    "PRMstar": "it runs a second thread, in which an exception or Ctrl-C ends the process",
    **dict.fromkeys(
        ("LazyPRM", "LazyPRMstar", "AITstar", "EITstar", "EST", "BiEST", "SST", "TRRT", "STRIDE", "CForest", "SPARS"),
        "OMPL's Python bindings do not have it",
    ),
}
_NOT_PARAMETERS = {"setName"}


def require_ompl() -> None:
    """Raises MissingLibraryError where OMPL is not installed, as on systems for which it has no wheels."""
    try:
        import ompl  # noqa: F401
    except ImportError as error:
        raise MissingLibraryError(
            "ompl", "to search paths", "Linux (x86_64, arm64) and macOS 15 or newer (arm64), Python 3.11 to 3.13"
        ) from error


def planner_setters(name: str) -> dict[str, tuple[str, type]]:
    """Returns the setter and the type of each parameter of a planner by its name in snake case.

    Types come from the signatures that the binding writes into docstrings: a getter called before `setup` can crash.
    """
    require_ompl()
    from ompl import geometric

    found = {}
    for setter, method in inspect.getmembers(getattr(geometric, name)):
        signature = re.match(r"set[A-Z]\w*\(self, \w+: (bool|int|float)\)", method.__doc__ or "")
        if signature and setter not in _NOT_PARAMETERS:
            key = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", setter[3:]).lower()
            found[key] = (setter, {"bool": bool, "int": int, "float": float}[signature[1]])
    return found
