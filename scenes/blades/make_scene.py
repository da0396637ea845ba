"""Makes casing.stl, blades.stl and vanes.stl: a turbine stage seen from a borescope port in its casing.

x points radially inwards (x = 0 is the outside of the casing at the port), y along the engine's axis downstream, z
around the engine. The port's axis is the x axis. Behind the casing stand a row of guide vanes (upstream, y < 0) and a
row of twisted rotor blades on their platform (downstream, y > 0). Every body is a closed solid and none touches
another. Lengths in mm.

Run it with no arguments to write the meshes beside this file: the same bytes each time.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

CASING_RADIUS = 500.0  # outside of the casing, about the engine's axis
CASING_THICKNESS = 10.0
CASING_HALF_SPAN = np.deg2rad(22.0)
CASING_AXIAL = (-150.0, 160.0)
PORT_RADIUS = 23.0
PORT_SEGMENTS = 96
PORT_RINGS = 18

PLATFORM_RADII = (324.0, 336.0)


@dataclass(frozen=True)
class Row:
    """A row of aerofoils: where it stands and how its sections turn from root to tip.

    Attributes:
        count: Number of aerofoils, the row centred on the port.
        pitch: Angle between neighbours, rad.
        offset: Angle by which the row is turned about the engine's axis, rad.
        radii: Of the root and the tip section.
        axial: y of the middle of every chord.
        chord: Length of the chord.
        stagger: Angle of the chord from y towards z, of the root and the tip section, rad.
        camber: Turning of the camber line, of the root and the tip section, rad.
        thickness: Largest thickness by chord, of the root and the tip section.
    """

    count: int
    pitch: float
    offset: float
    radii: tuple[float, float]
    axial: float
    chord: float
    stagger: tuple[float, float]
    camber: tuple[float, float]
    thickness: tuple[float, float]


BLADES = Row(
    count=6,
    pitch=np.deg2rad(9.0),
    offset=np.deg2rad(0.0),
    radii=(337.0, 486.0),
    axial=112.0,
    chord=60.0,
    stagger=(np.deg2rad(15.0), np.deg2rad(45.0)),
    camber=(np.deg2rad(50.0), np.deg2rad(20.0)),
    thickness=(0.14, 0.07),
)
VANES = Row(
    count=5,
    pitch=np.deg2rad(10.0),
    offset=np.deg2rad(0.0),
    radii=(337.0, 486.0),
    axial=-106.0,
    chord=58.0,
    stagger=(np.deg2rad(-32.0), np.deg2rad(-28.0)),
    camber=(np.deg2rad(-45.0), np.deg2rad(-40.0)),
    thickness=(0.15, 0.13),
)
SECTIONS = 24
CHORD_POINTS = 22
EDGE_THICKNESS = 0.6  # half thickness at the leading and trailing edge


def place(radius: np.ndarray, angle: np.ndarray, axial: np.ndarray) -> np.ndarray:
    """Returns points (..., 3) from the radius and angle about the engine's axis and the axial coordinate."""
    return np.stack([CASING_RADIUS - radius * np.cos(angle), axial, radius * np.sin(angle)], axis=-1)


def aerofoil(chord: float, stagger: float, camber: float, thickness: float) -> np.ndarray:
    """Returns an aerofoil's outline, shape (2 * CHORD_POINTS, 2), in (y, z): the upper side, then the lower one back.

    Thickness as the NACA 4-digit series has it, on a circular camber line, both edges blunt.
    """
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, CHORD_POINTS)))
    polynomial = 0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4
    half = 5.0 * thickness * chord * polynomial + EDGE_THICKNESS
    slope = camber * (0.5 - x)
    line = np.stack([chord * (x - 0.5), chord * camber * 0.5 * x * (1.0 - x)], axis=1)
    normal = np.stack([-np.sin(slope), np.cos(slope)], axis=1)
    outline = np.concatenate([line + half[:, None] * normal, (line - half[:, None] * normal)[::-1]])
    cosine, sine = np.cos(stagger), np.sin(stagger)
    return outline @ np.array([[cosine, sine], [-sine, cosine]])


def make_aerofoil(row: Row, angle: float) -> trimesh.Trimesh:
    """Returns one aerofoil of a row, whose stacking line stands at an angle about the engine's axis."""
    sections = []
    for share in np.linspace(0.0, 1.0, SECTIONS):
        root, tip = 1.0 - share, share
        outline = aerofoil(
            row.chord,
            root * row.stagger[0] + tip * row.stagger[1],
            root * row.camber[0] + tip * row.camber[1],
            root * row.thickness[0] + tip * row.thickness[1],
        )
        radius = root * row.radii[0] + tip * row.radii[1]
        straight = np.stack(
            [np.full(len(outline), CASING_RADIUS - radius), row.axial + outline[:, 0], outline[:, 1]], 1
        )
        turn = trimesh.transformations.rotation_matrix(angle, [0, 1, 0], [CASING_RADIUS, 0, 0])
        sections.append(trimesh.transform_points(straight, turn))
    count = 2 * CHORD_POINTS
    here = np.arange(count)
    following = (here + 1) % count
    faces = []
    for index in range(SECTIONS - 1):
        a, b = index * count, (index + 1) * count
        faces.append(np.stack([a + here, b + following, a + following], axis=1))
        faces.append(np.stack([a + here, b + here, b + following], axis=1))
    upper = np.arange(CHORD_POINTS - 1)
    lower = count - 1 - upper
    cap = np.concatenate([np.stack([upper, upper + 1, lower - 1], 1), np.stack([upper, lower - 1, lower], 1)])
    faces += [cap, cap[:, ::-1] + (SECTIONS - 1) * count]
    return oriented(trimesh.Trimesh(np.concatenate(sections), np.concatenate(faces), process=False))


def make_row(row: Row) -> list[trimesh.Trimesh]:
    """Returns the aerofoils of a row."""
    angles = row.offset + row.pitch * (np.arange(row.count) - 0.5 * (row.count - 1))
    return [make_aerofoil(row, angle) for angle in angles]


def make_shell(radii: tuple[float, float], half_span: float, axial: tuple[float, float]) -> trimesh.Trimesh:
    """Returns a closed sector of a cylinder's shell about the engine's axis."""
    angle, y = np.meshgrid(np.linspace(-half_span, half_span, 41), np.linspace(*axial, 13), indexing="ij")
    across = len(axial_points := y[0])
    grid = np.concatenate([place(np.full_like(y, r), angle, y).reshape(-1, 3) for r in radii])
    size = y.size
    i, j = np.meshgrid(np.arange(len(y) - 1), np.arange(len(axial_points) - 1), indexing="ij")
    corner = (i * across + j).ravel()
    a, b, c, d = corner, corner + across, corner + across + 1, corner + 1
    sheet = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    rim = np.concatenate(
        [
            np.arange(across - 1),
            np.arange(across - 1, size - 1, across),
            np.arange(size - 1, size - across, -1),
            np.arange(size - across, 0, -across),
        ]
    )
    beside = np.roll(rim, -1)
    wall = np.concatenate([np.stack([rim, beside, beside + size], 1), np.stack([rim, beside + size, rim + size], 1)])
    return oriented(trimesh.Trimesh(grid, np.concatenate([sheet, sheet[:, ::-1] + size, wall]), process=False))


def make_casing() -> trimesh.Trimesh:
    """Returns the casing wall: a sector of a cylinder's shell with the round port through it."""
    turn = 2.0 * np.pi * (np.arange(PORT_SEGMENTS) + 0.5) / PORT_SEGMENTS
    direction = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    half = np.array([0.5 * (CASING_AXIAL[1] - CASING_AXIAL[0]), CASING_HALF_SPAN * CASING_RADIUS])
    reach = (half / np.maximum(np.abs(direction), 1e-12)).min(axis=1)
    share = np.linspace(0.0, 1.0, PORT_RINGS)[:, None, None] ** 1.5
    flat = (1.0 - share) * PORT_RADIUS * direction + share * reach[:, None] * direction
    middle = np.array([0.5 * (CASING_AXIAL[0] + CASING_AXIAL[1]), 0.0])
    layers = []
    for depth in np.linspace(0.0, CASING_THICKNESS, 4):
        # the port is a straight cylinder: its points keep their distance z from the port's axis at every depth
        radius = CASING_RADIUS - depth
        angle = (1.0 - share[..., 0]) * np.arcsin(flat[..., 1] / radius) + share[..., 0] * flat[..., 1] / CASING_RADIUS
        layers.append(place(np.full_like(angle, radius), angle, middle[0] + flat[..., 0]))
    vertices = np.concatenate([layer.reshape(-1, 3) for layer in layers])
    size = PORT_RINGS * PORT_SEGMENTS
    here = np.arange(PORT_SEGMENTS)
    following = (here + 1) % PORT_SEGMENTS
    faces = []
    for ring in range(PORT_RINGS - 1):
        a, b = ring * PORT_SEGMENTS, (ring + 1) * PORT_SEGMENTS
        sheet = np.concatenate(
            [np.stack([a + here, b + here, b + following], 1), np.stack([a + here, b + following, a + following], 1)]
        )
        faces += [sheet, sheet[:, ::-1] + 3 * size]
    for layer in range(3):
        for ring, flip in ((0, False), (PORT_RINGS - 1, True)):
            a = layer * size + ring * PORT_SEGMENTS
            b = a + size
            wall = np.concatenate(
                [
                    np.stack([a + here, a + following, b + following], 1),
                    np.stack([a + here, b + following, b + here], 1),
                ]
            )
            faces.append(wall[:, ::-1] if flip else wall)
    return oriented(trimesh.Trimesh(vertices, np.concatenate(faces), process=False))


def oriented(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns a consistently wound mesh with its normals out of the solid."""
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def main(folder: Path) -> None:
    """Writes the three meshes into a folder."""
    platform = make_shell(PLATFORM_RADII, CASING_HALF_SPAN, (66.0, 158.0))
    make_casing().export(folder / "casing.stl")
    trimesh.util.concatenate([*make_row(BLADES), platform]).export(folder / "blades.stl")
    trimesh.util.concatenate(make_row(VANES)).export(folder / "vanes.stl")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
