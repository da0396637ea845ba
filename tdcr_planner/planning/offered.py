"""The planners on offer: which OMPL planners can be named, their parameters, and why others are refused."""

from __future__ import annotations

import inspect
import re
from typing import Any

import numpy as np

from tdcr_planner.errors import InputError, MissingLibraryError, UnknownNameError

PLANNERS: tuple[str, ...] = (
    "RRTConnect",
    "RRT",
    "RRTstar",
    "InformedRRTstar",
    "SORRTstar",
    "AORRTC",
    "BITstar",
    "FMT",
    "BFMT",
    "KPIECE1",
    "BKPIECE1",
    "LBKPIECE1",
)
# Those whose search ends at the first path and whose luck rests on their first samples; see docs/planning.md.
RENEWED = frozenset({"RRTConnect", "RRT", "KPIECE1", "BKPIECE1"})
FIRST_TREE = 512
"""Iterations after which they start again, twice as many each time."""
IMPROVING = frozenset({"RRTstar", "InformedRRTstar", "SORRTstar", "AORRTC", "BITstar"})
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


def planner_parameters(name: str) -> dict[str, type]:
    """Returns the parameters of a planner with their types, by name (OMPL's setters in snake case).

    Raises:
        InputError: The planner is not offered; the message names those that are, and why an OMPL planner is refused.
    """
    check_planner(name)
    return {key: kind for key, (_, kind) in planner_setters(name).items()}


def check_planner(name: str, parameters: dict[str, Any] | None = None) -> None:
    """Raises InputError unless a planner of that name is offered and has those parameters."""
    if name not in PLANNERS:
        reason = f" (OMPL has {name}, but {REFUSED[name]})" if name in REFUSED else ""
        raise UnknownNameError("planner.name", name, PLANNERS, reason)
    if not parameters:
        return
    known = {**planner_parameters(name), **COMMON_PARAMETERS}
    for key, value in parameters.items():
        if key not in known:
            raise UnknownNameError(f"planner.parameters of {name}", key, known)
        convert_parameter(key, value, known[key])


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


def convert_parameter(key: str, value: Any, kind: type) -> Any:
    """Returns a parameter's value as the type that its setter takes."""
    if kind is bool and isinstance(value, bool):
        return value
    if kind is int and isinstance(value, int) and not isinstance(value, bool) and value >= 0:
        return value
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value):
        return float(value)
    wanted = {bool: "true or false", int: "a whole number of 0 or more", float: "a finite number"}[kind]
    raise InputError(f"planner.parameters.{key}", wanted, repr(value))
