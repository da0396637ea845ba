"""Times the search, plan and verify on the shipped scenes, and how the time grows, with ratios from one run.

python benchmarks/planning.py [--quick] [--seeds 20] [--only rate,scenarios,reference,growth] [--out DIR]

Times are CPU seconds of this process, on one thread: what else runs on the machine hardly moves them.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import RobotBody, Shaft
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.ompl_planner import search
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker, planning_margins
from tdcr_planner.session import PlanningSession, PlanStatus

SCENES = Path(__file__).parents[1] / "scenes"
PIPE = SCENES / "duct" / "scenario_narrowing.toml"
QUICK = ("duct/scenario_elbow.toml", "duct/scenario_narrowing.toml", "blades/scenario_port.toml")


def cpu_seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Returns the CPU seconds that a call takes, and what it returns."""
    begin = time.process_time()
    answer = work()
    return time.process_time() - begin, answer


def quartiles(values: list[float]) -> str:
    """Returns median and quartiles as text, in seconds."""
    low, middle, high = np.percentile(values, [25, 50, 75])
    return f"{middle:7.3f} [{low:6.3f}, {high:6.3f}]"


class NaiveLoop:
    """The loop that the checker replaces: the model for one state, then FCL for one part of it after the other."""

    def __init__(self, session: PlanningSession, checker: ValidityChecker, torch: bool) -> None:
        self.model, self.scene, self.space = checker.model, checker.scene, session.space
        self._torch = torch

    def valid(self, row: FloatArray) -> bool:
        """Returns whether one state is valid."""
        actuation = self.space.actuate(row[None])
        if (actuation.tensions > self.space.robot.max_tensions).any():
            return False
        inputs = actuation.tensions, actuation.gravity, actuation.tip_force
        if self._torch:
            positions, rotations = self.model._run_torch(*inputs)
        else:
            poses = self.model.disk_poses(inputs[0], gravity=inputs[1], tip_force=inputs[2])
            positions, rotations = poses.positions, poses.rotations
        base = actuation.base_rotations
        positions = positions @ np.swapaxes(base, 1, 2) + actuation.base_positions[:, None]
        rotations = base[:, None] @ rotations
        return self.scene.first_contact(positions[0], rotations[0]) is None


def edges_of_a_search(session: PlanningSession, seeds: range) -> list[tuple[FloatArray, FloatArray]]:
    """Returns the edges that searches ask about, in their order."""
    asked: list[tuple[FloatArray, FloatArray]] = []

    class Recorder(EdgeChecker):
        def check_edge(self, row_a: FloatArray, row_b: FloatArray) -> bool:
            asked.append((row_a.copy(), row_b.copy()))
            return super().check_edge(row_a, row_b)

    for seed in seeds:
        checker = session.checker()
        recorder = Recorder(checker, session.scenario.planner.step_m)
        search(session.scenario, session.space, checker, seed=seed, edges=recorder, time_limit_s=20.0)
    return asked


def rate(seeds: int) -> None:
    """Prints checked states a second in the search, against the naive loop on the same edges."""
    session = PlanningSession(load_scenario(PIPE))
    edges = edges_of_a_search(session, range(1, seeds + 1))
    checker = session.checker()
    fast = EdgeChecker(checker, session.scenario.planner.step_m)
    for ends in edges:
        fast.check_edge(*ends)
    checker = session.checker()
    fast = EdgeChecker(checker, session.scenario.planner.step_m)
    seconds, verdicts = cpu_seconds(lambda: [fast.check_edge(*ends) for ends in edges])
    quick = checker.states_checked / seconds

    print(f"\n## Checked states a second, {PIPE.parent.name}/{PIPE.name}, {len(edges)} edges of {seeds} searches")
    print(f"{'this checker, whole edges':44s} {quick:9.0f} states/s")
    for torch, share, name in ((True, 10, "torch"), (False, 100, "compiled model")):
        naive = NaiveLoop(session, session.checker(), torch)
        chosen = np.random.default_rng(1).permutation(len(edges))[: share * seeds]
        states = {int(index): fast.subdivide(*edges[index])[::-1] for index in chosen}
        naive.valid(edges[0][0])
        asked: list[FloatArray] = []
        seconds, answers = cpu_seconds(lambda: {i: walk(naive, rows, asked) for i, rows in states.items()})  # noqa: B023
        slow = len(asked) / seconds
        agreeing = sum(answers[index] == verdicts[index] for index in states)
        same = sum(bool(checker.valid(row[None])[0]) == naive.valid(row) for row in asked[: 100 * seeds])
        print(
            f"{f'naive loop, {name} and FCL state by state':44s} {slow:9.0f} states/s, ratio {quick / slow:6.1f}",
            end="",
        )
        print(f"; same verdict on {agreeing} of {len(states)} edges, {same} of {len(asked[: 100 * seeds])} states")


def walk(naive: NaiveLoop, rows: FloatArray, asked: list[FloatArray]) -> bool:
    """Returns whether all states of an edge are valid, asked one by one until one is not; adds them to asked."""
    for row in rows:
        asked.append(row)
        if not naive.valid(row):
            return False
    return True


def scenarios(files: list[Path], seeds: int) -> None:
    """Prints plan and verify times, successes and repairs of each scenario, and a re-check at ten times finer steps."""
    print("\n## Plan and verify, models and scene loaded: CPU seconds, median [quartiles]")
    print(f"{'scenario':34s} {'plan + verify':>25s} {'as expected':>12s} {'unrepaired':>11s} {'re-checked':>11s}")
    found = unrepaired = confirmed = checked = 0
    for file in files:
        scenario = load_scenario(file)
        session = PlanningSession(scenario)
        session.plan()
        times, expected, clean, sound, total = [], 0, 0, 0, 0
        for seed in range(1, seeds + 1):
            seconds, result = cpu_seconds(lambda: session.plan(scenario.with_planner(seed=seed)))  # noqa: B023
            times.append(seconds)
            expected += result.status.value == scenario.file.expected_status
            if result.path is not None:
                found += 1
                unrepaired += result.repairs == 0 and result.status is PlanStatus.VERIFIED
                total += 1
                clean += result.repairs == 0 and result.status is PlanStatus.VERIFIED
            if result.status is PlanStatus.VERIFIED and seed <= 3:
                report, _ = session.verifier(scenario, refine=10).verify(session.rows(result.path))
                checked += 1
                confirmed += report.verified
                sound += report.verified
        name = f"{file.parent.name}/{file.stem.removeprefix('scenario_')}"
        line = f"{name:34s} {quartiles(times):>25s} {expected:>6d} of {seeds:2d} {clean:>5d} of {total:2d}"
        print(f"{line} {sound:>5d} of {min(seeds, 3) if total else 0}", flush=True)
    print(
        f"verified without repair: {unrepaired} of {found} paths; re-checked ten times finer: {confirmed} of {checked}"
    )


def against_reference(files: list[Path], seeds: int) -> None:
    """Prints the time of the search with the reference as validity over that with the learned model."""
    print("\n## Search with the reference as validity, CPU seconds")
    print(f"{'scenario':34s} {'learned':>25s} {'reference':>25s} {'ratio':>7s}")
    for file in files:
        session = PlanningSession(load_scenario(file))
        times: dict[str, list[float]] = {"learned": [], "reference": []}
        for validity, kept in times.items():
            query = session.scenario.with_planner(validity=validity, time_limit_s=120.0)
            for seed in range(1, seeds + 1):
                checker = session.checker(query)
                kept.append(cpu_seconds(lambda: search(query, session.space, checker, seed=seed))[0])  # noqa: B023
        ratio = np.median(times["reference"]) / np.median(times["learned"])
        name = f"{file.parent.name}/{file.stem.removeprefix('scenario_')}"
        print(f"{name:34s} {quartiles(times['learned']):>25s} {quartiles(times['reference']):>25s} {ratio:7.1f}")


def search_seconds(
    scenario: Scenario, meshes: tuple[SceneMesh, ...], session: PlanningSession, seeds: int
) -> list[float]:
    """Returns the CPU seconds of searches in a scene that is built here."""
    radius = scenario.file.base.shaft_radius_m
    shaft = None if radius is None else Shaft(radius, scenario.base_position)
    space = ConfigurationSpace(scenario)
    model = session.model("learned")
    body = RobotBody(scenario.robot, planning_margins(scenario, model), shaft)
    scene = CollisionScene(meshes, body)
    times = []
    for seed in range(1, seeds + 1):
        checker = ValidityChecker(space, model, scene)
        seconds, outcome = cpu_seconds(lambda: search(scenario, space, checker, seed=seed, time_limit_s=20.0))  # noqa: B023
        times.append(seconds if outcome.found else np.nan)
    return times


def growth(seeds: int, out: Path | None, largest: int) -> None:
    """Prints and plots how the time of a search grows with triangles, clearance, step and degrees of freedom."""
    session = PlanningSession(load_scenario(PIPE))
    plain = session.scenario
    curves: dict[str, list[tuple[float, list[float]]]] = {"triangles": [], "clearance, mm": [], "step, mm": []}
    mesh = session.meshes[0]
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    while len(surface.faces) <= largest:
        refined = SceneMesh.from_arrays(
            mesh.name, surface.vertices, surface.faces, mesh.role, mesh.entry.point, mesh.entry.normal
        )
        curves["triangles"].append((len(surface.faces), search_seconds(plain, (refined,), session, seeds)))
        surface = surface.subdivide()
    for clearance in (0.0, 0.0005, 0.001, 0.0015):
        query = plain.with_planner(clearance_m=clearance)
        curves["clearance, mm"].append((1e3 * clearance, search_seconds(query, session.meshes, session, seeds)))
    for step in (0.0005, 0.001, 0.002, 0.003):
        query = plain.with_planner(step_m=step)
        curves["step, mm"].append((1e3 * step, search_seconds(query, session.meshes, session, seeds)))
    curves["degrees of freedom"] = degrees_of_freedom(seeds)
    print("\n## How the search grows: CPU seconds, median [quartiles], and searches that found a path")
    for name, points in curves.items():
        for value, times in points:
            good = [seconds for seconds in times if np.isfinite(seconds)]
            text = quartiles(good) if good else "none"
            print(f"{name:20s} {value:10.4g} {text:>25s} {len(good):3d} of {len(times)}")
    if out is not None:
        plot(curves, out)


def degrees_of_freedom(seeds: int) -> list[tuple[float, list[float]]]:
    """Returns search times for the same kind of query with 2 to 6 degrees of freedom, on the blades and the airway."""
    points: list[tuple[float, list[float]]] = []
    cases = {
        2: ("duct/scenario_elbow.toml", {"insertion_m": None, "roll_deg": None}),
        3: ("duct/scenario_elbow.toml", {}),
        4: ("duct/scenario_elbow.toml", {"roll_deg": (-180.0, 180.0)}),
        5: ("airway/scenario_trachea.toml", {"roll_deg": None}),
        6: ("airway/scenario_trachea.toml", {"roll_deg": (-180.0, 180.0)}),
    }
    for dimension, (name, changes) in cases.items():
        scenario = load_scenario(SCENES / name)
        base = scenario.file.base.model_copy(update=changes)
        update: dict[str, Any] = {"base": base}
        if dimension == 2:
            # Without travel: the robot stands inserted and swings from one side of the pipe to the other.
            held = scenario.file.start.model_copy(update={"insertion_m": 0.0})
            update["start"] = held
            update["goal"] = scenario.goals[0].model_copy(update={"insertion_m": 0.0, "bending_n": ((0.3, 0.3),)})
        scenario = Scenario(scenario.path, scenario.sha256, scenario.file.model_copy(update=update), scenario.robot)
        session = PlanningSession(scenario)
        if session.space.dimension != dimension:
            continue
        points.append((dimension, search_seconds(scenario, session.meshes, session, seeds)))
    return points


def plot(curves: dict[str, list[tuple[float, list[float]]]], out: Path) -> None:
    """Writes planning.png: median and quartiles against each thing that grows."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(curves), figsize=(4 * len(curves), 3.5), layout="constrained")
    for axis, (name, points) in zip(axes, curves.items(), strict=True):
        kept = [(value, [s for s in times if np.isfinite(s)]) for value, times in points]
        kept = [(value, times) for value, times in kept if times]
        values = [value for value, _ in kept]
        low, middle, high = np.array([np.percentile(times, [25, 50, 75]) for _, times in kept]).T
        axis.errorbar(values, middle, [middle - low, high - middle], marker="o", capsize=3)
        axis.set_xlabel(name)
        axis.set_ylabel("search, CPU s")
        axis.set_ylim(bottom=0.0)
        if name == "triangles":
            axis.set_xscale("log")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "planning.png", dpi=120)


def main() -> None:
    """Runs the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three scenarios, two seeds, small meshes")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", default="rate,scenarios,reference,growth")
    parser.add_argument("--out", type=Path, default=None, help="folder for planning.png")
    arguments = parser.parse_args()
    seeds = min(arguments.seeds, 2) if arguments.quick else arguments.seeds
    files = [SCENES / name for name in QUICK] if arguments.quick else sorted(SCENES.glob("*/scenario_*.toml"))
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    print(f"{machine}, load {os.getloadavg()[0]:.1f}")
    parts = arguments.only.split(",")
    if "rate" in parts:
        rate(min(seeds, 5))
    if "scenarios" in parts:
        scenarios(files, seeds)
    if "reference" in parts:
        against_reference([SCENES / name for name in QUICK[: 1 if arguments.quick else 3]], min(seeds, 3))
    if "growth" in parts:
        growth(min(seeds, 5), arguments.out, 30_000 if arguments.quick else 1_200_000)


if __name__ == "__main__":
    main()
