"""tdcr inspect: from a scenario to a verified path that sees a surface, its coverage and its map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

if TYPE_CHECKING:
    from tdcr_planner.inspection.answer import Inspection


def inspect(
    scenario: tyro.conf.Positional[Path],
    *,
    out: Path,
    seed: int | None = None,
    validity: Literal["learned", "reference", "constant_curvature"] | None = None,
    time_limit_s: float | None = None,
    robots: int = 0,
    progress: bool = True,
) -> int:
    """Plan a path whose camera sees surfaces, verify it with the Cosserat reference and write what it sees.

    Example: tdcr inspect scenes/blades/inspect_blade.toml --out out/blade

    The scenario's [inspect] says which surfaces; the camera stands in the robot file or in [inspect.camera]. Which
    points can be seen at all is found first, then a short path from the start that sees them. What is stated as seen is
    seen from the reference's shapes.

    Exit code 0 for a verified path that sees as much as was asked for, 1 otherwise; the message says why.

    Writes result.json, trajectory.csv, shapes.npz and coverage.csv (a row a point) into the output folder, all or
    nothing, then coverage.png, coverage.html, coverage.glb, coverage.ply and tip_view.gif.

    Args:
        scenario: Scenario file with [inspect].
        out: Folder for the result.
        seed: Seed of the search, in place of the scenario's.
        validity: Shape model that the search asks, in place of the scenario's.
        time_limit_s: Time for search, verification and repair in seconds, in place of the scenario's.
        robots: Robots to draw within the tolerances of `tdcr robustness`, to tell how likely each point is seen; 59 or
            more for a coverage that holds with 95 % confidence, 0 for none.
        progress: Draw a progress bar while planning.
    """
    import time

    from tdcr_planner.bounds import ROBOTS
    from tdcr_planner.cli.cost import tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CompileBar, CountBar, TimeBar
    from tdcr_planner.files import check_folder
    from tdcr_planner.planning.scenario import load_scenario

    if robots:
        ROBOTS.check("--robots", robots)
    given = {"seed": seed, "validity": validity, "time_limit_s": time_limit_s}
    query = load_scenario(scenario).with_planner(**{key: value for key, value in given.items() if value is not None})
    import numpy as np

    from tdcr_planner.inspection.camera import scenario_camera
    from tdcr_planner.inspection.inspect import inspect as run_inspection
    from tdcr_planner.inspection.scene import check_inspects
    from tdcr_planner.inspection.tolerance import spread_coverage
    from tdcr_planner.query.session import PlanningSession
    from tdcr_planner.report.coverage_files import INSPECTION_FILES, write_inspection_data
    from tdcr_planner.report.coverage_results import draw_inspection

    check_folder(out, INSPECTION_FILES)
    check_inspects(query)
    scenario_camera(query)
    tell_cost("time_limit_s", query.planner.time_limit_s)
    started = time.perf_counter()
    with CompileBar(shown=progress):
        session = PlanningSession(query)
    loaded = time.perf_counter() - started
    with TimeBar("inspecting", query.planner.time_limit_s, shown=progress) as bar:
        found = run_inspection(session, load_s=loaded, progress=bar.update)
    spread = None
    if robots and found.plan.path is not None:
        with CountBar("drawing robots", shown=progress) as count:
            spread = spread_coverage(found, samples=robots, seed=query.planner.seed, progress=count.update)
    write_inspection_data(found, out, spread)
    print(describe(found), flush=True)
    if spread is not None:
        print(
            f"robots:    {spread.samples} within tolerances see {100 * np.median(spread.shares):.1f} % of the surfaces "
            f"in the median; 95 % of all such robots see {100 * spread.sure:.1f} % or more, with 95 % confidence"
        )
    drawn = draw_after("the result", lambda: draw_inspection(found, out))
    print(f"files:     {out}/{' '.join(['result.json', 'trajectory.csv', 'coverage.csv', *drawn, 'shapes.npz'])}")
    return 0 if found.done else 1


def describe(found: Inspection) -> str:
    """Returns an inspection as a few lines for a terminal."""
    coverage, result = found.coverage, found.plan
    lines = [f"status:    {result.status.value}"]
    if result.message:
        lines.append(f"           {result.message}")
    causes = ", ".join(f"{name} {100 * share:.1f} %" for name, share in coverage.cause_shares.items())
    if causes:
        lines.append(f"not seen:  {causes}")
    if result.verification is not None and result.path is not None:
        worst = result.verification.worst
        lines += [
            f"path:      {len(result.path)} states, tip travels {1e3 * result.path.tip_travel:.0f} mm "
            f"in {result.path.times[-1]:.1f} s, {result.repairs} repairs",
            f"reference: least clearance {1e3 * worst['clearance_m']:.2f} mm "
            f"(asked {1e3 * result.scenario.planner.clearance_m:.2f})",
        ]
    times = result.timings_s
    looked = f"{result.planner.get('states_looked_from', 0):,} states looked from"
    lines.append(
        f"time:      load {times['load']:.2f} s, plan {times['plan']:.2f} s ({looked}), verify {times['verify']:.2f} s"
    )
    return "\n".join(lines)
