"""Inspection measured: speed and exactness of visibility, coverage within the time, length beside two baselines.

    python benchmarks/inspection.py                      all of it, ten seeds of 60 s each
    python benchmarks/inspection.py --seeds 2 --time 20  a short look
    python benchmarks/inspection.py --visibility         speed and exactness alone

Every ratio is measured in one run. Times of the visibility tests are processor time of one thread; the search runs for
its time on the clock.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
from matplotlib.figure import Figure

from tdcr_planner.inspection.graph import ViewGraph
from tdcr_planner.inspection.inspect import inspect, make_search
from tdcr_planner.inspection.scene import make_visibility
from tdcr_planner.inspection.search import InspectionSearch
from tdcr_planner.inspection.targets import MOST_POINTS
from tdcr_planner.inspection.tighten import CoveragePath
from tdcr_planner.inspection.visibility_kernels import SURFACE_M
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.planning.timing import path_times
from tdcr_planner.planning.validity import sample_within_tensions
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.report import plots

SCENES = Path(__file__).resolve().parents[1] / "scenes"
SCENARIOS = (
    "blades/inspect_blade.toml",
    "blades/inspect_blades.toml",
    "duct/inspect_narrowing.toml",
    "airway/inspect_bronchi.toml",
)
WANTED_STATES_S = 20_000
WANTED_SHARE = 0.95
WANTED_SHORTER = 0.75


def measure_visibility(states: int, pairs: int) -> None:
    """Prints states a second against about 2,000 points of the blades, and disagreement with embree."""
    scenario = load_scenario(SCENES / "blades/inspect_blades.toml")
    assert scenario.file.inspect is not None
    inspect_table = scenario.file.inspect.model_copy(update={"spacing_m": 0.0035})
    scenario = type(scenario)(
        scenario.path, scenario.sha256, scenario.file.model_copy(update={"inspect": inspect_table}), scenario.robot
    )
    session = PlanningSession(scenario)
    engine = make_visibility(session)
    triangles = sum(len(mesh.faces) for mesh in session.meshes)
    positions, rotations = (item[:states] for item in free_states(session, 4 * states, np.random.default_rng(1)))
    begin = time.process_time()
    seen = engine.seen(positions, rotations)
    spent = time.process_time() - begin
    rate = len(positions) / spent
    print(
        f"visibility: {rate:,.0f} states a second against {len(engine.targets):,} points and {triangles:,} triangles, "
        f"one thread ({rate / WANTED_STATES_S:.1f} x the {WANTED_STATES_S:,} wanted); "
        f"a state sees {seen.sum(1).mean():.1f}"
    )
    compare_with_embree(engine, session, pairs)


def free_states(session, count: int, generator):  # type: ignore[no-untyped-def]
    """Returns disk poses of some random free states."""
    checker = session.checker()
    shapes = checker.shapes(sample_within_tensions(checker, count, generator))
    checker.collide(shapes)
    free = shapes.codes == 0
    return shapes.positions[free], shapes.rotations[free]


def compare_with_embree(engine, session, pairs: int) -> None:  # type: ignore[no-untyped-def]
    """Prints how many of the pairs in the picture embree judges otherwise; it computes in single precision."""
    scene = trimesh.util.concatenate([trimesh.Trimesh(mesh.vertices, mesh.faces) for mesh in session.meshes])
    camera, targets = engine.camera, engine.targets
    generator = np.random.default_rng(2)
    done = different = 0
    while done < pairs:
        positions, rotations = free_states(session, 2000, generator)
        centres, frames = camera.poses(positions, rotations)
        near = np.flatnonzero(np.linalg.norm(centres - targets.points.mean(axis=0), axis=1) < 0.15)
        positions, rotations, centres, frames = (item[near] for item in (positions, rotations, centres, frames))
        offset = targets.points[None] - centres[:, None]
        distance = np.linalg.norm(offset, axis=2)
        ahead = np.einsum("spi,si->sp", offset, frames[..., 2])
        cosine = -np.einsum("spi,pi->sp", offset, targets.normals) / distance
        cosine = np.where(targets.two_sided, np.abs(cosine), cosine)
        low, high = camera.range_m
        inside = (ahead >= distance * np.cos(np.arctan(camera.tangents[0]))) & (distance >= low) & (distance <= high)
        state, point = np.nonzero(inside & (cosine >= camera.cosine_of_incidence))
        if not len(state):
            continue
        rays = offset[state, point] / distance[state, point][:, None]
        places, ray, _ = scene.ray.intersects_location(centres[state], rays, multiple_hits=False)
        first = np.full(len(state), np.inf)
        first[ray] = np.linalg.norm(places - centres[state[ray]], axis=1)
        expected = first >= distance[state, point] - 2.0 * SURFACE_M
        done += len(state)
        different += int((engine.seen(positions, rotations)[state, point] != expected).sum())
    print(f"  against embree: {different} of {done:,} pairs in the picture differ ({different / max(done, 1):.1e})")


def ways_between(graph: ViewGraph, stops: list[int]) -> np.ndarray:
    """Returns the waypoints of the shortest ways over a graph from the start through vertices in order."""
    order = [0, *stops]
    lengths, before = graph.ways(order)
    assert np.isfinite(lengths[:, order]).all()
    way = [0]
    for place, (_, there) in enumerate(pairwise(order)):
        trace = [there]
        while trace[-1] != order[place]:
            trace.append(int(before[place, trace[-1]]))
        way += trace[::-1][1:]
    return graph.rows[way]


def greedy_path(graph: ViewGraph, weights: np.ndarray, target: float) -> np.ndarray:
    """Returns greedy set cover in nearest-neighbour order."""
    seen, views = np.array(graph.seen), graph.views
    covered, chosen = seen[0].copy(), []
    while weights[covered].sum() < target - 1e-12:
        gains = (seen & ~covered) @ weights
        best = int(gains.argmax())
        if gains[best] <= 0.0:
            break
        chosen.append(views[best])
        covered |= seen[best]
    lengths, _ = graph.ways([0, *chosen])
    order, here, left = [], 0, list(range(len(chosen)))
    while left:
        following = min(left, key=lambda place: lengths[here, chosen[place]])
        order.append(chosen[following])
        left.remove(following)
        here = following + 1
    return ways_between(graph, order)


def boustrophedon_path(graph: ViewGraph, search: InspectionSearch, target: float) -> np.ndarray:
    """Returns tip goals row by row over the surface, there and back, as fine as the coverage needs."""
    targets, weights = search.visibility.targets, search.weights
    seen, views = np.array(graph.seen), np.array(graph.views)
    tips = search.edges.checker.world_poses(graph.rows[views])[0][:, -1]
    axes = np.argsort(-np.ptp(targets.points[graph.reached], axis=0))[:2]
    flat = targets.points[:, axes]
    low, high = flat[graph.reached].min(axis=0), flat[graph.reached].max(axis=0)
    best = None
    for size in (0.04, 0.03, 0.02, 0.015, 0.01, 0.007, 0.005):
        counts = np.maximum(np.ceil((high - low) / size).astype(int), 1)
        stops: list[int] = []
        for row in range(counts[1]):
            columns = range(counts[0]) if row % 2 == 0 else range(counts[0] - 1, -1, -1)
            for column in columns:
                corner = low + np.array([column, row]) * size
                inside = ((flat >= corner) & (flat < corner + size)).all(axis=1) & graph.reached
                if not inside.any():
                    continue
                worth = seen[:, inside] @ weights[inside]
                if worth.max() <= 0.0:
                    continue
                good = np.flatnonzero(worth >= 0.999 * worth.max())
                middle = targets.points[inside].mean(axis=0)
                stops.append(int(views[good[np.linalg.norm(tips[good] - middle, axis=1).argmin()]]))
        best = ways_between(graph, [stop for stop in dict.fromkeys(stops) if stop != 0])
        path = CoveragePath(search.edges, search.visibility, weights, target, best)
        if path.covered >= target - 1e-12:
            break
    assert best is not None
    return best


def first_part(search: InspectionSearch, rows: np.ndarray, target: float) -> tuple[float, float, float]:
    """Returns length (m of body motion), duration (s) and share seen of a path up to where it sees enough."""
    last = len(rows)
    low = 2
    while low < last:
        middle = (low + last) // 2
        path = CoveragePath(search.edges, search.visibility, search.weights, target, rows[:middle])
        if path.covered >= target - 1e-12:
            last = middle
        else:
            low = middle + 1
    path = CoveragePath(search.edges, search.visibility, search.weights, target, rows[:last])
    states = search.edges.densify(rows[:last])
    space = search.edges.checker.space
    return path.length, states_duration(space, states), path.covered / float(search.weights.sum())


def states_duration(space, states: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    return float(path_times(space_scenario[0], space, states, space.actuate(states).tensions)[-1])


space_scenario: list = []


def measure_path(name: str, seed: int, seconds: float) -> dict[str, object]:
    """Plans, verifies and compares one scenario with one seed; returns what is printed of it."""
    query = load_scenario(SCENES / name).with_planner(seed=seed, time_limit_s=seconds)
    session = PlanningSession(query)
    space_scenario[:] = [query]
    begin = time.monotonic()
    found = inspect(session)
    spent = time.monotonic() - begin
    # The same search without verification, for its roadmap and views, on which the baselines plan.
    search = make_search(session)
    search.run(time.monotonic() + 0.8 * seconds)
    assert search.best is not None
    target = search.covered
    ours = first_part(search, search.best, target)
    graph = ViewGraph(
        search.edges, search.builder.roadmap(), search.start, search.visibility.seen(
            *search.edges.checker.world_poses(search.start[None])[:2]
        )[0],
    )  # fmt: skip
    graph.cover(search.survey, search.weights, 4, time.monotonic() + 60.0, time.monotonic() + 60.0)
    rows = {
        "product": ours,
        "greedy cover, nearest neighbour": first_part(search, greedy_path(graph, search.weights, target), target),
        "boustrophedon of tip goals": first_part(search, boustrophedon_path(graph, search, target), target),
    }
    return {
        "scenario": name,
        "seed": seed,
        "status": found.plan.status.value,
        "of_what_can_be_seen": found.coverage.of_what_can_be_seen,
        "can_be_seen": found.coverage.visible,
        "seconds": spent,
        "repairs": found.plan.repairs,
        "paths": rows,
        "trace": [list(item) for item in found.coverage.trace],
    }


def print_table(records: list[dict[str, object]]) -> None:
    for name in dict.fromkeys(str(record["scenario"]) for record in records):
        chosen = [record for record in records if record["scenario"] == name]
        good = [
            record for record in chosen
            if record["status"] == "verified" and float(str(record["of_what_can_be_seen"])) >= WANTED_SHARE
        ]  # fmt: skip
        least = min(float(str(record["of_what_can_be_seen"])) for record in chosen)
        print(
            f"\n{name}: {len(good)} of {len(chosen)} seeds verified with 95 % of what can be seen or more; "
            f"least {least:.1%}"
        )
        print(f"  {'':34}{'length, m':>12}{'time, s':>10}{'of all':>9}{'ours / it':>11}")
        paths = [record["paths"] for record in chosen]
        for method in paths[0]:  # type: ignore[attr-defined]
            values = np.array([path[method] for path in paths])  # type: ignore[index]
            own = np.array([path["product"] for path in paths])  # type: ignore[index]
            ratio = float(np.median(own[:, 0] / values[:, 0]))
            length, duration, share = np.median(values, axis=0)
            print(f"  {method:34}{length:12.3f}{duration:10.1f}{share:9.1%}{ratio:11.2f}")


def draw_traces(records: list[dict[str, object]], file: Path) -> None:
    """Draws coverage and length against time, a line a seed."""
    names = list(dict.fromkeys(str(record["scenario"]) for record in records))
    with plots.plot_style():
        figure: Figure = plots.new_figure(500 * len(names), 760, 110)
        grid = np.atleast_2d(figure.subplots(2, len(names), squeeze=False))
        for column, name in enumerate(names):
            for record in records:
                if record["scenario"] != name:
                    continue
                trace = np.array(record["trace"])
                assert (np.diff(trace[:, 1]) >= -1e-9).all(), "coverage fell"
                grid[0, column].plot(trace[:, 0], 100.0 * trace[:, 1], drawstyle="steps-post", linewidth=1.2)
                grid[1, column].plot(trace[:, 0], trace[:, 2], drawstyle="steps-post", linewidth=1.2)
            grid[0, column].set_title(name, fontsize=10)
            grid[1, column].set_xlabel("time (s)")
        grid[0, 0].set_ylabel("seen (% of the surfaces)")
        grid[1, 0].set_ylabel("body motion (m)")
        figure.tight_layout()
        plots.save_figure(figure, file)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--time", type=float, default=60.0, help="seconds of each inspection")
    parser.add_argument("--scenarios", nargs="*", default=list(SCENARIOS))
    parser.add_argument("--visibility", action="store_true", help="speed and exactness of visibility alone")
    parser.add_argument("--pairs", type=int, default=1_000_000, help="pairs of state and point judged by embree")
    parser.add_argument("--out", type=Path, default=Path("out/inspect_benchmark"))
    arguments = parser.parse_args()
    print(
        f"{platform.processor() or platform.machine()}, Python {platform.python_version()}; "
        f"up to {MOST_POINTS:,} points"
    )
    measure_visibility(20_000, arguments.pairs)
    if arguments.visibility:
        return 0
    arguments.out.mkdir(parents=True, exist_ok=True)
    records = []
    for name in arguments.scenarios:
        for seed in range(1, arguments.seeds + 1):
            records.append(measure_path(name, seed, arguments.time))
            last = records[-1]
            print(
                f"{name} seed {seed}: {last['status']}, {last['of_what_can_be_seen']:.1%}", file=sys.stderr, flush=True
            )
    print_table(records)
    (arguments.out / "inspect.json").write_text(json.dumps(records, indent=1) + "\n")
    draw_traces(records, arguments.out / "anytime.png")
    print(f"\n{arguments.out}/inspect.json anytime.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
