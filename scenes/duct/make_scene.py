"""Makes duct.stl: the inside of a bent pipe with a passable narrowing and an orifice plate that no disk passes.

The pipe's axis lies in the horizontal plane z = 0. It runs along +x from the mouth at x = 0, bends towards +y and ends
in a short blind leg. The mouth is open (one boundary loop), the far end is closed by a cap. Lengths in mm.

Run it with no arguments to write the mesh beside this file: the same bytes each time.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh

STRAIGHT = 120.0  # length of the leg behind the mouth
BEND_RADIUS = 190.0  # of the axis
BEND_ANGLE = np.deg2rad(72.0)
BLIND_LEG = 40.0
BEND_LENGTH = BEND_RADIUS * BEND_ANGLE

PIPE_RADIUS = 25.0  # inside
MOUTH_RADIUS = 32.0  # the mouth flares out to this over FLARE_LENGTH
FLARE_LENGTH = 30.0
NARROWING_AT = STRAIGHT + 100.0  # arc length of the throat of the narrowing
NARROWING_HALF_LENGTH = 25.0
NARROWING_RADIUS = 16.0
ORIFICE_AT = STRAIGHT + 165.0  # arc length of the middle of the orifice plate
ORIFICE_HALF_THICKNESS = 0.5
ORIFICE_RADIUS = 9.8  # below the 10 mm of the robots' disks

RING_SPACING = 3.0
SEGMENTS = 64  # vertices a ring


def axis_frame(s: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns the axis point and the in-plane normal (towards the centre of the bend), (3,) each, at arc length s."""
    if s <= STRAIGHT:
        return np.array([s, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    angle = min((s - STRAIGHT) / BEND_RADIUS, BEND_ANGLE)
    normal = np.array([-np.sin(angle), np.cos(angle), 0.0])
    tangent = np.array([np.cos(angle), np.sin(angle), 0.0])
    centre = np.array([STRAIGHT, BEND_RADIUS, 0.0])
    beyond = max(s - STRAIGHT - BEND_LENGTH, 0.0)
    return centre - BEND_RADIUS * normal + beyond * tangent, normal


def inner_radius(s: float) -> float:
    """Returns the inside radius at arc length s, the orifice plate left out."""
    if s < FLARE_LENGTH:
        return PIPE_RADIUS + (MOUTH_RADIUS - PIPE_RADIUS) * 0.5 * (1.0 + np.cos(np.pi * s / FLARE_LENGTH))
    offset = abs(s - NARROWING_AT) / NARROWING_HALF_LENGTH
    if offset < 1.0:
        return PIPE_RADIUS - (PIPE_RADIUS - NARROWING_RADIUS) * 0.5 * (1.0 + np.cos(np.pi * offset))
    return PIPE_RADIUS


def ring_profile() -> list[tuple[float, float]]:
    """Returns the rings (arc length, radius) from the mouth to the far end; equal arc lengths make a flat step."""
    length = STRAIGHT + BEND_LENGTH + BLIND_LEG
    plain = np.linspace(0.0, length, round(length / RING_SPACING) + 1)
    before, after = ORIFICE_AT - ORIFICE_HALF_THICKNESS, ORIFICE_AT + ORIFICE_HALF_THICKNESS
    near = [(s, inner_radius(s)) for s in plain if s < before - 0.5 * RING_SPACING]
    far = [(s, inner_radius(s)) for s in plain if s > after + 0.5 * RING_SPACING]
    middle = 0.5 * (PIPE_RADIUS + ORIFICE_RADIUS)
    step = [(before, r) for r in (PIPE_RADIUS, middle, ORIFICE_RADIUS)]
    return near + step + [(after, r) for _, r in reversed(step)] + far


def make_duct() -> trimesh.Trimesh:
    """Returns the duct's surface in mm, normals out of the cavity, open at the mouth."""
    angle = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    rings = []
    for s, radius in ring_profile():
        point, normal = axis_frame(s)
        around = np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * np.array([0.0, 0.0, 1.0])
        rings.append(point + radius * around)
    vertices = np.concatenate([*rings, axis_frame(ring_profile()[-1][0])[0][None]])
    here = np.arange(SEGMENTS)
    following = (here + 1) % SEGMENTS
    faces = []
    for index in range(len(rings) - 1):
        a, b = index * SEGMENTS, (index + 1) * SEGMENTS
        faces.append(np.stack([a + here, a + following, b + following], axis=1))
        faces.append(np.stack([a + here, b + following, b + here], axis=1))
    last = (len(rings) - 1) * SEGMENTS
    faces.append(np.stack([last + here, last + following, np.full(SEGMENTS, len(vertices) - 1)], axis=1))
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def main(folder: Path) -> None:
    """Writes duct.stl into a folder."""
    make_duct().export(folder / "duct.stl")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
