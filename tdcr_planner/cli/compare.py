"""tdcr compare: how often the learned model and constant curvature are wrong about a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.compare.comparison import Comparison
    from tdcr_planner.planning.scenario import Scenario


def compare(
    scenario: tyro.conf.Positional[Path],
    *,
    out: Path,
    models: tuple[str, ...] = (),
    samples: int = 10_000,
    paths: int = 5,
    seed: int = 1,
    jobs: int | None = None,
    progress: bool = True,
) -> int:
    """Compare the verdicts of shape models with the Cosserat reference, on states and paths.

    Example: tdcr compare scenes/duct/scenario_elbow.toml --out out/compare --samples 10000

    Writes compare.json and tables (CSV) into the output folder, all or nothing, then plots (PNG, PDF) and pictures of
    the worst disagreements.

    Args:
        scenario: Scenario file; it must name a shape model where a model needs one.
        out: Folder for the result.
        models: Shape models by name; without it the learned one, constant curvature and the scenario's own. Or model
            files (.pt), which are set side by side with constant curvature and the reference: one table, one plot.
        samples: Number of states, uniform in the scenario's configuration space.
        paths: Queries to plan with each model; 0 for none.
        seed: Seed of the states.
        jobs: Worker processes; the number of processors without it.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from tdcr_planner.bounds import PROCESSES, QUERIES, SAMPLES, SEED
    from tdcr_planner.cli.cost import REFERENCE_S, SHAPE_BYTES, tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CountBar
    from tdcr_planner.compare.comparison import compare as compare_scenario
    from tdcr_planner.files import check_folder
    from tdcr_planner.planning.scenario import load_scenario
    from tdcr_planner.report.compare_results import draw_comparison, write_comparison_data
    from tdcr_planner.workers import usable_cpus

    SAMPLES.check("--samples", samples)
    QUERIES.check("--paths", paths)
    SEED.check("--seed", seed)
    if jobs is not None:
        PROCESSES.check("--jobs", jobs)
    query = load_scenario(scenario)
    processes = usable_cpus() if jobs is None else jobs
    tell_cost(
        "--samples",
        (samples * REFERENCE_S + 3 * paths * query.planner.time_limit_s) / processes,
        samples * query.robot.disk_count * SHAPE_BYTES,
    )
    check_folder(out)
    if any(name.endswith(".pt") for name in models):
        return _compare_files(query, [Path(name) for name in models], out, samples, paths, seed, progress)
    with CountBar("comparing", shown=progress) as bar:
        found = compare_scenario(
            query,
            models=models or None,
            samples=samples,
            paths=paths,
            seed=seed,
            jobs=processes,
            progress=bar.update,
        )
    write_comparison_data(found, out)
    print(describe(found))
    print(f"files:     {out}/compare.json verdicts.csv agreement.csv states.csv", flush=True)
    drawn = draw_after("the comparison", lambda: draw_comparison(found, out))
    if drawn:
        print(f"pictures:  {len(drawn)} plots and pictures beside them")
    return 0


def _compare_files(
    query: Scenario, files: list[Path], out: Path, samples: int, paths: int, seed: int, progress: bool
) -> int:
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CountBar
    from tdcr_planner.compare.side_by_side import compare_files
    from tdcr_planner.report.side_by_side import PLOT, describe_models, draw_error_against_time, write_models

    with CountBar("comparing", shown=progress) as bar:
        found = compare_files(query, files, samples=samples, paths=paths, seed=seed, progress=bar.update)
    write_models(found, out)
    print(describe_models(found))
    points = [(row.name, row.shape_us, 1e3 * row.error_m[0], 1e3 * row.error_m[1]) for row in found.rows]

    def draw() -> list[str]:
        draw_error_against_time(points, out / PLOT)
        return [PLOT]

    drawn = draw_after("the comparison", draw)
    print(f"files:     {out}/{' '.join(['compare.json', 'compare.md', *drawn])}")
    return 0


def describe(comparison: Comparison) -> str:
    """Returns a comparison as a few lines for a terminal."""
    from tdcr_planner.compare.paths import path_rates
    from tdcr_planner.rates import ratio_at_least

    verdicts = comparison.verdicts
    lines = [f"states:    {len(verdicts.rows):,}, {100 * verdicts.reference_valid.mean():.1f} % of them valid"]
    rates = {}
    for variant in verdicts.variants:
        rates[variant.name] = found = comparison.confusion(variant).rates
        lines.append(f"{variant.name}:")
        lines.append(f"           false valid {found['false_valid']}, false invalid {found['false_invalid']}")
    first, *others = verdicts.models
    for other in others:
        bound = ratio_at_least(rates[other]["false_valid"], rates[first]["false_valid"])
        name = other.replace("_", " ")
        lines.append(f"ratio:     {name} is falsely valid at least {bound:.3g} times as often (95 %)")
    slowest = max(time.check_us for time in comparison.times)
    for time in comparison.times:
        lines.append(f"time:      {time.model}: {time.check_us:.3g} us a state, {slowest / time.check_us:.3g} times")
    for path in path_rates(comparison.paths, verdicts.models) if comparison.paths else ():
        lines.append(f"paths:     {path.model}: first path verified {path.verified_at_once}")
        lines.append(f"           verified in the end {path.verified}")
    return "\n".join(lines)
