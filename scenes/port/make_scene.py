"""Makes the meshes of the narrow ports: plates with a hole, two plates with offset holes, elbows and tubes.

Every port's axis is the world's x axis. A plate is a closed disc with a hole; pipes are surfaces, open at the mouth in
the plane x = 0 and closed by a cap at the far end. Circles are polygons about their nominal circle, so that no hole is
narrower than its name says. Lengths in mm.

Run it with no arguments to write the meshes beside this file: the same bytes each time.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh

SEGMENTS = 64  # vertices a ring
PLATE_RADIUS = 40.0
ROBOT = 3.0  # diameter of models/robots/borescope.toml


def ring(radius: float) -> np.ndarray:
    """Returns the corners (SEGMENTS, 2) of the polygon about a circle in the plane y, z."""
    angle = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    return radius / np.cos(np.pi / SEGMENTS) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def bands(rings: np.ndarray, *, closed: bool) -> np.ndarray:
    """Returns the triangles between neighbouring rings (k, SEGMENTS, 3), the last joined to the first when closed."""
    count = len(rings)
    here = np.arange(SEGMENTS)
    following = (here + 1) % SEGMENTS
    faces = []
    for index in range(count if closed else count - 1):
        a, b = index * SEGMENTS, (index + 1) % count * SEGMENTS
        faces.append(np.stack([a + here, a + following, b + following], axis=1))
        faces.append(np.stack([a + here, b + following, b + here], axis=1))
    return np.concatenate(faces)


def make_plate(hole: float, thickness: float, *, at: float = 0.0, offset: float = 0.0) -> trimesh.Trimesh:
    """Returns a plate from x = at to at + thickness with a hole of a diameter, whose axis lies at y = offset."""
    inner = ring(0.5 * hole) + np.array([offset, 0.0])
    outer = ring(PLATE_RADIUS)
    front, back = np.full((SEGMENTS, 1), at), np.full((SEGMENTS, 1), at + thickness)
    rings = np.array(
        [np.hstack([front, inner]), np.hstack([front, outer]), np.hstack([back, outer]), np.hstack([back, inner])]
    )
    return trimesh.Trimesh(rings.reshape(-1, 3), bands(rings, closed=True), process=False)


def make_plates(hole: float, thickness: float, gap: float, offset: float) -> trimesh.Trimesh:
    """Returns two plates with `gap` between them; the second one's hole is shifted sideways."""
    second = make_plate(hole, thickness, at=thickness + gap, offset=offset)
    return trimesh.util.concatenate([make_plate(hole, thickness), second])


def make_pipe(
    diameter: float, straight: float, bend_radius: float = 0.0, angle_deg: float = 0.0, behind: float = 0.0
) -> trimesh.Trimesh:
    """Returns a pipe: a straight leg along x, a bend towards +y, a straight leg behind it; closed at its end."""
    angle = np.deg2rad(angle_deg)
    lengths = [(straight, 4.0), (bend_radius * angle, 1.0), (behind, 4.0)]
    stations, begin = [0.0], 0.0
    for length, spacing in lengths:
        parts = max(1, round(length / spacing)) if length > 0.0 else 0
        stations += [begin + length * (k + 1) / parts for k in range(parts)]
        begin += length
    circle = ring(0.5 * diameter)
    rings, centre = [], np.zeros(3)
    for s in stations:
        turned = min(max(s - straight, 0.0) / bend_radius, angle) if bend_radius > 0.0 else 0.0
        tangent = np.array([np.cos(turned), np.sin(turned), 0.0])
        normal = np.array([-np.sin(turned), np.cos(turned), 0.0])
        centre = np.array([min(s, straight), 0.0, 0.0])
        if bend_radius > 0.0:
            centre += bend_radius * (np.array([0.0, 1.0, 0.0]) - normal)
            centre += max(s - straight - bend_radius * angle, 0.0) * tangent
        rings.append(centre + circle[:, :1] * normal + circle[:, 1:] * np.array([0.0, 0.0, 1.0]))
    faces = bands(np.array(rings), closed=False)
    last = (len(rings) - 1) * SEGMENTS + np.arange(SEGMENTS)
    cap = np.stack([last, np.roll(last, -1), np.full(SEGMENTS, len(rings) * SEGMENTS)], axis=1)
    return trimesh.Trimesh(np.concatenate([*rings, centre[None]]), np.concatenate([faces, cap]), process=False)


def main(folder: Path) -> None:
    """Writes the shipped meshes into a folder."""
    make_plate(1.6 * ROBOT, 10.0).export(folder / "plate_thin.stl")
    make_plate(1.3 * ROBOT, 30.0).export(folder / "plate_thick.stl")
    make_plates(2.0 * ROBOT, 5.0, 30.0, 6.0).export(folder / "plates_offset.stl")
    make_pipe(2.0 * ROBOT, 20.0, 50.0, 90.0, 40.0).export(folder / "elbow.stl")
    make_pipe(1.4 * ROBOT, 120.0).export(folder / "tube_blind.stl")
    make_pipe(1.6 * ROBOT, 2.0, 60.0, 90.0, 2.0).export(folder / "tube_curved.stl")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
