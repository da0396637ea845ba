"""The parameters that a calibration can fit: their names, how open drawings and handbooks leave them, what they do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.errors import InputError, nearest_name
from tdcr_planner.robot.tendons import LARGEST_FRICTION

Apply = Callable[[Bench, FloatArray], Bench]

DESCRIPTIONS = {
    "modulus": "Young's modulus of the backbone: one factor",
    "transmission": "stiffness of the transmission: one factor for the tendons of each segment",
    "friction": "friction coefficient: one for all tendons",
    "pretension": "pretension: one for the tendons of each segment",
    "angles": "angle of each tendon",
    "radii": "distance of each tendon from the backbone",
    "offsets": "displacement of each tendon where its drive reads 0",
    "drift": "growth of all offsets with time",
    "base": "position and orientation of the base in the frame of the measurements",
    "marker": "place of the marker in the last disk's frame",
    "mass": "all masses: one factor",
}
"""Every name that --fit knows, with what it stands for."""


@dataclass(frozen=True)
class Parameter:
    """One number that is fitted: the change of a value, or the logarithm of a factor on it.

    Attributes:
        label: Its name.
        unit: Unit of its value in tables; empty for none.
        factor: That unit in SI units (rad for degrees).
        nominal: Value that the robot's file gives, in the table's unit.
        spread: Standard deviation of the number before anything was measured, SI units.
        is_ratio: Whether the number is the logarithm of a factor.
        lowest: Lowest value of the number.
    """

    label: str
    unit: str
    factor: float
    nominal: float
    spread: float
    is_ratio: bool = False
    lowest: float = -np.inf

    def value(self, number: float) -> float:
        """Returns the value that a number stands for, in the table's unit."""
        return float(self.nominal * np.exp(number)) if self.is_ratio else self.nominal + number / self.factor

    def error(self, number: float, deviation: float) -> float:
        """Returns the standard error of the value, in the table's unit, of that of the number."""
        return abs(self.value(number)) * deviation if self.is_ratio else deviation / self.factor


@dataclass(frozen=True)
class Block:
    """The parameters of one name.

    Attributes:
        name: As --fit has it.
        parameters: k of them.
        moves_robot: Whether the robot's shape depends on them, and not only its place in the frame.
        apply: Puts k numbers onto a bench.
    """

    name: str
    parameters: tuple[Parameter, ...]
    moves_robot: bool
    apply: Apply


def make_blocks(bench: Bench, names: Sequence[str], duration: float) -> tuple[Block, ...]:
    """Returns the blocks of some names, in the order of DESCRIPTIONS.

    Args:
        bench: The bench as the robot's file has it.
        names: Names as in DESCRIPTIONS.
        duration: Of the measurements, s.

    Raises:
        InputError: A name is unknown, appears twice, or has no meaning for this robot.
    """
    check_names(bench, names)
    makers = {
        "modulus": _modulus_block,
        "transmission": _transmission_block,
        "friction": _friction_block,
        "pretension": _pretension_block,
        "angles": _angles_block,
        "radii": _radii_block,
        "offsets": _offsets_block,
        "drift": lambda it: _drift_block(it, duration),
        "base": lambda it: _base_block(it, turns="angles" not in names),
        "marker": _marker_block,
        "mass": _mass_block,
    }
    return tuple(makers[name](bench) for name in DESCRIPTIONS if name in names)


def check_names(bench: Bench, names: Sequence[str]) -> None:
    """Raises InputError unless names are known, each appears once, and each has a meaning for this robot."""
    for name in names:
        if name not in DESCRIPTIONS:
            raise InputError("--fit", nearest_name(name, DESCRIPTIONS), repr(name))
        if list(names).count(name) > 1:
            raise InputError("--fit", "each name once", f"{name!r} twice")
        if not is_meaningful(bench, name):
            raise InputError("--fit", f"names that mean something for this robot ({_NEEDS[name]})", repr(name))


_NEEDS = {
    "offsets": "offsets need [drive] kind = 'displacement'",
    "drift": "a drift needs [drive] kind = 'displacement'",
    "transmission": "a transmission needs [drive] transmission_stiffness_n_m to start from",
}


def is_meaningful(bench: Bench, name: str) -> bool:
    """Returns whether a robot has what a name changes."""
    if name == "transmission":
        return bench.drives_displacement and bool(np.isfinite(bench.robot.drive.transmission_stiffness).all())
    return bench.drives_displacement or name not in _NEEDS


def _tendons(bench: Bench) -> list[str]:
    return [f"tendon {index + 1}" for index in range(bench.robot.tendon_count)]


def _ends(bench: Bench) -> list[int]:
    return sorted({int(index) for index in bench.robot.tendon_segments})


def _first_of(bench: Bench, values: FloatArray) -> list[float]:
    """Returns the value of the first tendon of each segment that has tendons."""
    segments = bench.robot.tendon_segments.tolist()
    return [float(values[segments.index(end)]) for end in _ends(bench)]


def _per_tendon(bench: Bench, values: FloatArray) -> FloatArray:
    """Returns values of the segments that have tendons as values of the tendons."""
    segments = bench.robot.tendon_segments
    return np.asarray(values[np.searchsorted(np.unique(segments), segments)])


def _drive(bench: Bench, key: str, values: FloatArray) -> Bench:
    content: dict[str, Any] = bench.robot.model_dump(exclude_none=True).get("drive", {})
    return bench.with_robot(drive={**content, key: values.tolist()})


def _tables(bench: Bench, key: str, values: FloatArray) -> Bench:
    changed = []
    for table, value in zip(bench.robot.tendon_tables, values, strict=True):
        changed.append({**table.model_dump(), key: float(value)})
    return bench.with_robot(tendons=changed)


def _modulus_block(bench: Bench) -> Block:
    nominal = 1e-9 * bench.robot.backbone.youngs_modulus_pa

    def apply(bench: Bench, values: FloatArray) -> Bench:
        return replace(bench, robot=bench.robot.scaled(stiffness=float(np.exp(values[0]))))

    return Block("modulus", (Parameter("modulus", "GPa", 1e9, nominal, 0.3, is_ratio=True),), True, apply)


def _mass_block(_: Bench) -> Block:
    def apply(bench: Bench, values: FloatArray) -> Bench:
        return replace(bench, robot=bench.robot.scaled(mass=float(np.exp(values[0]))))

    return Block("mass", (Parameter("mass factor", "", 1.0, 1.0, 0.3, is_ratio=True),), True, apply)


def _transmission_block(bench: Bench) -> Block:
    nominal = _first_of(bench, bench.robot.drive.transmission_stiffness)
    parameters = tuple(
        Parameter(f"transmission segment {end + 1}", "N/m", 1.0, value, 0.7, is_ratio=True)
        for end, value in zip(_ends(bench), nominal, strict=True)
    )

    def apply(bench: Bench, values: FloatArray) -> Bench:
        stiffness = bench.robot.drive.transmission_stiffness * np.exp(_per_tendon(bench, values))
        return _drive(bench, "transmission_stiffness_n_m", stiffness)

    return Block("transmission", parameters, True, apply)


def _friction_block(bench: Bench) -> Block:
    nominal = float(np.mean([tendon.friction_coefficient for tendon in bench.robot.tendons]))

    def apply(bench: Bench, values: FloatArray) -> Bench:
        coefficient = min(max(nominal + float(values[0]), 0.0), LARGEST_FRICTION)
        return _tables(bench, "friction_coefficient", np.full(bench.robot.tendon_count, coefficient))

    return Block("friction", (Parameter("friction", "", 1.0, nominal, 0.1, lowest=-nominal),), True, apply)


def _pretension_block(bench: Bench) -> Block:
    nominal = _first_of(bench, bench.robot.drive.pretension)
    parameters = tuple(
        Parameter(f"pretension segment {end + 1}", "N", 1.0, value, 2.0, lowest=-value)
        for end, value in zip(_ends(bench), nominal, strict=True)
    )

    def apply(bench: Bench, values: FloatArray) -> Bench:
        shift = _per_tendon(bench, values)
        changed = _drive(bench, "pretension_n", np.maximum(bench.robot.drive.pretension + shift, 0.0))
        return changed if bench.drives_displacement else replace(changed, pretension_shift=shift)

    return Block("pretension", parameters, True, apply)


def _angles_block(bench: Bench) -> Block:
    parameters = tuple(
        Parameter(f"angle {name}", "deg", np.deg2rad(1.0), float(np.rad2deg(angle)), np.deg2rad(6.0))
        for name, angle in zip(_tendons(bench), bench.robot.tendon_angles, strict=True)
    )

    def apply(bench: Bench, values: FloatArray) -> Bench:
        return _tables(bench, "angle_deg", np.rad2deg(bench.robot.tendon_angles + values))

    return Block("angles", parameters, True, apply)


def _radii_block(bench: Bench) -> Block:
    parameters = tuple(
        Parameter(f"radius {name}", "mm", 1e-3, 1e3 * float(radius), 0.1, is_ratio=True)
        for name, radius in zip(_tendons(bench), bench.robot.tendon_radii, strict=True)
    )

    def apply(bench: Bench, values: FloatArray) -> Bench:
        return _tables(bench, "radius_m", bench.robot.tendon_radii * np.exp(values))

    return Block("radii", parameters, True, apply)


def _offsets_block(bench: Bench) -> Block:
    parameters = tuple(
        Parameter(f"offset {name}", "mm", 1e-3, 1e3 * float(zero), 2e-3)
        for name, zero in zip(_tendons(bench), bench.zeros, strict=True)
    )
    return Block("offsets", parameters, True, lambda it, values: replace(it, zeros=it.zeros + values))


def _drift_block(bench: Bench, duration: float) -> Block:
    unit = 1e-3 / 3600.0
    parameter = Parameter("drift", "mm/h", unit, bench.drift / unit, 1e-3 / max(duration, 1e-3))
    return Block("drift", (parameter,), True, lambda it, values: replace(it, drift=it.drift + float(values[0])))


def _base_block(bench: Bench, *, turns: bool) -> Block:
    """Returns position and rotation; no turn about z where the tendons' angles are fitted, which is the same."""
    axes = "xyz" if turns else "xy"
    parameters = [
        Parameter(f"base position {axis}", "mm", 1e-3, 1e3 * float(value), 0.1)
        for axis, value in zip("xyz", bench.base_position, strict=True)
    ]
    parameters += [
        Parameter(f"base rotation {axis}", "deg", np.deg2rad(1.0), float(np.rad2deg(value)), 0.5)
        for axis, value in zip(axes, bench.base_rotation, strict=False)
    ]

    def apply(bench: Bench, values: FloatArray) -> Bench:
        rotation = bench.base_rotation.copy()
        rotation[: len(axes)] += values[3:]
        return replace(bench, base_position=bench.base_position + values[:3], base_rotation=rotation)

    return Block("base", tuple(parameters), False, apply)


def _marker_block(bench: Bench) -> Block:
    parameters = tuple(
        Parameter(f"marker {axis}", "mm", 1e-3, 1e3 * float(value), 5e-3)
        for axis, value in zip("xyz", bench.marker, strict=True)
    )
    return Block("marker", parameters, False, lambda it, values: replace(it, marker=it.marker + values))
