"""tdcr roadmap: what many queries in one scene share, built once and kept in a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.planning.roadmap import Roadmap


def roadmap(
    scenario: tyro.conf.Positional[Path],
    *,
    out: Path,
    seconds: float = 30.0,
    vertices: int | None = None,
    seed: int | None = None,
    progress: bool = True,
) -> int:
    """Build a roadmap of a scenario's scene, which `tdcr plan --roadmap` asks before it searches.

    Example: tdcr roadmap scenes/duct/scenario_narrowing.toml --out out/duct.npz --seconds 20

    The roadmap serves every start and goal in the same scene with the same robot and shape model, for the scenario's
    clearance_m and less and its step_m and more. Ctrl-C ends the build and keeps what has been built by then.

    Exit code 0 when the roadmap was written, 1 when the build was interrupted.

    Args:
        scenario: Scenario file; its goal does not matter.
        out: File for the roadmap (.npz); an earlier one is replaced.
        seconds: Time for the build.
        vertices: Number of configurations to end at, if the time suffices; the seed alone then decides the roadmap.
        seed: Seed of the sampling, in place of the scenario's.
        progress: Draw a progress bar while building.
    """
    from tdcr_planner.bounds import SEARCH_SEED, TIME_S, VERTICES
    from tdcr_planner.cli.cost import tell_cost
    from tdcr_planner.cli.progress import CompileBar, TimeBar
    from tdcr_planner.errors import InputError
    from tdcr_planner.files import check_file_target
    from tdcr_planner.planning.scenario import load_scenario
    from tdcr_planner.query.session import PlanningSession

    if out.suffix != ".npz" or os.path.isdir(out):
        raise InputError("--out", "a file ending in .npz", repr(str(out)))
    TIME_S.check("--seconds", seconds)
    if vertices is not None:
        VERTICES.check("--vertices", vertices)
    if seed is not None:
        SEARCH_SEED.check("--seed", seed)
    query = load_scenario(scenario)
    check_file_target(out)
    tell_cost("--seconds", seconds)
    with CompileBar(shown=progress):
        builder = PlanningSession(query).roadmap_builder(seed=seed)
    interrupted = False
    with TimeBar("roadmap", seconds, shown=progress) as bar:
        try:
            builder.run(time_limit_s=seconds, vertices=vertices, progress=bar.update)
        except KeyboardInterrupt:
            interrupted = True
    found = builder.roadmap()
    found.save(out)
    if interrupted:
        print("interrupted: what has been built by then is kept")
    print(describe(found))
    print(f"file:      {out}, {out.stat().st_size / 1e6:.2f} MB")
    return 1 if interrupted else 0


def describe(roadmap: Roadmap) -> str:
    """Returns a roadmap as a few lines for a terminal."""
    conditions = roadmap.conditions
    return "\n".join(
        [
            f"roadmap:   {len(roadmap.rows):,} configurations, {len(roadmap.edges):,} motions between them, "
            f"{100 * roadmap.largest_share:.0f} % of the configurations in one connected part",
            f"holds for: {conditions.model['name']} shapes, clearance {1e3 * conditions.clearance_m:g} mm and less, "
            f"step {1e3 * conditions.step_m:g} mm and more",
            f"built in:  {roadmap.build_s:.1f} s, seed {roadmap.seed}",
        ]
    )
