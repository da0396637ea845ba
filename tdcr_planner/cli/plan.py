"""tdcr plan: from a scenario to a verified path and its files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

if TYPE_CHECKING:
    from tdcr_planner.query.result import PlanResult
    from tdcr_planner.query.session import PlanningSession


def plan(
    scenario: tyro.conf.Positional[Path],
    *,
    out: Path,
    seed: int | None = None,
    planner: str | None = None,
    validity: str | None = None,
    shape_engine: Literal["compiled", "torchscript", "onnx"] | None = None,
    time_limit_s: float | None = None,
    success_probability: float | None = None,
    roadmap: Path | None = None,
    progress: bool = True,
) -> int:
    """Plan a path through a mesh scene, verify it with the Cosserat reference and write it with pictures.

    Example: tdcr plan scenes/duct/scenario_elbow.toml --out out/elbow

    Exit code 0 for a verified path, 1 without one; the status says why. With a success probability, 0 only if fresh
    robots within the scenario's tolerances show it.

    Writes result.json, trajectory.csv and shapes.npz into the output folder, all or nothing, then path.png and
    path.html. A picture that cannot be drawn is a warning.

    Args:
        scenario: Scenario file.
        out: Folder for the result.
        seed: Seed of the search, in place of the scenario's.
        planner: Planner, in place of the scenario's: one of OMPL's or of an installed package, or module:function.
        validity: Shape model that the search asks, in place of the scenario's: learned, reference,
            constant_curvature or one of an installed package.
        shape_engine: What evaluates the model file, in place of the scenario's.
        time_limit_s: Time for search, verification and repair in seconds, in place of the scenario's.
        success_probability: Plan until the path is verified with this probability on robots within the scenario's
            [tolerances], or those that `tdcr robustness` has by default.
        roadmap: Roadmap of the scene that `tdcr roadmap` wrote, asked before the planner.
        progress: Draw a progress bar while planning.
    """
    import time

    from tdcr_planner.cli.cost import tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CompileBar, TimeBar
    from tdcr_planner.files import check_folder
    from tdcr_planner.planning.scenario import load_scenario

    given = {
        "seed": seed,
        "name": planner,
        "validity": validity,
        "shape_engine": shape_engine,
        "time_limit_s": time_limit_s,
        "success_probability": success_probability,
    }
    changes = {key: value for key, value in given.items() if value is not None}
    query = load_scenario(scenario).with_planner(**changes)
    # Seconds to import: what is wrong with the arguments is said before.
    from tdcr_planner.query.session import PlanningSession
    from tdcr_planner.report.results import RESULT_FILES, draw_result, write_result_data

    check_folder(out, RESULT_FILES)
    tell_cost("time_limit_s", query.planner.time_limit_s)
    started = time.perf_counter()
    with CompileBar(shown=progress):
        session = PlanningSession(query)
        session.use_roadmap(roadmap)
    loaded = time.perf_counter() - started
    with TimeBar("planning", session.scenario.planner.time_limit_s, shown=progress) as bar:
        result = session.plan(load_s=loaded, progress=bar.update)
    write_result_data(result, out)
    print(describe(result))
    print(_without_mechanics(session, result), end="", flush=True)
    drawn = draw_after("the result", lambda: draw_result(result, out))
    print(f"files:     {out}/{' '.join(['result.json', 'trajectory.csv', *drawn, 'shapes.npz'])}")
    if result.path is None:
        print("           (no path: trajectory.csv and shapes.npz are empty)")
    return 0 if result.holds else 1


def _without_mechanics(session: PlanningSession, result: PlanResult) -> str:
    """Returns a line on what constant curvature says of the path of a robot under load; empty for others."""
    scenario = result.scenario
    if result.path is None or scenario.robot.features or not (scenario.gravity.any() or scenario.tip_force.any()):
        return ""
    from tdcr_planner.compare.along_path import arcs_along_path

    return f"for comparison: {arcs_along_path(session, result)}\n"


def _required_clearance(result: PlanResult) -> str:
    """Returns the clearance that the scenario asks for and what is kept on top of it, as text."""
    scenario = result.scenario
    surface = f" + {1e3 * scenario.surface_error:.2f} for the surfaces" if scenario.surface_error > 0.0 else ""
    return f"asked {1e3 * scenario.planner.clearance_m:.2f}{surface}"


def describe(result: PlanResult) -> str:
    """Returns a planning result as a few lines for a terminal."""
    lines = [f"status:    {result.status.value}"]
    if result.message:
        lines.append(f"           {result.message}")
    if result.verification is not None and result.path is not None:
        worst = result.verification.worst
        lines += [
            f"path:      {len(result.path)} states, tip travels {1e3 * result.path.tip_travel:.0f} mm "
            f"in {result.path.times[-1]:.1f} s, {result.repairs} repairs",
            f"reference: least clearance {1e3 * worst['clearance_m']:.2f} mm "
            f"({_required_clearance(result)}), "
            f"largest model deviation {1e3 * worst['deviation_m']:.2g} mm, "
            f"largest residual {worst['residual_nm']:.1e} N m",
        ]
    if result.verification is not None and result.verification.friction is not None:
        friction = result.verification.friction
        lines.append(
            f"friction:  moves a disk by {1e3 * friction.spread_m:.2f} mm at most, at state {friction.state + 1} "
            f"{friction.direction}"
        )
    if "roadmap" in result.planner:
        lines.append(f"roadmap:   {_roadmap_line(result)}")
    times = result.timings_s
    checked = f"{result.planner.get('states_checked', 0):,} states checked"
    lines.append(
        f"time:      load {times['load']:.2f} s, plan {times['plan']:.2f} s ({checked}), verify {times['verify']:.2f} s"
    )
    return "\n".join(lines)


def _roadmap_line(result: PlanResult) -> str:
    known = result.planner["roadmap"]
    size = f"{known['vertices']:,} configurations, {known['edges']:,} motions"
    if known["answered"]:
        return f"had the way ({size})"
    reason = f"does not fit: {known['unfit']}" if known.get("unfit") else "had no way"
    return f"{reason} ({size}); {result.planner['name']} searched"
