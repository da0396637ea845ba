"""Makes a volume like a CT of the upper airways: the tree of Weibel (1963) in voxels, with partial volume and noise.

Diameters and lengths of generations 0 to 3 are those of Weibel's model A (E. R. Weibel, Morphometry of the Human Lung,
1963, table "Dimensions of human airway model A"); the angles of branching, 35 degrees to either side, are those at
which Weibel's tree is usually drawn. The axes are RAS, in mm: x to the right, y to the front, z up; the first carina is
the origin. A voxel's value is the mean of air and tissue over it, plus noise, in Hounsfield units rounded to 32.

Run it with no arguments to write `airway.nii.gz` beside this file: the same bytes each time.
"""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import nibabel
import numpy as np

SPACING = 0.7
DIAMETERS = (18.0, 12.2, 8.3, 5.6)
LENGTHS = (45.0, 47.6, 19.0, 20.0)  # the trachea's lower part; generation 3 is drawn longer than its 7.6 mm
ANGLE_DEG = 35.0
LOWER, UPPER = np.array([-60.0, -25.0, -76.0]), np.array([60.0, 25.0, 36.0])
AIR, TISSUE, NOISE = -1000.0, 40.0, 25.0
HU_STEP = 32.0


def branches() -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Returns each branch as its ends, shape (3,), and radius, mm."""
    down = np.array([0.0, 0.0, -1.0])
    found = [(-LENGTHS[0] * down, np.zeros(3), 0.5 * DIAMETERS[0])]
    level = [(np.zeros(3), down, np.array([1.0, 0.0, 0.0]))]
    for diameter, length in zip(DIAMETERS[1:], LENGTHS[1:], strict=True):
        following = []
        for start, along, side in level:
            for sign in (-1.0, 1.0):
                angle = np.deg2rad(ANGLE_DEG)
                direction = np.cos(angle) * along + sign * np.sin(angle) * side
                end = start + length * direction
                found.append((start, end, 0.5 * diameter))
                # Branching planes turn by 90 degrees from one generation to the next.
                following.append((end, direction, np.cross(along, side)))
        level = following
    return found


def distance(points: np.ndarray) -> np.ndarray:
    """Returns the signed distance of points, shape (n, 3), mm, from the tree's wall, shape (n,), negative inside."""
    best = np.full(len(points), np.inf)
    for start, end, radius in branches():
        axis = end - start
        along = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - start - along[:, None] * axis, axis=1) - radius)
    return best


def make_volume() -> tuple[np.ndarray, np.ndarray]:
    """Returns the values in steps of `HU_STEP` above -1024 HU, uint8, and the affine map of indices to mm."""
    shape = np.round((UPPER - LOWER) / SPACING).astype(int)
    affine = np.diag([SPACING, SPACING, SPACING, 1.0])
    affine[:3, 3] = LOWER
    grid = np.stack(np.meshgrid(*(np.arange(count) for count in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    depth = distance(SPACING * grid + LOWER)
    air = np.clip(0.5 - depth / SPACING, 0.0, 1.0)
    values = TISSUE + air * (AIR - TISSUE) + NOISE * np.random.default_rng(1).standard_normal(len(air))
    steps = np.clip(np.round((values + 1024.0) / HU_STEP), 0, 255).astype(np.uint8)
    return steps.reshape(shape), affine


def main() -> None:
    values, affine = make_volume()
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    image.header["scl_slope"], image.header["scl_inter"] = HU_STEP, -1024.0
    buffer = io.BytesIO()
    image.to_stream(buffer)
    file = Path(__file__).resolve().parent / "airway.nii.gz"
    with file.open("wb") as stream, gzip.GzipFile(fileobj=stream, mode="wb", filename="", mtime=0) as packed:
        packed.write(buffer.getvalue())
    print(f"{file.name}: {' x '.join(str(count) for count in values.shape)} voxels, {file.stat().st_size} bytes")


if __name__ == "__main__":
    main()
