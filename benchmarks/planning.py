"""Times the search, plan and verify on the shipped scenes, and how the time grows, with ratios from one run.

python benchmarks/planning.py [--quick] [--seeds 20] [--out DIR]
    [--only rate,scenarios,reference,planners,restarts,growth]

Times are CPU seconds of this process, on one thread: what else runs on the machine hardly moves them.
"""

from __future__ import annotations

import argparse
import importlib.util
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import platform
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import RobotBody, Shaft
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.planning import ompl_run
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.offered import OMPL_TRAITS
from tdcr_planner.planning.planners import search
from tdcr_planner.planning.scenario import Goal, Scenario, Start, load_scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker, planning_margins
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.reference import ReferenceShape

SCENES = Path(__file__).parents[1] / "scenes"
PIPE = SCENES / "duct" / "scenario_narrowing.toml"
COMPARED = ("duct/scenario_elbow.toml", "duct/scenario_narrowing.toml", "airway/scenario_left_upper.toml")
PLANNERS_LIMIT_S = 3.0
TREES_ALONE: dict[str, str | float | int | bool] = {"plain_motions": False, "retraction": False}
# Much open space before the mouth: how much farther back the base stands, m, and the insertion at the start, m.
OPEN_SPACE = {
    "airway/scenario_left_upper.toml": (0.0, 0.0),
    "airway/scenario_right_middle.toml": (0.0, 0.0),
    "blades/scenario_next_passage.toml": (0.08, 0.0),
    "duct/scenario_narrowing.toml": (0.08, 0.0),
}
Curves = dict[str, list[tuple[float, list[float]]]]
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
                report, _ = session.verifier(scenario, refine=10).verify(path_rows(session.space, result.path))
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


def planners(names: tuple[str, ...], seeds: int) -> None:
    """Prints for each planner how often its path is found and verified, how long it takes, how long the path is.

    Time limits run on the processor's clock here, so that a busy machine takes nothing from a planner.
    """
    time.monotonic = time.process_time
    print(f"\n## Planners, {PLANNERS_LIMIT_S:g} s each: found, verified, CPU seconds, body motion along the path in mm")
    for name in names:
        session = PlanningSession(load_scenario(SCENES / name))
        scale = session.checker().motion_scale
        for planner in OMPL_TRAITS:
            found, verified, times, lengths = 0, 0, [], []
            for seed in range(1, seeds + 1):
                query = session.scenario.with_planner(
                    name=planner, seed=seed, time_limit_s=PLANNERS_LIMIT_S, parameters=TREES_ALONE
                )
                seconds, result = cpu_seconds(lambda: session.plan(query))  # noqa: B023
                times.append(seconds)
                verified += result.status is PlanStatus.VERIFIED
                if result.path is not None:
                    found += 1
                    moves = np.diff(path_rows(session.space, result.path), axis=0) * scale
                    lengths.append(1e3 * float(np.linalg.norm(moves, axis=1).sum()))
            length = f"{np.median(lengths):7.0f}" if lengths else "   none"
            counts = f"found {found} verified {verified} of {seeds}"
            print(f"{name:32s} {planner:16s} {counts}, {quartiles(times)} s, {length} mm", flush=True)


def restarts(seeds: int) -> None:
    """Prints how many iterations RRTConnect needs with and without starting its trees again, much open space ahead."""
    print(f"\n## Iterations of RRTConnect, {seeds} seeds: quartiles, 95 %, most; with and without starting again")
    first = ompl_run.FIRST_TREE
    for name, (retracted_m, insertion_m) in OPEN_SPACE.items():
        scenario = load_scenario(SCENES / name).with_planner(parameters=TREES_ALONE)
        session = PlanningSession(retracted(scenario, retracted_m, insertion_m))
        for label, tree in (("started again", first), ("one tree", 10**9)):
            ompl_run.FIRST_TREE = tree
            counts, times = [], []
            for seed in range(1, seeds + 1):
                checker = session.checker()
                seconds, outcome = cpu_seconds(
                    lambda: search(session.scenario, session.space, checker, seed=seed, time_limit_s=60.0)  # noqa: B023
                )
                counts.append(outcome.statistics["iterations"])
                times.append(seconds)
            shares = " ".join(f"{value:6.0f}" for value in np.percentile(counts, [25, 50, 75, 95, 100]))
            print(f"{name:32s} {label:14s} {shares}, at most {max(times):.2f} CPU s", flush=True)
    ompl_run.FIRST_TREE = first


def retracted(scenario: Scenario, by_m: float, insertion_m: float) -> Scenario:
    """Returns a scenario whose base stands farther back, with as much more travel, and whose robot starts there."""
    base = scenario.file.base
    assert base.insertion_m is not None
    place = scenario.base_position - by_m * scenario.base_rotation[:, 2]
    travel = (base.insertion_m[0], base.insertion_m[1] + by_m)
    goal = scenario.goals[0]
    if goal.bending_n is not None:
        goal = goal.model_copy(update={"insertion_m": goal.insertion_m + by_m})
    return changed(
        scenario,
        base=base.model_copy(update={"position_m": tuple(place.tolist()), "insertion_m": travel}),
        start=scenario.file.start.model_copy(update={"insertion_m": insertion_m}),
        goal=goal,
    )


def changed(scenario: Scenario, **update: Any) -> Scenario:
    """Returns a scenario with some tables of its file replaced."""
    return Scenario(scenario.path, scenario.sha256, scenario.file.model_copy(update=update), scenario.robot)


def search_seconds(scenario: Scenario, meshes: Sequence[SceneMesh], model: ShapeModel, seeds: int) -> list[float]:
    """Returns the CPU seconds of searches in a scene that is built here, NaN where no path was found."""
    radius = scenario.file.base.shaft_radius_m
    shaft = None if radius is None else Shaft(radius, scenario.base_position)
    space = ConfigurationSpace(scenario)
    body = RobotBody(scenario.robot, planning_margins(scenario, model), shaft)
    scene = CollisionScene(meshes, body)
    times = []
    for seed in range(1, seeds + 1):
        checker = ValidityChecker(space, model, scene)
        seconds, outcome = cpu_seconds(lambda: search(scenario, space, checker, seed=seed, time_limit_s=60.0))  # noqa: B023
        times.append(seconds if outcome.found else np.nan)
    return times


def growth(seeds: int, out: Path | None, largest: int) -> None:
    """Prints and plots how the time of a search grows with triangles, clearance, step and degrees of freedom."""
    session = PlanningSession(load_scenario(PIPE))
    plain, model = session.scenario, session.model("learned")
    search_seconds(plain, session.meshes, model, 1)
    curves: Curves = {name: [] for name in ("triangles of the mesh", "clearance asked, mm", "step, mm")}
    for mesh in refined_meshes(session.meshes[0], largest):
        curves["triangles of the mesh"].append((len(mesh.faces), search_seconds(plain, (mesh,), model, seeds)))
    for clearance in (0.0, 0.0005, 0.001, 0.0015):
        query = plain.with_planner(clearance_m=clearance)
        curves["clearance asked, mm"].append((1e3 * clearance, search_seconds(query, session.meshes, model, seeds)))
    for step in (0.0005, 0.001, 0.002, 0.003):
        query = plain.with_planner(step_m=step)
        curves["step, mm"].append((1e3 * step, search_seconds(query, session.meshes, model, seeds)))
    curves["degrees of freedom"] = degrees_of_freedom(seeds)
    print("\n## How the search grows: CPU seconds, median [quartiles], and searches that found a path")
    for name, points in curves.items():
        for value, times in points:
            good = [seconds for seconds in times if np.isfinite(seconds)]
            text = quartiles(good) if good else "none"
            print(f"{name:22s} {value:10.4g} {text:>25s} {len(good):3d} of {len(times)}")
    if out is not None:
        plot(curves, out)


def refined_meshes(shipped: SceneMesh, largest: int) -> Iterator[SceneMesh]:
    """Yields the duct at growing resolution: with coarser rings, as shipped, and with its triangles split in four."""
    path = SCENES / "duct" / "make_scene.py"
    spec = importlib.util.spec_from_file_location("make_duct", path)
    assert spec is not None
    assert spec.loader is not None
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    surfaces = []
    for coarser in (4, 2):
        maker.RING_SPACING, maker.SEGMENTS = 3.0 * coarser, 64 // coarser
        surface = maker.make_duct()
        surface.apply_scale(1e-3)
        surfaces.append(surface)
    surfaces.append(trimesh.Trimesh(shipped.vertices, shipped.faces, process=False))
    while 4 * len(surfaces[-1].faces) <= largest:
        surfaces.append(surfaces[-1].subdivide())
    for surface in surfaces:
        entry = shipped.entry
        assert entry is not None
        yield SceneMesh.from_arrays(
            shipped.name, surface.vertices, surface.faces, shipped.role, entry.point, entry.normal
        )


def degrees_of_freedom(seeds: int) -> list[tuple[float, list[float]]]:
    """Returns search times into the duct's elbow with 2 to 8 degrees of freedom, the reference as validity in all.

    The robot `paper` is cut into one, two or three segments of the same length in all; insertion comes with 3, 5 and
    7, roll with 4, 6 and 8. All bring their tips to the same place. With 2 the robot stands in the mouth and swings.
    """
    points: list[tuple[float, list[float]]] = []
    elbow = load_scenario(SCENES / "duct" / "scenario_elbow.toml").with_planner(validity="reference")
    session = PlanningSession(elbow)
    ends = elbow.goals[0]
    assert ends.bending_n is not None
    row = session.space.row(ends.bending_n, ends.insertion_m)
    tip = session.checker().world_poses(row[None])[0][0, -1]
    for dimension in range(2, 9):
        segments = max(1, (dimension - 1) // 2)
        roll = (-180.0, 180.0) if dimension in (4, 6, 8) else None
        scenario = Scenario(elbow.path, elbow.sha256, elbow.file, cut_into_segments(elbow.robot, segments))
        scenario = changed(
            scenario,
            base=elbow.file.base.model_copy(update={"roll_deg": roll}),
            start=Start(bending_n=((0.0, 0.0),) * segments),
            goal=Goal(tip_position_m=tuple(tip.tolist())),
        )
        if dimension == 2:
            place = elbow.base_position + 0.15 * elbow.base_rotation[:, 2]
            scenario = changed(
                scenario,
                base=elbow.file.base.model_copy(update={"position_m": tuple(place.tolist()), "insertion_m": None}),
                start=Start(bending_n=((0.0, 0.2),)),
                goal=Goal(bending_n=((0.0, -0.2),)),
            )
        model = ReferenceShape(scenario.robot)
        points.append((dimension, search_seconds(scenario, session.meshes, model, seeds)))
    return points


def cut_into_segments(robot: RobotSpec, count: int) -> RobotSpec:
    """Returns a robot of one segment cut into equal ones, the tendons of each between those of the others."""
    whole = robot.segments[0]
    parts = tuple(
        whole.model_copy(
            update={
                "length_m": whole.length_m / count,
                "disks": whole.disks // count,
                "tendon_angles_deg": tuple(
                    (angle + 120.0 * index / count) % 360.0 for angle in whole.tendon_angles_deg
                ),
            }
        )
        for index in range(count)
    )
    return robot.model_copy(update={"segments": parts})


def plot(curves: Curves, out: Path) -> None:
    """Writes planning_growth.png: median and quartiles against each thing that grows."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9.0, 6.4), layout="constrained")
    for axis, (name, points) in zip(axes.flat, curves.items(), strict=True):
        kept = [(value, [s for s in times if np.isfinite(s)]) for value, times in points]
        kept = [(value, times) for value, times in kept if times]
        values = [value for value, _ in kept]
        low, middle, high = np.array([np.percentile(times, [25, 50, 75]) for _, times in kept]).T
        axis.errorbar(values, middle, [middle - low, high - middle], marker="o", capsize=3)
        axis.set_xlabel(name)
        axis.set_ylabel("search, CPU s")
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.3)
        if name in ("triangles of the mesh", "step, mm"):
            axis.set_xscale("log")
        if name == "step, mm":
            axis.set_xticks(values, [f"{value:g}" for value in values], minor=False)
            axis.set_xticks([], minor=True)
        if name == "degrees of freedom":
            axis.set_title("reference as validity", fontsize="medium")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "planning_growth.png", dpi=110)


def main() -> None:
    """Runs the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three scenarios, two seeds, small meshes")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", default="rate,scenarios,reference,planners,restarts,growth")
    parser.add_argument("--out", type=Path, default=None, help="folder for planning_growth.png")
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
    if "restarts" in parts:
        restarts(3 * seeds)
    if "growth" in parts:
        growth(min(seeds, 5), arguments.out, 30_000 if arguments.quick else 1_200_000)
    if "planners" in parts:
        planners(COMPARED[: 1 if arguments.quick else 3], min(seeds, 5))


if __name__ == "__main__":
    main()
