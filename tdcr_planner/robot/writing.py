"""Writing a robot back to its TOML file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from tdcr_planner.files import write_file_whole

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def format_robot(robot: RobotSpec, comment: str = "") -> str:
    """Returns a robot as the TOML text of its file, from which it reads back equal.

    Args:
        robot: The robot, of either version.
        comment: What stands above it, for people; may have several lines.
    """
    content: dict[str, Any] = robot.model_dump(exclude_none=True)
    lines = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    return lines + tomli_w.dumps(content)


def write_robot(robot: RobotSpec, path: str | Path, comment: str = "") -> None:
    """Writes a robot to a file, whole or not at all; see `format_robot`."""
    with write_file_whole(path) as temporary:
        temporary.write_text(format_robot(robot, comment), encoding="utf-8")
