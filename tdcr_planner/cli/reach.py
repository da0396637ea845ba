"""tdcr reach: which places a robot's tip reaches in a scene, and why not the others; two robots side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.inspection.reach import ReachMap


def reach(
    scenario: tyro.conf.Positional[Path],
    *,
    out: Path,
    cells: int = 10_000,
    time_limit_s: float = 20.0,
    seed: int = 1,
    against: Path | None = None,
    surfaces: bool = False,
    progress: bool = True,
) -> int:
    """Map which cells of a volume the tip attains with a free, stable shape, and which by a path from the start.

    Example: tdcr reach scenes/airway/inspect_bronchi.toml --out out/reach

    Example: tdcr reach scenes/duct/inspect_narrowing.toml --against scenes/duct/scenario_look.toml --out out/two

    Each attained cell is confirmed by the Cosserat reference. The volume is the box around all tips that shapes within
    the limits have, cut to that around the scene's cavities.

    With --surfaces the map is one of views: which points of the scenario's [inspect] the camera can see from states
    that the start reaches, else why not.

    Exit code 0 when cells are reached, or points can be seen, 1 when none.

    Writes reach.json and reach.csv (a row a cell, with a configuration that attains it) into the output folder, both or
    none, then reach.png and reach.html; with --surfaces the files of `tdcr inspect`, without a path.

    Args:
        scenario: Scenario file; its goals do not matter.
        out: Folder for the map.
        cells: Number of cells, about.
        time_limit_s: Time for the search, for each robot.
        seed: Seed of the search.
        against: Another scenario, with another robot in the same volume; the map then shows which of the two reaches
            what.
        surfaces: Map the points of [inspect] instead of a volume.
        progress: Draw a progress bar.
    """
    from tdcr_planner.bounds import CELLS, SEED, TIME_S
    from tdcr_planner.cli.cost import tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CompileBar, TimeBar
    from tdcr_planner.errors import InputError
    from tdcr_planner.files import check_folder
    from tdcr_planner.planning.scenario import load_scenario

    CELLS.check("--cells", cells)
    TIME_S.check("--time-limit-s", time_limit_s)
    SEED.check("--seed", seed)
    if surfaces:
        if against is not None:
            raise InputError("--against", "no other scenario with --surfaces", str(against))
        return map_surfaces(scenario, out, time_limit_s, seed, progress)
    queries = [load_scenario(file) for file in ([scenario] if against is None else [scenario, against])]
    from tdcr_planner.inspection.reach import Verdict, map_reach
    from tdcr_planner.query.session import PlanningSession
    from tdcr_planner.report.reach_results import REACH_FILES, draw_reach, write_reach_data

    check_folder(out, REACH_FILES)
    tell_cost("--time-limit-s", len(queries) * time_limit_s)
    maps: list[ReachMap] = []
    for query in queries:
        with CompileBar(shown=progress):
            session = PlanningSession(query)
        with TimeBar(f"reach of {query.robot.name}", time_limit_s, shown=progress) as bar:
            maps.append(
                map_reach(
                    session, cells=cells, grid=maps[0].grid if maps else None, time_limit_s=time_limit_s, seed=seed,
                    progress=bar.update,
                )
            )  # fmt: skip
    other = None if against is None else (maps[1], queries[1])
    write_reach_data(maps[0], queries[0], out, None if other is None else other[0])
    for query, found in zip(queries, maps, strict=True):
        print(describe(found, query.robot.name))
    drawn = draw_after("reach.json", lambda: draw_reach(maps[0], queries[0], out, other))
    print(f"files: {out}/{' '.join(['reach.json', 'reach.csv', *drawn])}", flush=True)
    return 0 if maps[0].count(Verdict.REACHED) else 1


def map_surfaces(scenario: Path, out: Path, time_limit_s: float, seed: int, progress: bool) -> int:
    """Maps which points of a scenario's [inspect] can be seen, writes the map and returns the exit code."""
    from tdcr_planner.cli.cost import tell_cost
    from tdcr_planner.cli.inspect import describe as describe_inspection
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CompileBar, TimeBar
    from tdcr_planner.files import check_folder
    from tdcr_planner.inspection.inspect import survey_surfaces
    from tdcr_planner.inspection.scene import check_inspects
    from tdcr_planner.planning.scenario import load_scenario
    from tdcr_planner.query.session import PlanningSession
    from tdcr_planner.report.coverage_files import INSPECTION_FILES, write_inspection_data
    from tdcr_planner.report.coverage_results import draw_inspection

    query = load_scenario(scenario).with_planner(seed=max(seed, 1))
    check_folder(out, INSPECTION_FILES)
    check_inspects(query)
    tell_cost("--time-limit-s", time_limit_s)
    with CompileBar(shown=progress):
        session = PlanningSession(query)
    with TimeBar("views", time_limit_s, shown=progress) as bar:
        found = survey_surfaces(session, time_limit_s=time_limit_s, progress=bar.update)
    write_inspection_data(found, out)
    print(describe_inspection(found), flush=True)
    drawn = draw_after("coverage.csv", lambda: draw_inspection(found, out))
    print(f"files: {out}/{' '.join(['result.json', 'coverage.csv', *drawn])}")
    return 0 if found.coverage.can_be_seen.any() else 1


def describe(found: ReachMap, robot: str) -> str:
    """Returns a map as a few lines for a terminal."""
    from tdcr_planner.inspection.reach import NAMES, Verdict

    grid = found.grid
    lines = [f"robot {robot}: {grid.cells:,} cells of {1e3 * grid.size:.1f} mm, {found.states:,} states looked at"]
    lines += [f"  {found.count(verdict):>8,}  {NAMES[verdict]}" for verdict in Verdict if found.count(verdict)]
    lines.append(
        f"  {found.confirmed:,} attained cells put to the reference, {found.refused:,} refused; {found.seconds:.1f} s"
    )
    return "\n".join(lines)
