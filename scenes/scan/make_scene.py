"""Makes a laser scan of the duct: points on its wall, with noise, and with holes where the scanner saw nothing.

Run it with no arguments to write `duct.ply` (binary, single precision, mm) beside this file: the same bytes each time.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

HERE = Path(__file__).resolve().parent
CELL = 1.8  # mm: one point a cube of this size
NOISE = 0.05
HOLES, HOLE_RADIUS = 4, 7.0


def make_points() -> np.ndarray:
    """Returns the points, shape (n, 3), mm."""
    duct = trimesh.load(HERE.parent / "duct" / "duct.stl", process=False)
    rng = np.random.default_rng(1)
    # Many points, thinned to one a cube, so that no gap is much wider than another.
    points, _ = trimesh.sample.sample_surface(duct, int(10.0 * duct.area / CELL**2), seed=1)
    _, first = np.unique(np.floor(points / CELL).astype(int), axis=0, return_index=True)
    points = points[np.sort(first)]
    holes = points[rng.choice(len(points), HOLES, replace=False)]
    seen = np.linalg.norm(points[:, None] - holes, axis=2).min(axis=1) > HOLE_RADIUS
    points = points[seen]
    return points + NOISE * rng.standard_normal(points.shape)


def main() -> None:
    """Writes the file."""
    points = make_points()
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    file = HERE / "duct.ply"
    file.write_bytes(head.encode() + points.astype("<f4").tobytes())
    print(f"{file.name}: {len(points)} points, {file.stat().st_size} bytes")


if __name__ == "__main__":
    main()
