"""Makes a housing as a STEP file: a block with a chamber that is reached through one port, as a designer would draw it.

The port's axis is the x axis, its mouth lies in the plane x = 0. Lengths in mm. Needs gmsh (pip install gmsh).

Run it with no arguments to write `housing.step` beside this file. The time that Open CASCADE writes into the file's
header is replaced, so that the same bytes come out each time.
"""

from __future__ import annotations

import re
from pathlib import Path

import gmsh

PORT_RADIUS, PORT_LENGTH = 2.5, 30.0
CHAMBER_RADIUS, CHAMBER_LENGTH = 24.0, 70.0
WALL = 6.0


def main() -> None:
    """Writes the file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    side = 2.0 * (CHAMBER_RADIUS + WALL)
    length = PORT_LENGTH + CHAMBER_LENGTH + WALL
    block = occ.addBox(0.0, -0.5 * side, -0.5 * side, length, side, side)
    port = occ.addCylinder(-1.0, 0.0, 0.0, PORT_LENGTH + 2.0, 0.0, 0.0, PORT_RADIUS)
    chamber = occ.addCylinder(PORT_LENGTH, 0.0, 0.0, CHAMBER_LENGTH, 0.0, 0.0, CHAMBER_RADIUS)
    rod = occ.addCylinder(PORT_LENGTH + 35.0, -CHAMBER_RADIUS, 0.0, 0.0, 2.0 * CHAMBER_RADIUS, 0.0, 4.0)
    hollow, _ = occ.cut([(3, block)], [(3, port), (3, chamber)])
    occ.fuse(hollow, [(3, rod)])
    occ.synchronize()
    file = Path(__file__).resolve().parent / "housing.step"
    gmsh.write(str(file))
    gmsh.finalize()
    text = file.read_text()
    file.write_text(re.sub(r"'\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d'", "'2000-01-01T00:00:00'", text, count=1))
    print(f"{file.name}: {file.stat().st_size} bytes")


if __name__ == "__main__":
    main()
