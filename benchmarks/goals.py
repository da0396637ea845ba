"""How surely goal states are found: near the limits, where tendons change over, with a viewing direction.

python benchmarks/goals.py [--targets 40] [--out-of scenes/airway/scenario_left_main.toml ...]

Targets are tips of random configurations within the limits, so that each can be reached; collisions are left aside. A
round is what `TipGoal.search` does once. Differences of two sizes stand for how much an exact derivative could gain.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import time
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning import goal as goals
from tdcr_planner.planning.scenario import Goal, load_scenario
from tdcr_planner.planning.validity import ValidityChecker, sample_within_tensions
from tdcr_planner.query.session import PlanningSession

SCENES = Path(__file__).parents[1] / "scenes"
SCENARIOS = [SCENES / "airway" / f"scenario_{name}.toml" for name in ("left_main", "roll")]
ROUNDS = 4
DIFFERENCES_M = (1e-3, 1e-5)


class Unobstructed(ValidityChecker):
    """A checker to which every configuration is valid."""

    def check(self, rows: FloatArray) -> np.ndarray:
        """Returns 0 for all rows."""
        return np.zeros(len(rows), dtype=np.int8)


def at_tension_limits(checker: ValidityChecker, rows: FloatArray) -> FloatArray:
    """Returns rows whose bending vectors are stretched until a tendon of each segment is at its limit."""
    robot, rows = checker.robot, rows.copy()
    shares = checker.actuate(rows).tensions / robot.max_tensions
    for index in range(robot.segment_count):
        rows[:, 2 * index : 2 * index + 2] *= 0.9999 / shares[:, robot.tendon_segments == index].max(axis=1)[:, None]
    return rows


def on_kinks(checker: ValidityChecker, rows: FloatArray) -> FloatArray:
    """Returns rows whose bending vectors point at a tendon, where the tension map has a kink."""
    robot, rows = checker.robot, rows.copy()
    for index in range(robot.segment_count):
        columns = slice(2 * index, 2 * index + 2)
        angles = np.resize(robot.tendon_angles[robot.tendon_segments == index], len(rows))
        size = np.linalg.norm(rows[:, columns], axis=1)
        limit = robot.max_tensions[robot.tendon_segments == index].min()
        rows[:, columns] = np.minimum(size, limit)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return rows


def at_travel_limits(checker: ValidityChecker, rows: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Returns rows with insertion and roll at one of their ends."""
    space, rows = checker.space, rows.copy()
    for column in range(space.bending_count, space.dimension):
        rows[:, column] = generator.choice([space.lower[column], space.upper[column]], len(rows))
    return rows


def measure(checker: ValidityChecker, rows: FloatArray, view: bool) -> str:
    """Returns as text how often one round and some rounds reach the tips of rows, with how many states and how fast."""
    positions, rotations, _ = checker.world_poses(rows)
    first, later, reached, distinct, seconds = 0, 0, [], [], []
    for index in range(len(rows)):
        query = {"tip_position_m": tuple(positions[index, -1].tolist())}
        if view:
            query["view_direction"] = tuple(rotations[index, -1, :, 2].tolist())
        source = goals.TipGoal(checker, Goal(**query), index + 1)
        begin = time.process_time()
        source.search()
        seconds.append(time.process_time() - begin)
        first += source.reached > 0
        reached.append(source.reached)
        distinct.append(len(source.rows))
        while not source.reached and source.rounds < ROUNDS:
            source.search()
        later += source.reached > 0
    counts = f"in one round {first:3d}, in {ROUNDS} {later:3d} of {len(rows)}"
    states = f"{np.median(reached):3.0f} of 96 reach it, {np.median(distinct):3.0f} distinct"
    return f"{counts}; a round: {states}, {1e3 * np.median(seconds):3.0f} ms CPU"


def main() -> None:
    """Prints a line for each scenario, kind of target, size of difference, and with and without a direction."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", type=int, default=40)
    parser.add_argument("--out-of", type=Path, nargs="+", default=SCENARIOS, dest="files")
    arguments = parser.parse_args()
    for file in arguments.files:
        session = PlanningSession(load_scenario(file))
        known = session.checker()
        checker = Unobstructed(session.space, known.model, known.scene)
        generator = np.random.default_rng(5)
        inside = sample_within_tensions(checker, arguments.targets, generator)
        limit = at_tension_limits(checker, inside)
        cases = {
            "inside": inside,
            "tension limits": limit,
            "kinks": on_kinks(checker, inside),
            "tension and travel limits": at_travel_limits(checker, limit, generator),
        }
        print(f"\n## {file.parent.name}/{file.name}, {session.space.dimension} degrees of freedom")
        for view in (False, True):
            for case, rows in cases.items():
                for difference in DIFFERENCES_M:
                    goals._DIFFERENCE_M = difference
                    name = f"{case}{', direction' if view else ''}"
                    print(f"{name:36s} difference {difference:g} m: {measure(checker, rows, view)}", flush=True)


if __name__ == "__main__":
    main()
