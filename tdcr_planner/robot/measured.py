"""What was measured of a robot on a test bench: how it stood there, and how far its disks lie from its model."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tdcr_planner.files import Count, FileModel, NotNegative, Vector3


class MeasuredError(FileModel):
    """How far disks of the real robot lie from those of the model, from measured states that were held out.

    Attributes:
        level: Probability with which a state's disk lies within the distance.
        disks_m: The distance of each disk, the base included, m.
        states: Held-out states from which it comes.
    """

    level: Annotated[float, Field(gt=0.0, lt=1.0)]
    disks_m: tuple[NotNegative, ...]
    states: Count


class BenchTable(FileModel):
    """How the robot stood and was driven when it was measured; no part of its mechanics.

    Attributes:
        data: Name of the measurements' file.
        data_sha256: SHA-256 of its bytes.
        base_position_m: Origin of the base in the frame of the measurements.
        base_rotation_rad: Rotation vector of the base there.
        marker_m: Place of the marker in the last disk's frame.
        displacement_offset_m: Displacement of each tendon where the drive reads 0; empty with tension drive.
        displacement_drift_m_s: Growth of all offsets with time.
        time_s: Time in the measurements' file at which the offsets hold.
    """

    data: str
    data_sha256: str
    base_position_m: Vector3 = (0.0, 0.0, 0.0)
    base_rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    marker_m: Vector3 = (0.0, 0.0, 0.0)
    displacement_offset_m: tuple[float, ...] = ()
    displacement_drift_m_s: float = 0.0
    time_s: float = 0.0
