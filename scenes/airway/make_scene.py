"""Makes airway.stl: the inside of a branching airway phantom, about twice life size.

The trachea lies along +x with its mouth at x = 0, as in a patient on the back; y points to the patient's left and z,
up, to the front. Behind the carina follow the two main bronchi and five lobar ones. The mouth is open (one boundary
loop), the branches end blind. Lengths in mm.

The surface is the level set of a smooth union of round cones. Making it needs the package manifold3d; using the shipped
mesh does not. Run it with no arguments to write the mesh beside this file: the same bytes each time.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numba
import numpy as np
import trimesh

BEHIND_MOUTH = 20.0  # the trachea is made longer by this much and cut at x = 0
EDGE_LENGTH = 3.6
SIMPLIFY = 0.005  # vertices may move this far where the surface allows fewer of them
BLEND = 7.0  # width of the smooth union
PIECES = 8  # straight pieces a branch

# name: three control points of a quadratic Bezier curve, the inside radius at its start and at its end
BRANCHES = {
    "trachea": ((-BEHIND_MOUTH, 0, 0), (45, 0, 0), (112, 0, 0), 20.0, 19.5),
    "left main": ((108, 0, 0), (132, 6, 0), (178, 45, 3), 17.0, 16.0),
    "left upper": ((174, 41, 3), (190, 54, 6), (218, 76, 22), 15.0, 13.5),
    "left lower": ((174, 41, 3), (194, 58, 4), (240, 74, -10), 14.5, 13.0),
    "right main": ((108, 0, 0), (125, -5, 0), (150, -18, 0), 18.0, 16.5),
    "right upper": ((142, -13, 0), (148, -34, 2), (156, -64, 10), 13.5, 12.0),
    "right intermediate": ((148, -17, 0), (166, -26, 0), (186, -34, -2), 16.0, 15.0),
    "right middle": ((182, -32, -2), (198, -41, 4), (222, -60, 26), 13.5, 12.5),
    "right lower": ((182, -32, -2), (202, -40, -6), (244, -46, -24), 14.5, 13.0),
}


def branch_pieces() -> np.ndarray:
    """Returns the straight pieces of all branches, shape (branches, PIECES, 8): start, end, radius at both."""
    share = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    pieces = []
    for first, control, last, radius_first, radius_last in BRANCHES.values():
        a, b, c = (np.asarray(point, dtype=np.float64) for point in (first, control, last))
        points = (1 - share) ** 2 * a + 2 * share * (1 - share) * b + share**2 * c
        radii = radius_first + share * (radius_last - radius_first)
        pieces.append(np.concatenate([points[:-1], points[1:], radii[:-1], radii[1:]], axis=1))
    return np.array(pieces)


@numba.njit
def depth_inside(pieces: np.ndarray, x: float, y: float, z: float) -> float:
    """Returns how deep a point lies inside the smooth union of the branches (negative: outside), mm."""
    union = 1e9
    for branch in range(pieces.shape[0]):
        nearest = 1e9
        for index in range(pieces.shape[1]):
            p = pieces[branch, index]
            ax, ay, az = p[3] - p[0], p[4] - p[1], p[5] - p[2]
            bx, by, bz = x - p[0], y - p[1], z - p[2]
            share = (ax * bx + ay * by + az * bz) / (ax * ax + ay * ay + az * az)
            share = min(1.0, max(0.0, share))
            dx, dy, dz = bx - share * ax, by - share * ay, bz - share * az
            nearest = min(nearest, np.sqrt(dx * dx + dy * dy + dz * dz) - (p[6] + share * (p[7] - p[6])))
        # polynomial smooth minimum (Quilez): equals the minimum where the two differ by more than BLEND
        overlap = max(BLEND - abs(union - nearest), 0.0) / BLEND
        union = min(union, nearest) - 0.25 * BLEND * overlap * overlap
    return -union


def make_airway() -> trimesh.Trimesh:
    """Returns the airway's surface in mm, normals out of the cavity, open at the mouth."""
    # imported here, so that `depth_inside` can be asked where the package is not installed
    from manifold3d import Manifold

    pieces = branch_pieces()
    points = pieces[..., :3].reshape(-1, 3)
    ends = pieces[..., 3:6].reshape(-1, 3)
    low = np.minimum(points, ends).min(axis=0) - 26.0
    high = np.maximum(points, ends).max(axis=0) + 26.0
    solid = Manifold.level_set(lambda x, y, z: depth_inside(pieces, x, y, z), [*low, *high], EDGE_LENGTH)
    half = solid.trim_by_plane((1.0, 0.0, 0.0), 0.0).simplify(SIMPLIFY).to_mesh()
    vertices = np.asarray(half.vert_properties, dtype=np.float64)[:, :3]
    faces = np.asarray(half.tri_verts)
    lid = (np.abs(vertices[faces][:, :, 0]) < 1e-4).all(axis=1)
    mesh = trimesh.Trimesh(vertices, faces[~lid], process=False)
    mesh.remove_unreferenced_vertices()
    return mesh


def main(folder: Path) -> None:
    """Writes airway.stl into a folder."""
    make_airway().export(folder / "airway.stl")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
