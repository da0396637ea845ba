"""The body between disks, as collision sees it."""

from __future__ import annotations

from typing import Literal

from tdcr_planner.files import FileModel, Positive


class Body(FileModel):
    """What stands between two disks when collision is tested.

    Attributes:
        between_disks: "backbone", "tendons" (backbone and tendons) or "sleeve" (a tube of the disks' radius).
        tendon_radius_m: Radius of a tendon.
    """

    between_disks: Literal["backbone", "tendons", "sleeve"] = "tendons"
    tendon_radius_m: Positive = 0.0002
