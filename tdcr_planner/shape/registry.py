"""The shape models by the name that files use: this package's and those that installed packages register."""

from __future__ import annotations

from typing import Any

from tdcr_planner.errors import InputError
from tdcr_planner.registry import Registry
from tdcr_planner.shape.base import ShapeModel

GROUP = "tdcr_planner.shape_models"


def _check_shape_model(name: str, found: Any) -> type[ShapeModel]:
    if not (isinstance(found, type) and issubclass(found, ShapeModel)):
        raise InputError(f"shape model {name!r}", "a subclass of tdcr_planner.shape.base.ShapeModel", repr(found))
    if found.name != name:
        raise InputError(f"shape model {name!r}", "a class whose `name` is the entry point's", repr(found.name))
    return found


SHAPE_MODELS: Registry[type[ShapeModel]] = Registry(
    "shape model",
    built_in={
        "learned": "tdcr_planner.shape.learned:LearnedShape",
        "reference": "tdcr_planner.shape.reference:ReferenceShape",
        "constant_curvature": "tdcr_planner.shape.constant_curvature:ConstantCurvatureShape",
    },
    check=_check_shape_model,
    group=GROUP,
)
