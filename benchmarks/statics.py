"""Speed and reliability of the Cosserat reference.

Run `python benchmarks/statics.py`; `--quick` takes a tenth of the cases. Times are processor time of the process (other
programs on the machine then count for less), the best of several runs; ratios compare runs of the same process.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.se3 import rotation_from_vector
from tdcr_planner.statics.sensitivity import statics_jacobian
from tdcr_planner.statics.solver import RodSolution, SolverSettings, SolveStatus, solve_statics

ROBOTS = Path(__file__).resolve().parents[1] / "models" / "robots"
# Milliseconds a shape of the published C++ program (Rao et al. 2021) on a two-core EPYC: its default settings, and the
# loosest of those that Bensch et al. 2024 compare with.
PUBLISHED_MS = (862.0, 47.0)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the cases")
    quick = parser.parse_args().quick
    print(f"machine: {platform.machine()} {_processor()}, Python {platform.python_version()}, numpy {np.__version__}\n")
    _speed(200 if quick else 1000)
    _reliability(2000 if quick else 20000)
    _spot_check(1 if quick else 5)


def random_cases(
    robot: RobotSpec, count: int, seed: int, force: float = 0.1
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Returns tensions within the limits, gravity of 0 to 9.81 m/s^2 and a tip force, in any direction."""
    random = np.random.default_rng(seed)

    def vectors(largest: float) -> np.ndarray:
        vector = random.normal(size=(count, 3))
        return vector / np.linalg.norm(vector, axis=1)[:, None] * random.uniform(0.0, largest, (count, 1))

    tensions = random.uniform(0.0, 1.0, (count, robot.tendon_count)) * robot.max_tensions
    return tensions, {"gravity": vectors(9.81), "tip_force": vectors(force)}


def _speed(count: int) -> None:
    start = time.perf_counter()
    robot = load_robot(ROBOTS / "two_segment.toml")
    solve_statics(robot, np.ones((1, 6)))
    print(f"first call, compiled code loaded from the cache or made: {time.perf_counter() - start:.1f} s\n")
    tensions, loads = random_cases(robot, count, 1)
    moved = 1.01 * tensions
    settings = SolverSettings(tolerance=1e-9)
    solution = solve_statics(robot, tensions, **loads, settings=settings)
    rows = [{name: value[i] for name, value in loads.items()} for i in range(100)]
    starts = [solve_statics(robot, tensions[i : i + 1], **rows[i]) for i in range(100)]

    def each(case: Callable[[int], RodSolution]) -> Callable[[], None]:
        def run() -> None:
            for i in range(100):
                case(i)

        return run

    table = [
        ("batch, cold", _best(lambda: solve_statics(robot, tensions, **loads)) / count, 100.0),
        ("batch, warm", _best(lambda: solve_statics(robot, moved, **loads, initial=solution)) / count, None),
        ("single, cold", _best(each(lambda i: solve_statics(robot, tensions[i : i + 1], **rows[i]))) / 100, 2000.0),
        (
            "single, warm",
            _best(each(lambda i: solve_statics(robot, moved[i : i + 1], **rows[i], initial=starts[i]))) / 100,
            500.0,
        ),
        ("batch, derivatives", _best(lambda: statics_jacobian(robot, solution)) / count, None),
    ]
    print(f"two segments, gravity and tip force, relative residual 1e-9, one core, batch of {count}")
    print(f"{'':20s} {'us a shape':>11s} {'target':>8s} {'to batch':>9s} {'published / this':>18s}")
    for name, seconds, target in table:
        ratio = " to ".join(f"{ms * 1e-3 / seconds:,.0f}" for ms in PUBLISHED_MS[::-1])
        print(
            f"{name:20s} {seconds * 1e6:11.1f} {target or '':>8} {seconds / table[0][1]:9.2f} "
            f"{ratio if 'derivatives' not in name else '':>18s}"
        )
    print(f"sweeps from base to tip: {solution.iterations.mean():.2f} a shape, at most {solution.iterations.max()}\n")


def _reliability(count: int) -> None:
    print(f"{count} random cases a robot: tensions in limits, gravity to 9.81 m/s^2, tip force in any direction")
    print(
        f"{'robot':12s} {'force':>7s} "
        + " ".join(f"{status.value:>13s}" for status in SolveStatus)
        + "  sweeps (max)  error of the step (max)"
    )
    for name in ("paper", "inspection", "two_segment"):
        for force in (0.1, 0.4):
            robot = load_robot(ROBOTS / f"{name}.toml")
            tensions, loads = random_cases(robot, count, 2, force)
            solution = solve_statics(robot, tensions, **loads)
            fine = solve_statics(robot, tensions, **loads, settings=SolverSettings(tolerance=1e-12, steps_per_gap=4))
            both = solution.converged & fine.converged
            error = np.linalg.norm(solution.positions[both] - fine.positions[both], axis=2).max()
            counts = " ".join(f"{int((solution.status == status).sum()):13d}" for status in SolveStatus)
            print(
                f"{name:12s} {force:5.1f} N {counts}  "
                f"{solution.iterations.mean():5.2f} ({solution.iterations.max()})  {error:.1e} m"
            )
    print()


def _spot_check(count: int) -> None:
    print("two_segment against minimal potential energy of a chain of constant-strain elements, extrapolated")
    robot = load_robot(ROBOTS / "two_segment.toml")
    tensions, loads = random_cases(robot, 20000, 2)
    solution = solve_statics(robot, tensions[:count], **{name: value[:count] for name, value in loads.items()})
    for row in range(count):
        case = {name: value[row] for name, value in loads.items()}
        coarse, fine = (minimise(robot, tensions[row], case, elements) for elements in (1, 2))
        extrapolated = (4.0 * fine - coarse) / 3.0
        error = np.linalg.norm(extrapolated - solution.positions[row], axis=1).max()
        spread = np.linalg.norm(fine - coarse, axis=1).max()
        print(
            f"case {row}: {solution.status[row].value}, largest disk distance {error:.1e} m "
            f"(chains differ by {spread:.1e} m)"
        )


def minimise(robot: RobotSpec, tensions: np.ndarray, loads: dict[str, np.ndarray], elements: int) -> np.ndarray:
    """Returns the disk positions, shape (d, 3), m, that minimise the potential energy of a chain of elements.

    Each element has constant strain, its chord in the direction of its middle; quasi-Newton steps with the exact
    gradient of the chain's energy. No cut, no moment and no shooting are in it.

    Args:
        robot: The robot.
        tensions: Shape (t,), N.
        loads: gravity and tip_force, shape (3,) each.
        elements: Elements between neighbouring disks.
    """
    chain = _chain(robot, elements)
    scale = 1.0 / np.sqrt(chain["stiffness"] * chain["length"][:, None])

    def energy(unknown: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = _energy(chain, chain["rest"] + (unknown.reshape(-1, 6) * scale), tensions, loads)
        return value, (gradient * scale).ravel()

    start = np.zeros(chain["rest"].size)
    result = minimize(
        energy,
        start,
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 20000, "maxfun": 40000, "ftol": 0.0, "gtol": 1e-10, "maxcor": 60},
    )
    nodes, _ = _nodes(chain, chain["rest"] + result.x.reshape(-1, 6) * scale)
    return np.asarray(nodes[::elements])


def _chain(robot: RobotSpec, elements: int) -> dict[str, np.ndarray]:
    length, owner = [], []
    for index, segment in enumerate(robot.segments):
        length += [segment.length_m / segment.disks / elements] * (segment.disks * elements)
        owner += [index] * (segment.disks * elements)
    backbones = [robot.segment_backbones[index] for index in owner]
    masses = np.zeros(len(length) + 1)
    masses[::elements] = robot.disk_masses
    masses[-1] += robot.tip.mass_kg
    line = np.array([b.weight_per_length_kg_m for b in backbones]) * np.array(length)
    masses[1:] += 0.5 * line
    masses[:-1] += 0.5 * line
    return {
        "length": np.array(length),
        "stiffness": np.array([[*b.stiffness_shear_extension, *b.stiffness_bending_torsion] for b in backbones]),
        "rest": np.array([[0.0, 0.0, 1.0, *b.rest_curvature_1_m] for b in backbones]),
        "masses": masses,
        "present": np.array(owner)[:, None] <= robot.tendon_segments[None, :],
        "offsets": robot.tendon_offsets,
    }


def _nodes(chain: dict[str, np.ndarray], strain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turn = rotation_from_vector(strain[:, 3:] * chain["length"][:, None])
    half = rotation_from_vector(0.5 * strain[:, 3:] * chain["length"][:, None])
    nodes, frames = np.zeros((len(strain) + 1, 3)), np.zeros((len(strain) + 1, 3, 3))
    frames[0] = np.eye(3)
    for k in range(len(strain)):
        frames[k + 1] = frames[k] @ turn[k]
        nodes[k + 1] = nodes[k] + frames[k] @ half[k] @ strain[k, :3] * chain["length"][k]
    return nodes, frames


def _energy(
    chain: dict[str, np.ndarray], strain: np.ndarray, tensions: np.ndarray, loads: dict[str, np.ndarray]
) -> tuple[float, np.ndarray]:
    """Returns the potential energy and its gradient with respect to the strains of the elements."""
    h, step = chain["length"], strain - chain["rest"]
    along = strain[:, None, :3] + np.cross(strain[:, None, 3:], chain["offsets"][None])
    size = np.linalg.norm(along, axis=2)
    pull = np.where(chain["present"], tensions, 0.0)
    nodes, frames = _nodes(chain, strain)
    force = chain["masses"][:, None] * loads["gravity"]
    force[-1] += loads["tip_force"]
    value = 0.5 * (chain["stiffness"] * step**2).sum(axis=1) @ h + (pull * size).sum(axis=1) @ h - (force * nodes).sum()
    direction = along / size[:, :, None] * pull[:, :, None]
    gradient = chain["stiffness"] * step
    gradient[:, :3] += direction.sum(axis=1)
    gradient[:, 3:] += np.cross(chain["offsets"][None], direction).sum(axis=1)
    gradient *= h[:, None]
    # Virtual work of the forces beyond each element, by rotations of its end about its own node.
    beyond = np.cumsum(force[::-1], axis=0)[::-1][1:]
    about_origin = np.cumsum(np.cross(nodes, force)[::-1], axis=0)[::-1][1:]
    moment = about_origin - np.cross(nodes[1:], beyond)
    for k in range(len(strain)):
        full, half = strain[k, 3:] * h[k], 0.5 * strain[k, 3:] * h[k]
        middle = frames[k] @ rotation_from_vector(half)
        chord = middle @ strain[k, :3] * h[k]
        gradient[k, :3] -= h[k] * middle.T @ beyond[k]
        gradient[k, 3:] -= h[k] * _left(full).T @ frames[k].T @ moment[k]
        gradient[k, 3:] -= 0.5 * h[k] * _left(half).T @ frames[k].T @ np.cross(chord, beyond[k])
    return float(value), gradient


def _left(vector: np.ndarray) -> np.ndarray:
    """Returns the left Jacobian of SO(3): the rotation by which exp(vector) turns for a change of vector."""
    angle = np.linalg.norm(vector)
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-4:
        return np.asarray(np.eye(3) + 0.5 * cross + cross @ cross / 6.0)
    return np.asarray(
        np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * cross + (angle - np.sin(angle)) / angle**3 * cross @ cross
    )


def _best(run: Callable[[], object], repeats: int = 5) -> float:
    run()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if not information.exists():
        return platform.processor()
    lines = [
        line.split(":", 1)[1].strip() for line in information.read_text().splitlines() if line.startswith("model name")
    ]
    return f"{lines[0]}, {len(lines)} cores" if lines else platform.processor()


if __name__ == "__main__":
    main()
