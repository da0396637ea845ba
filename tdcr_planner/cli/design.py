"""tdcr design: which robot for a scene, searched over the numbers of its file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

if TYPE_CHECKING:
    from tdcr_planner.design.search import Design, DesignOutcome
    from tdcr_planner.design.study import Study


def design(
    study: tyro.conf.Positional[Path],
    *,
    out: Path,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> int:
    """Search the robot that sees, reaches or clears most in a scene, and confirm the best with verified paths.

    Example: tdcr design scenes/blades/study.toml --out out/study --jobs 2

    Each design runs in a process of its own and is recorded as it finishes: the same command goes on where an earlier
    run was ended. A design that is no valid robot is a failed trial with its reason and ends nothing.

    Exit code 0 when all designs were tried and one is good, 1 otherwise.

    Writes design.json, design.csv, design.md, design.png, the files of every design into designs/, and the best robots
    with their verified inspections into best_1, best_2, ....

    Args:
        study: Study file.
        out: Folder of this study and no other.
        jobs: Designs at a time on this machine; the number of its processors without it.
        scheduler: Address of a Dask scheduler whose workers measure the designs, such as tcp://127.0.0.1:8786.
        progress: Draw a progress bar.
    """
    from tdcr_planner.cli.backend import choose_backend
    from tdcr_planner.cli.cost import tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CountBar
    from tdcr_planner.design.search import run_study
    from tdcr_planner.design.study import load_study
    from tdcr_planner.report.design_results import draw_design, write_design_data
    from tdcr_planner.workers import local_backend, usable_cpus

    at_once = jobs or usable_cpus()
    backend = choose_backend(jobs, scheduler) or local_backend(at_once)
    content = load_study(study)
    file = content.file
    seconds = file.trials * file.search_s * len(file.measures) / at_once + file.confirm * file.confirm_s
    tell_cost("study, at its time limits", seconds)
    with CountBar("design", shown=progress) as bar:
        outcome = run_study(content, out, backend, at_once=at_once, progress=bar.update)
    confirmed: dict[int, dict[str, Any]] = {}
    write_design_data(outcome, out, confirmed)
    if not outcome.interrupted:
        for place, number in enumerate(outcome.best[: file.confirm], start=1):
            confirmed[number] = confirm(content, outcome.design(number), out / f"best_{place}")
    write_design_data(outcome, out, confirmed)
    print(describe(outcome, confirmed), flush=True)
    drawn = draw_after("design.json", lambda: draw_design(outcome, out))
    print(f"files: {out}/{' '.join(['design.json', 'design.csv', 'design.md', *drawn])}")
    return 0 if outcome.complete and outcome.best else 1


def confirm(study: Study, best: Design, folder: Path) -> dict[str, Any]:
    """Runs the full verified inspection of a design's scene, or its reach, and returns what came of it."""
    from tdcr_planner.inspection.inspect import inspect
    from tdcr_planner.planning.scenario import load_scenario
    from tdcr_planner.query.session import PlanningSession
    from tdcr_planner.report.coverage_files import write_inspection_data
    from tdcr_planner.report.coverage_results import draw_inspection

    scenario = load_scenario(best.folder / "scenario.toml")
    if scenario.file.inspect is None or "coverage" not in study.file.measures:
        return {}
    query = scenario.with_planner(time_limit_s=study.file.confirm_s)
    found = inspect(PlanningSession(query))
    write_inspection_data(found, folder)
    draw_inspection(found, folder)
    return {
        "status": found.plan.status.value,
        "seen": round(found.coverage.of_all, 4),
        "can_be_seen": round(found.coverage.visible, 4),
    }


def describe(outcome: DesignOutcome, confirmed: dict[int, dict[str, Any]]) -> str:
    """Returns what a study has come to as a few lines for a terminal."""
    failed = [design for design in outcome.designs if design.reason]
    count = f"{len(outcome.designs)} of {outcome.study.file.trials} designs"
    lines = [f"{count}, {len(failed)} failed, {outcome.resumed} from an earlier run"]
    if outcome.interrupted:
        lines.append(f"ended early: {outcome.interrupted}; the same command goes on")
    lines += [f"  failed: design {design.number}: {design.reason}" for design in failed[:5]]
    for number in outcome.best[:5]:
        best = outcome.design(number)
        values = ", ".join(f"{name} {value:.4g}" for name, value in best.values.items())
        found = ", ".join(f"{name} {value:.4g}" for name, value in best.measures.items())
        told = confirmed.get(number)
        shown = "" if not told else f"; confirmed: {', '.join(f'{key} {value}' for key, value in told.items())}"
        lines.append(f"  design {number}: {found} ({values}){shown}")
    return "\n".join(lines)
