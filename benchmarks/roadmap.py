"""Times queries through a roadmap against a fresh search of the same pairs in the same scene, with ratios from one run.

python benchmarks/roadmap.py [--quick] [--pairs 24] [--seconds 10] [--limit 5] [--seeds 3] [--only scenes,pairs]
                             [--scenes duct,blades,airway]

scenes: the shipped scenarios of each scene, asked of one roadmap a scene (one more where robot or base differ).
pairs: random pairs of valid configurations, drawn alike from every sixth of the insertion.

Times are CPU seconds of this process, on one thread: what else runs on the machine hardly moves them.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import dataclasses
import platform
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import ConfigurationGoal
from tdcr_planner.planning.roadmap import Roadmap
from tdcr_planner.planning.roadmap_way import RoadmapConnector
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.planning.validity import sample_within_tensions
from tdcr_planner.query.result import PlanResult, PlanStatus
from tdcr_planner.query.session import PlanningSession

SCENES = Path(__file__).parents[1] / "scenes"
PAIRS_IN = {
    "duct": "duct/scenario_weight.toml",
    "blades": "blades/scenario_passage.toml",
    "airway": "airway/scenario_right_main.toml",
}
RANGES = 6
DRAWN = 2000
MOST_DRAWN = 200_000
TIME_LIMIT_S = 600.0  # by the clock, far above the limit in CPU seconds that ends a query


def cpu_seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Returns the CPU seconds that a call takes, and what it returns."""
    begin = time.process_time()
    answer = work()
    return time.process_time() - begin, answer


def build(session: PlanningSession, seconds: float) -> tuple[Roadmap, float]:
    """Returns a roadmap built for so many CPU seconds, and how many they were."""
    builder = session.roadmap_builder(seed=1)
    begin = time.process_time()
    while time.process_time() - begin < seconds:
        builder.run(vertices=builder.vertices + 100, time_limit_s=60.0)
    return builder.roadmap(), time.process_time() - begin


def size_on_disk(roadmap: Roadmap) -> tuple[float, float]:
    """Returns the megabytes of a roadmap's file and the seconds that reading it takes."""
    with tempfile.TemporaryDirectory() as folder:
        file = roadmap.save(Path(folder) / "roadmap.npz")
        seconds, _ = cpu_seconds(lambda: Roadmap.load(file))
        return file.stat().st_size / 1e6, seconds


def valid_rows(session: PlanningSession, count: int, generator: np.random.Generator) -> FloatArray:
    """Returns valid configurations, `count` from every range of insertion (fewer where hardly any is valid)."""
    checker, column = session.checker(), session.space.bending_count
    low, high = session.space.lower[column], session.space.upper[column]
    found = []
    for part in range(RANGES):
        kept: list[FloatArray] = []
        for _ in range(MOST_DRAWN // DRAWN):
            rows = sample_within_tensions(checker, DRAWN, generator)
            rows[:, column] = low + (part + generator.uniform(size=DRAWN)) / RANGES * (high - low)
            kept.extend(rows[checker.valid(rows)])
            if len(kept) >= count:
                break
        found += kept[:count]
    return np.array(found)


def between(session: PlanningSession, start: FloatArray, goal: FloatArray, seed: int) -> Scenario:
    """Returns the session's scenario with another start and another goal configuration."""
    scenario = session.scenario
    ends = []
    for row in (start[None], goal[None]):
        bending = tuple(map(tuple, session.space.bending(row)[0].tolist()))
        roll = float(np.rad2deg(session.space.roll(row)[0]))
        ends.append({"bending_n": bending, "insertion_m": float(session.space.insertion(row)[0]), "roll_deg": roll})
    file = scenario.file
    update = {
        "start": type(file.start).model_validate(ends[0]),
        "goal": type(scenario.goals[0]).model_validate(ends[1]),
        "goals": None,
    }
    query = dataclasses.replace(scenario, file=file.model_copy(update=update))
    return query.with_planner(seed=seed, time_limit_s=TIME_LIMIT_S)


class SpentError(Exception):
    """A query has used up its CPU seconds."""


def ask(
    session: PlanningSession, queries: list[Scenario], limit_s: float
) -> tuple[list[PlanResult | None], FloatArray, FloatArray]:
    """Returns results (None where the time was spent) and CPU seconds: planning, planning with verification."""
    results, plans, totals = [], [], []
    for query in queries:
        begin = time.process_time()

        def spend(*_: Any) -> None:
            if time.process_time() - begin > limit_s:  # noqa: B023
                raise SpentError

        try:
            result = session.plan(query, progress=spend)
            share = result.timings_s["plan"] / max(result.timings_s["plan"] + result.timings_s["verify"], 1e-9)
        except SpentError:
            result, share = None, 1.0
        seconds = time.process_time() - begin
        results.append(result)
        plans.append(seconds * share)
        totals.append(seconds)
    return results, np.array(plans), np.array(totals)


def way(session: PlanningSession, roadmap: Roadmap, query: Scenario) -> FloatArray | None:
    """Returns the way of a query through a roadmap, as it is before it is shortened."""
    edges = EdgeChecker(session.checker(query), query.planner.step_m)
    ends = query.file.start, query.goals[0]
    start, goal = (session.space.row_of(end) for end in ends)
    return RoadmapConnector(roadmap).connect(edges, start, ConfigurationGoal(edges.checker, goal), np.inf)


def pairs(name: str, count: int, seconds: float, limit_s: float) -> None:
    """Prints queries a second through a roadmap and by fresh searches, for the same pairs."""
    scenario = load_scenario(SCENES / name)
    session = PlanningSession(scenario)
    generator = np.random.default_rng(7)
    rows = valid_rows(session, max(count // 3, 2), generator)
    ends = generator.integers(len(rows), size=(count, 2))
    queries = [between(session, rows[a], rows[b], index + 1) for index, (a, b) in enumerate(ends.tolist())]
    session.plan(queries[0])
    roadmap, built = build(session, seconds)
    megabytes, reading = size_on_disk(roadmap)
    planned = ask(session, queries, limit_s)
    session.use_roadmap(roadmap)
    session.plan(queries[0])
    asked = ask(session, queries, limit_s)
    print(
        f"\n## {name}: {count} random pairs of configurations, {session.space.dimension} degrees of freedom\n"
        f"roadmap: {built:.0f} s to build, {len(roadmap.rows):,} configurations, {len(roadmap.edges):,} motions, "
        f"{100 * roadmap.largest_share:.0f} % in one part, {megabytes:.2f} MB, read in {reading:.3f} s"
    )
    known = sum(result is not None and result.planner["roadmap"]["answered"] for result in asked[0])
    found = [
        np.array([result is not None and result.path is not None for result in results])
        for results in (planned[0], asked[0])
    ]
    either = found[0] | found[1]
    print(
        f"joined by either within {limit_s:g} s: {either.sum()} of {count}; by the roadmap without its planner: {known}"
    )
    rate: dict[str, tuple[float, float]] = {}
    print(f"{'':12s} {'verified':>9s} {'plan, ms: median [quartiles]':>30s} {'plan/s':>7s} {'plan+verify/s':>14s}")
    for label, (results, plans, totals) in ((scenario.planner.name, planned), ("roadmap", asked)):
        verified = sum(result is not None and result.status is PlanStatus.VERIFIED for result in results)
        low, middle, high = 1e3 * np.percentile(plans[either], [25, 50, 75])
        rate[label] = 1.0 / plans[either].mean(), 1.0 / totals[either].mean()
        text = f"{middle:.0f} [{low:.0f}, {high:.0f}]"
        print(f"{label:12s} {verified:9d} {text:>30s} {rate[label][0]:7.1f} {rate[label][1]:14.1f}")
    ways = [cpu_seconds(lambda: way(session, roadmap, query))[0] for query in queries]  # noqa: B023
    print(f"of which the way through the roadmap alone, median: {1e3 * np.median(ways):.1f} ms")
    (plain, both), (quick, quick_both) = rate[scenario.planner.name], rate["roadmap"]
    travels = [
        np.median([result.path.tip_travel for result, good in zip(some[0], found[0] & found[1], strict=True) if good])
        for some in (planned, asked)
    ]
    print(
        f"ratio: plan {quick / plain:.1f}, plan and verify {quick_both / both:.1f}; "
        f"tip travel where both found a path, median: {1e3 * travels[0]:.0f} and {1e3 * travels[1]:.0f} mm",
        flush=True,
    )


def scenes(folder: str, seconds: float, seeds: int) -> None:
    """Prints how the shipped scenarios of a scene fare, each asked of a roadmap that serves it, after a short build."""
    print(f"\n## Shipped scenarios of {folder}, {seconds:.0f} s of building a roadmap, seeds 1 to {seeds}")
    print(
        f"{'scenario':26s} {'status':>14s} {'by the roadmap':>15s} {'roadmap, s':>11s} {'search, s':>10s} {'ratio':>6s}"
    )
    sessions: list[tuple[PlanningSession, Roadmap]] = []
    for file in sorted((SCENES / folder).glob("scenario_*.toml")):
        scenario = load_scenario(file)
        session, roadmap = session_for(scenario, sessions, seconds)
        queries = [scenario.with_planner(seed=seed) for seed in range(1, seeds + 1)]
        session.use_roadmap(None)
        session.plan(queries[0])
        planned = ask(session, queries, np.inf)
        session.use_roadmap(roadmap)
        asked = ask(session, queries, np.inf)
        states = {result.status.value for result in asked[0] if result is not None}
        known = sum(result is not None and result.planner["roadmap"]["answered"] for result in asked[0])
        quick, plain = np.median(asked[2]), np.median(planned[2])
        name = file.stem.removeprefix("scenario_")
        print(
            f"{name:26s} {'/'.join(sorted(states)):>14s} {known:>9d} of {seeds:2d} {quick:11.3f} {plain:10.3f} "
            f"{plain / quick:6.1f}",
            flush=True,
        )


def session_for(
    scenario: Scenario, sessions: list[tuple[PlanningSession, Roadmap]], seconds: float
) -> tuple[PlanningSession, Roadmap]:
    """Returns a session of a scenario's scene with its roadmap, made where there is none."""
    for session, roadmap in sessions:
        try:
            session.plan(scenario.with_planner(time_limit_s=0.01))
        except InputError:
            continue
        return session, roadmap
    session = PlanningSession(scenario)
    session.plan()
    sessions.append((session, build(session, seconds)[0]))
    return sessions[-1]


def main() -> None:
    """Runs the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="ten pairs, one seed, two seconds of building, the duct")
    parser.add_argument("--pairs", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=10.0, help="CPU seconds of building a roadmap")
    parser.add_argument("--limit", type=float, default=5.0, help="CPU seconds that a query between a pair may take")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", default="scenes,pairs")
    parser.add_argument("--scenes", default="duct,blades,airway")
    arguments = parser.parse_args()
    quick = arguments.quick
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    print(f"{machine}, load {os.getloadavg()[0]:.1f}; CPU seconds")
    for folder in ["duct"] if quick else arguments.scenes.split(","):
        seconds = 2.0 if quick else arguments.seconds
        if "scenes" in arguments.only.split(","):
            scenes(folder, seconds, 1 if quick else arguments.seeds)
        if "pairs" in arguments.only.split(","):
            pairs(PAIRS_IN[folder], 10 if quick else arguments.pairs, seconds, arguments.limit)


if __name__ == "__main__":
    main()
