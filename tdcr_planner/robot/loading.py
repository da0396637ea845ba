"""Reading a robot file, and warning of what no real robot has."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path

from tdcr_planner.files import parse_table, read_toml
from tdcr_planner.plausibility import doubts
from tdcr_planner.robot.spec import RobotSpec

logger = logging.getLogger(__name__)


def load_robot(path: str | Path) -> RobotSpec:
    """Returns the robot that a TOML file describes, of either version.

    What no real robot has, as a value in the wrong unit does, is warned of; see `plausibility.doubts`.

    Raises:
        FormatError: The file is missing or not a robot; every fault is named with its key and what would be valid.
    """
    robot = parse_table(RobotSpec, read_toml(path), path)
    for doubt in doubts(robot):
        _warn_once(f"{path}: {doubt}")
    return robot


@cache
def _warn_once(text: str) -> None:
    """Logs a warning that this process has not seen yet: a robot's file is read once a query."""
    logger.warning(text)
