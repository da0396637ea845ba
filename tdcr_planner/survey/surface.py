"""What a surface is: its pieces, openings and faults, and how large it is in each unit of length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.meshes import METRES_PER_UNIT
from tdcr_planner.collision.topology import Loop, analyse, clean_mesh

SMALLEST_OPENING = 0.5
"""An opening of less than this many diameters of the robot is a hole in the mesh, no mouth."""
SHORTEST, LONGEST = 0.3, 20.0
"""A place is between this many times and that many times as long as a robot that is sent into it."""


@dataclass(frozen=True)
class SurfaceReport:
    """What a surface is.

    Attributes:
        faces: Number of triangles with an area.
        extent: Size along each axis, shape (3,), m.
        pieces: Number of connected pieces.
        closed: Number of them that are closed.
        tangled: Number of them without an inside: edges of three or more faces, or one-sided.
        flipped: Number of triangles that were turned around so that neighbours agree.
        inward: Number of closed pieces whose triangles, as they stand in the file, face inward.
        loops: Rims of holes, widest first.
    """

    faces: int
    extent: FloatArray
    pieces: int
    closed: int
    tangled: int
    flipped: int
    inward: int
    loops: tuple[Loop, ...]

    def openings(self, diameter: float) -> tuple[Loop, ...]:
        """Returns the rims through which a body of a diameter, m, may enter, widest first."""
        return tuple(loop for loop in self.loops if loop.diameter >= SMALLEST_OPENING * diameter)


def survey_surface(vertices: FloatArray, faces: IntArray) -> SurfaceReport:
    """Returns what a surface is.

    Args:
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3).
    """
    points, triangles = clean_mesh(vertices, faces)
    surface = analyse(points, triangles)
    count = int(surface.piece.max()) + 1
    closed = ~surface.tangled
    closed[[loop.piece for loop in surface.loops]] = False
    same = np.zeros(len(triangles), dtype=np.bool_)
    for shift in range(3):
        same |= (np.roll(surface.faces, shift, axis=1) == triangles).all(axis=1)
    flipped = ~same
    # A piece that was turned as a whole faced inward; one that was turned in part has flipped triangles.
    sizes = np.bincount(surface.piece, minlength=count)
    whole = np.bincount(surface.piece[flipped], minlength=count) == sizes
    return SurfaceReport(
        faces=len(triangles),
        extent=np.ptp(points, axis=0),
        pieces=count,
        closed=int(closed.sum()),
        tangled=int(surface.tangled.sum()),
        flipped=int((flipped & ~whole[surface.piece]).sum()),
        inward=int((closed & whole).sum()),
        loops=tuple(sorted(surface.loops, key=lambda loop: -loop.diameter)),
    )


def guess_unit(extent: float, opening: float, length: float, diameter: float) -> tuple[str, str]:
    """Returns the likeliest unit of length of a file, and the reason as a sentence.

    Args:
        extent: Longest side of the file's box, in its unit.
        opening: Diameter of its widest opening, in its unit; 0 where it has none.
        length: The robot's length, m.
        diameter: The robot's diameter, m.
    """
    fitting = []
    for unit in ("mm", "m", "cm", "in"):
        size, mouth = METRES_PER_UNIT[unit] * extent, METRES_PER_UNIT[unit] * opening
        if SHORTEST * length <= size <= LONGEST * length and (opening == 0.0 or mouth >= diameter):
            fitting.append(unit)
    if not fitting:
        nearest = min(METRES_PER_UNIT, key=lambda unit: abs(np.log(METRES_PER_UNIT[unit] * extent / (3.0 * length))))
        return nearest, (
            f"no unit makes the place between {SHORTEST:g} and {LONGEST:g} times as long as the robot with an opening "
            f"that it fits in; {nearest} comes nearest: {METRES_PER_UNIT[nearest] * extent:.3g} m"
        )
    unit = fitting[0]
    others = f"; {' and '.join(fitting[1:])} would fit too" if len(fitting) > 1 else ""
    size = 1e3 * METRES_PER_UNIT[unit] * extent
    return unit, f"in {unit} the place is {size:.4g} mm long and the robot {1e3 * length:.4g} mm{others}"
