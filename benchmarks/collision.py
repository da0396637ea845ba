"""Times a checked state by FCL alone and with the distance field, on bent pipes of 1k to 100k triangles, in one run.

python benchmarks/collision.py [--quick]
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from pathlib import Path
from typing import Literal

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

ROBOT = Path(__file__).parents[1] / "models" / "robots" / "paper.toml"
MARGIN = 0.0015
BEND, STRAIGHT = 0.15, 0.1


def bent_pipe(triangles: int, radius: float) -> SceneMesh:
    """Returns a pipe up from the origin and then bent by a right angle towards x, of about so many triangles."""
    around = max(16, round(np.sqrt(triangles / 8)))
    along = round(triangles / 2 / around) + 1
    s = np.linspace(0.0, STRAIGHT + BEND * np.pi / 2, along)
    turn = np.maximum(s - STRAIGHT, 0.0) / BEND
    middle = np.stack([BEND * (1 - np.cos(turn)), 0 * s, np.minimum(s, STRAIGHT) + BEND * np.sin(turn)], axis=1)
    side = np.stack([np.cos(turn), 0 * s, -np.sin(turn)], axis=1)
    u = 2 * np.pi * np.arange(around) / around
    ring = np.cos(u)[:, None] * side[:, None, :] + np.sin(u)[:, None] * np.array([0.0, 1.0, 0.0])
    vertices = (middle[:, None, :] + radius * ring).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij"))
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.concatenate([np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)])
    return SceneMesh.from_arrays("pipe", vertices, faces, "cavity", [0, 0, 0], [0, 0, 1])


def states_inside(
    robot: RobotSpec, radius: float, rng: np.random.Generator, count: int
) -> tuple[FloatArray, FloatArray]:
    """Returns poses of a robot that follows the pipe, somewhere along it and somewhat off its axis."""
    room = 0.8 * (radius - MARGIN - float(robot.disk_radii.max()))
    length = STRAIGHT + BEND * np.pi / 2
    s = rng.uniform(-robot.length, length - robot.length - 0.01, (count, 1)) + robot.arc_lengths
    turn = np.maximum(s - STRAIGHT, 0.0) / BEND
    zero, one = np.zeros_like(s), np.ones_like(s)
    x = np.stack([np.cos(turn), zero, -np.sin(turn)], axis=-1)
    z = np.stack([np.sin(turn), zero, np.cos(turn)], axis=-1)
    y = np.stack([zero, one, zero], axis=-1)
    positions = np.stack([BEND * (1 - np.cos(turn)), zero, np.minimum(s, STRAIGHT) + BEND * np.sin(turn)], axis=-1)
    off = rng.uniform(-room, room, (count, 2, 1, 1)) / np.sqrt(2.0)
    return positions + off[:, 0] * x + off[:, 1] * y, np.stack([x, y, z], axis=-1)


def states_anywhere(robot: RobotSpec, rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Returns poses of random bending and insertion, as a search draws them; nearly all hit."""
    bending = rng.uniform(-2.0, 2.0, (count, robot.segment_count, 2))
    shape = ConstantCurvatureShape(robot).disk_poses(robot.tensions_from_bending(bending))
    return shape.positions + rng.uniform(-0.2, 0.1, (count, 1, 1)) * np.array([0.0, 0.0, 1.0]), shape.rotations


def per_state(scene: CollisionScene, poses: tuple[FloatArray, FloatArray], batch: int, count: int) -> float:
    """Returns the processor time of one state in microseconds when states are checked in batches."""
    positions, rotations = poses
    start = time.process_time()
    for row in range(0, count, batch):
        scene.check(positions[row : row + batch], rotations[row : row + batch])
    return (time.process_time() - start) / count * 1e6


def measure(triangles: int, radius: float, quick: bool) -> None:
    """Prints the rows of one mesh."""
    robot = load_robot(ROBOT)
    rng = np.random.default_rng(1)
    body = RobotBody(robot, np.full(robot.disk_count, MARGIN))
    start = time.process_time()
    mesh = bent_pipe(triangles, radius)
    mesh_time = time.process_time() - start
    start = time.process_time()
    alone = CollisionScene([mesh], body, field=None)
    tree_time = time.process_time() - start
    start = time.process_time()
    scene = CollisionScene([mesh], body)
    field_time = time.process_time() - start
    start = time.process_time()
    CollisionScene([mesh], body)
    cached_time = time.process_time() - start
    print(
        f"{len(mesh.faces)} triangles, radius {radius * 1e3:g} mm: mesh {mesh_time:.2f} s, trees {tree_time:.2f} s, "
        f"field {field_time:.2f} s, from the cache {cached_time:.2f} s"
    )
    count = 200 if quick else 1000
    for name, poses in (
        ("following", states_inside(robot, radius, rng, count)),
        ("random", states_anywhere(robot, rng, count)),
    ):
        expected = alone.check(*poses)
        same = np.array_equal(scene.check(*poses), expected)
        slow = per_state(alone, poses, 1, count)
        times = [per_state(scene, poses, batch, count) for batch in (1, 10, count)]
        cells = "".join(f"{value:9.1f} ({slow / value:5.0f}x)" for value in times)
        clear = time.process_time()
        scene.clearance(poses[0][:100], poses[1][:100])
        clearance = (time.process_time() - clear) / 100 * 1e6
        free = float((expected == 0).mean())
        print(f"  {name:10s}{free:6.0%}{slow:10.1f}{cells}{clearance:12.1f}   {'same' if same else 'DIFFERENT'}")


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer states and no mesh of 100k triangles")
    quick = parser.parse_args().quick
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print("Processor time in us a state; in brackets how many times less than FCL alone takes in the same run.")
    print("  states      free FCL alone          batch 1         batch 10       one batch   clearance   answers")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TDCR_CACHE_DIR"] = folder
        warm = bent_pipe(200, 0.02)
        robot = load_robot(ROBOT)
        modes: tuple[Literal["auto"] | None, ...] = ("auto", None)
        for field in modes:
            scene = CollisionScene([warm], RobotBody(robot), field=field)
            poses = states_anywhere(robot, np.random.default_rng(0), 20)
            scene.check(*poses)
            scene.clearance(*poses)
        for triangles in (1_000, 10_000) if quick else (1_000, 10_000, 100_000):
            for radius in (0.020, 0.014):
                measure(triangles, radius, quick)


if __name__ == "__main__":
    main()
