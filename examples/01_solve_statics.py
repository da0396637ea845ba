"""Solve shapes of the inspection robot with the Cosserat reference and see what gravity does to a circular arc.

Run: python examples/01_solve_statics.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tdcr_planner import load_robot, solve_statics
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    robot = load_robot(ROOT / "models/robots/inspection.toml")
    bending = np.array([[[force, 0.0]] for force in (0.0, 1.0, 2.0, 3.0)])
    tensions = robot.tensions_from_bending(bending)
    arcs = ConstantCurvatureShape(robot).disk_poses(tensions).positions
    print("robot lying on its side, bent upwards; tip position in mm")
    print(f"{'bending N':>10} {'arc x, z':>18} {'with gravity x, z':>20} {'tip sag mm':>11}")
    solution = solve_statics(robot, tensions, gravity=[-9.81, 0.0, 0.0])
    for case in range(len(tensions)):
        assert solution.converged[case], solution.status[case]
        arc, tip = 1e3 * arcs[case, -1], 1e3 * solution.positions[case, -1]
        sag = np.linalg.norm(arc - tip)
        print(f"{bending[case, 0, 0]:10.1f} {arc[0]:9.1f},{arc[2]:8.1f} {tip[0]:11.1f},{tip[2]:8.1f} {sag:11.1f}")


if __name__ == "__main__":
    main()
