"""The two versions of the robot file: which keys belong to which, and what replaces a key of version 1."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from tdcr_planner.files import FileModel
from tdcr_planner.robot.backbone import Backbone
from tdcr_planner.robot.faults import Faults, Place
from tdcr_planner.robot.segments import Segment
from tdcr_planner.robot.tip import Tip

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec

VERSION_1, VERSION_2 = "tdcr-robot/1", "tdcr-robot/2"
_FILE_KEYS = {"tendon_tables": "tendons", "drive_table": "drive"}
_TOP_ONLY_VERSION_2 = ("tendons", "drive", "camera")


def check_version(robot: RobotSpec) -> None:
    """Raises pydantic's ValidationError with every key that the file's version does not have, or misses."""
    faults = Faults()
    if robot.format == VERSION_1:
        for field in robot.model_fields_set:
            key = _FILE_KEYS.get(field, field)
            if key in _TOP_ONLY_VERSION_2:
                faults.add((key,), _NEEDS_VERSION_2)
        for place, table, keys in _tables(robot):
            for key in keys:
                if key in table.model_fields_set:
                    faults.add((*place, key), _NEEDS_VERSION_2)
    for index, segment in enumerate(robot.segments):
        if robot.format == VERSION_1:
            for key in Segment.required_in_version_1:
                if getattr(segment, key) is None:
                    faults.add(("segments", index, key), "missing, and it is required")
        else:
            for key, replacement in Segment.only_version_1.items():
                if key in segment.model_fields_set:
                    faults.add(
                        ("segments", index, key), f'a key of format = "{VERSION_1}"; in this version {replacement}'
                    )
    faults.raise_if_any("RobotSpec")


_NEEDS_VERSION_2 = f'a key of format = "{VERSION_2}", and this file says "{VERSION_1}"'


def _tables(robot: RobotSpec) -> Iterator[tuple[Place, FileModel, tuple[str, ...]]]:
    """Yields the tables that both versions have, with the keys that version 2 adds to them."""
    yield ("backbone",), robot.backbone, Backbone.only_version_2
    yield ("tip",), robot.tip, Tip.only_version_2
    for index, segment in enumerate(robot.segments):
        yield ("segments", index), segment, Segment.only_version_2
        if segment.backbone is not None:
            yield ("segments", index, "backbone"), segment.backbone, Backbone.only_version_2


def without_other_version(content: dict[str, Any], version: str) -> dict[str, Any]:
    """Returns a dumped robot under its file's keys, without the keys of the other version.

    Args:
        content: What pydantic makes of a robot; some of it may be left out.
        version: The robot's format.
    """
    renamed = {_FILE_KEYS.get(key, key): value for key, value in content.items()}
    if version == VERSION_2:
        drop = tuple(Segment.only_version_1)
        return {
            key: type(value)(_without(segment, drop) for segment in value) if key == "segments" else value
            for key, value in renamed.items()
        }
    kept = _without(renamed, _TOP_ONLY_VERSION_2)
    for key, keys in (("backbone", Backbone.only_version_2), ("tip", Tip.only_version_2)):
        if key in kept:
            kept[key] = _without(kept[key], keys)
    if "segments" in kept:
        kept["segments"] = type(kept["segments"])(_segment_of_version_1(segment) for segment in kept["segments"])
    return kept


def _segment_of_version_1(segment: dict[str, Any]) -> dict[str, Any]:
    kept = _without(segment, Segment.only_version_2)
    if kept.get("backbone") is not None:
        kept["backbone"] = _without(kept["backbone"], Backbone.only_version_2)
    return kept


def _without(table: dict[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key not in keys}
