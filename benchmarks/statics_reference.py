"""The statics against shapes of another program, and how displacement drive and friction hold up.

`python benchmarks/statics_reference.py [--sorosim FOLDER] [--cases N]`: SoroSim's 500 spring-steel shapes
(github.com/ContinuumRoboticsLab/opencr-mujoco, data/reference/sorosim, MIT licence; not part of this repository),
random cases of displacement drive, and processor times a shape.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.statics.sequence import solve_sequence
from tdcr_planner.statics.solver import SolverSettings, SolveStatus, solve_statics
from tdcr_planner.statics.tendons import tendon_displacements

ROBOTS = Path(__file__).resolve().parents[1] / "models" / "robots"
STATIONS = np.array([0.0, 0.0469, 0.2308, 0.5, 0.7692, 0.9531, 1.0])


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sorosim", type=Path, help="folder of spring_steel_statics.csv")
    parser.add_argument("--cases", type=int, default=20000, help="random cases of displacement drive")
    arguments = parser.parse_args()
    if arguments.sorosim is not None:
        sorosim(arguments.sorosim)
    displacement_cases(arguments.cases)
    speed()


def sorosim(folder: Path) -> None:
    """Prints the largest errors against SoroSim's shapes over its 14 stations."""
    with (folder / "spring_steel_statics.csv").open() as file:
        rows = list(csv.reader(file))[2:]
    values = np.array([[float(value) for value in row[1:]] for row in rows]).reshape(-1, 6, 17)
    # Its rod lies along x, this one along z: (x, y, z) here are its (y, z, x).
    turned = [1, 2, 0]
    angles, positions = values[:, :3], values[:, 3:]
    segment = {
        "length_m": 0.3,
        "disks": 6,
        "disk_positions_m": (0.3 * STATIONS[1:]).tolist(),
        "disk_radius_m": 0.003,
        "disk_thickness_m": 1e-4,
        "disk_mass_kg": 0.0,
    }
    table: dict[str, Any] = {
        "format": "tdcr-robot/2",
        "name": "spring steel",
        "backbone": {"youngs_modulus_pa": 200e9, "poisson_ratio": 0.33, "radius_m": 0.0008, "density_kg_m3": 7870.0},
        "segments": [segment, segment],
        "tendons": [{"segment": 1, "angle_deg": 0.0, "radius_m": 0.002, "max_tension_n": 1.0}],
        "body": {"tendon_radius_m": 0.0001},
    }
    robot = RobotSpec.model_validate(table)
    count = len(values)
    forces, moments = np.zeros((count, 13, 3)), np.zeros((count, 13, 3))
    for disk, column in ((6, 1), (12, 2)):
        forces[:, disk], moments[:, disk] = positions[:, turned, column], angles[:, turned, column]
    solution = solve_statics(
        robot,
        np.zeros((count, 1)),
        gravity=positions[:, turned, 0],
        disk_forces=forces,
        disk_moments=moments,
        settings=SolverSettings(steps_per_gap=4),
    )
    expected = np.moveaxis(positions[:, turned, 3:], 1, 2)
    ours = solution.positions[:, [0, 1, 2, 3, 4, 5, 6, 6, 7, 8, 9, 10, 11, 12]]
    error = np.linalg.norm(ours - expected, axis=2).max(axis=1)
    print(f"SoroSim: {count} shapes, {solution.converged.sum()} converged; largest error over 14 stations, m:")
    print(
        f"median {np.median(error):.1e}, 95 % {np.quantile(error, 0.95):.1e}, largest {error.max():.1e} "
        f"(at most 4e-4 and 7e-4: rounding of the printed loads)\n"
    )


def driven_robot(name: str, stiffness: float, friction: float = 0.0) -> RobotSpec:
    """Returns a shipped robot with displacement drive through a transmission of a stiffness, N/m."""
    robot = load_robot(ROBOTS / f"{name}.toml")
    table = robot.model_dump()
    tendons = []
    for index, segment in enumerate(table["segments"]):
        tendons += [
            {
                "segment": index + 1,
                "angle_deg": angle,
                "radius_m": segment["tendon_circle_radius_m"],
                "max_tension_n": segment["max_tension_n"],
                "friction_coefficient": friction,
            }
            for angle in segment["tendon_angles_deg"]
        ]
        for key in ("tendon_circle_radius_m", "tendon_angles_deg", "max_tension_n", "pretension_n"):
            segment.pop(key, None)
        for key in ("tendon_axial_stiffness_n", "max_tendon_displacement_m"):
            segment.pop(key, None)
    table |= {
        "format": "tdcr-robot/2",
        "tendons": tendons,
        "drive": {"kind": "displacement", "transmission_stiffness_n_m": stiffness, "pretension_n": 0.1},
    }
    return RobotSpec.model_validate(table)


def random_vectors(random: np.random.Generator, count: int, largest: float) -> np.ndarray:
    """Returns vectors of random direction and of size 0 to `largest`, shape (count, 3)."""
    vector = random.normal(size=(count, 3))
    return vector / np.linalg.norm(vector, axis=1)[:, None] * random.uniform(0.0, largest, (count, 1))


def random_displacements(robot: RobotSpec, random: np.random.Generator, count: int) -> np.ndarray:
    """Returns displacements that bend each segment by up to 90 degrees, with slack of up to 1 mm, shape (n, t), m."""
    angle = random.uniform(0.0, 2.0 * np.pi, (count, robot.segment_count))
    largest = np.array([0.5 * np.pi * radius for _, radius in robot.segment_circles])
    size = random.uniform(0.0, 1.0, angle.shape) * largest
    bending = size[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return robot.displacements_from_bending(bending) + random.uniform(-0.001, 0.0, (count, robot.tendon_count))


def displacement_cases(count: int) -> None:
    """Prints how many random cases of displacement drive converge."""
    print(f"displacement drive: {count} random cases, gravity to 9.81 m/s^2, tip force to 0.1 N, any direction")
    print(f"{'robot':12s} {'N/m':>8s} " + " ".join(f"{status.value:>13s}" for status in SolveStatus) + "  integrations")
    random = np.random.default_rng(3)
    names, stiffnesses = ("paper", "inspection", "two_segment"), (1e3, 1e4, 1e5, 1e6, 1e7)
    share = count // (len(names) * len(stiffnesses))
    found = total = 0
    for name in names:
        for stiffness in stiffnesses:
            robot = driven_robot(name, stiffness)
            loads = {"gravity": random_vectors(random, share, 9.81), "tip_force": random_vectors(random, share, 0.1)}
            solution = solve_statics(robot, displacements=random_displacements(robot, random, share), **loads)
            counts = " ".join(f"{int((solution.status == status).sum()):13d}" for status in SolveStatus)
            print(f"{name:12s} {stiffness:8.0e} {counts}  {solution.iterations.mean():.2f}")
            found, total = found + int(solution.converged.sum()), total + share
    print(f"converged: {found} of {total}, {100.0 * found / total:.2f} %\n")


def speed() -> None:
    """Prints processor times a shape of tension drive, displacement drive and friction, and their ratios."""
    random = np.random.default_rng(1)
    plain, count = load_robot(ROBOTS / "two_segment.toml"), 1000
    loads = {"gravity": random_vectors(random, count, 9.81), "tip_force": random_vectors(random, count, 0.1)}
    tensions = random.uniform(0.0, 1.0, (count, plain.tendon_count)) * plain.max_tensions
    driven, rubbing = driven_robot("two_segment", 7000.0), driven_robot("two_segment", 7000.0, 0.1)
    displacements = tendon_displacements(driven, solve_statics(driven, tensions, **loads))
    phase = np.linspace(0.0, 40.0 * np.pi, count)[:, None] - np.deg2rad(plain.tendon_angles)
    motion = plain.max_tensions * (0.5 + 0.4 * np.cos(phase))
    bends = 0.002 * np.cos(phase)
    steady = {name: value[0] for name, value in loads.items()}
    runs: list[tuple[str, Callable[[], Any]]] = [
        ("tension drive", lambda: solve_statics(plain, tensions, **loads)),
        ("displacement drive", lambda: solve_statics(driven, displacements=displacements, **loads)),
        ("step with friction", lambda: solve_sequence(rubbing, motion, kind="tension", **steady)),
        ("step with friction, displacement", lambda: solve_sequence(rubbing, bends, **steady)),
    ]
    print(f"two segments, gravity and tip force, {count} states, one core, processor time")
    base = 0.0
    for name, run in runs:
        solution = run()
        times = []
        for _ in range(3):
            start = time.process_time()
            run()
            times.append(time.process_time() - start)
        base = base or min(times)
        print(
            f"{name:34s} {min(times) / count * 1e6:8.1f} us  ratio {min(times) / base:5.2f}  "
            f"{solution.iterations.mean():6.2f} integrations, {solution.converged.mean() * 100.0:.1f} % converged"
        )


if __name__ == "__main__":
    main()
