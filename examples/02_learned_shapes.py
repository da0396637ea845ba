"""Ask the shipped learned model for 1000 shapes and hold them against the reference.

Run: python examples/02_learned_shapes.py
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from tdcr_planner import load_robot, load_shape_model, solve_statics

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    robot = load_robot(ROOT / "models/robots/inspection.toml")
    model = load_shape_model(ROOT / "models/shape/inspection/model.pt", robot)
    random = np.random.default_rng(7)
    tensions = random.uniform(0.0, 1.0, (1000, robot.tendon_count)) * robot.max_tensions
    gravity = random.normal(size=(1000, 3))
    gravity *= 9.81 * random.uniform(0.0, 1.0, (1000, 1)) / np.linalg.norm(gravity, axis=1, keepdims=True)

    model.disk_poses(tensions[:1], gravity=gravity[:1])  # the first call compiles
    begin = time.perf_counter()
    learned = model.disk_poses(tensions, gravity=gravity)
    learned_s = time.perf_counter() - begin
    solve_statics(robot, tensions[:1], gravity=gravity[:1])
    begin = time.perf_counter()
    reference = solve_statics(robot, tensions, gravity=gravity)
    reference_s = time.perf_counter() - begin

    error = 1e6 * np.linalg.norm(learned.positions - reference.positions, axis=2)[reference.converged]
    print(f"position error over all disks: median {np.median(error):.2f} um, 99 % {np.quantile(error, 0.99):.1f} um")
    print(f"bound that the planner adds to the tip: {1e6 * model.error_bound[-1]:.0f} um")
    print(f"time a shape: learned {1e3 * learned_s:.1f} us, reference {1e3 * reference_s:.0f} us")


if __name__ == "__main__":
    main()
