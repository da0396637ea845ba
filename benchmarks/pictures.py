"""Draws every picture of docs/pictures again, or those that are named.

Run: python benchmarks/pictures.py [NAME ...]. Without names it draws all of them, of which `planning_growth` and
`published_network` take minutes: those two are measurements, drawn by their own benchmarks.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.query.result import PlanResult, PlanStatus
from tdcr_planner.query.session import plan
from tdcr_planner.report import plots
from tdcr_planner.report.picture import gather_picture
from tdcr_planner.report.robustness_results import draw_robustness
from tdcr_planner.report.scene_png import draw_scene, write_png
from tdcr_planner.robustness import Tolerances, assess_robustness

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs/pictures"
SCENE_PX, SCENE_DPI = (800, 520), 100


@cache
def planned(scenario: str) -> PlanResult:
    """Returns the verified path of a shipped scenario, named as "airway/tour"."""
    folder, name = scenario.split("/")
    result = plan(load_scenario(ROOT / f"scenes/{folder}/scenario_{name}.toml"))
    if result.status is not PlanStatus.VERIFIED:
        raise SystemExit(f"{scenario}: {result.status.value}: {result.message}")
    return result


def draw_scene_alone(scenario: str, file: Path) -> None:
    """Draws a path in its scene, without its curves."""
    with plots.plot_style():
        figure = plots.new_figure(*SCENE_PX, SCENE_DPI)
        draw_scene(figure, gather_picture(planned(scenario)), (0, 0, *SCENE_PX))
        plots.save_figure(figure, file)


def draw_path(scenario: str, file: Path) -> None:
    """Draws the picture that `tdcr plan` writes."""
    write_png(gather_picture(planned(scenario)), file)


def draw_tolerances(scenario: str, file: Path) -> None:
    """Draws what `tdcr robustness` does with its defaults."""
    tolerances = Tolerances(0.05, 0.02, 0.02, 0.5e-3, 0.2)
    found = assess_robustness(planned(scenario), tolerances, samples=100, seed=1)
    for name in draw_robustness(found, file.parent):
        (file.parent / name).replace(file)


def run_benchmark(arguments: list[str], file: Path) -> None:
    """Runs a benchmark that draws the picture itself; its tables go to this process's output."""
    told = [argument.format(file=file, folder=file.parent) for argument in arguments]
    subprocess.run([sys.executable, ROOT / "benchmarks" / told[0], *told[1:]], check=True)


DRAWINGS: dict[str, Callable[[Path], None]] = {
    "scene_duct": partial(draw_scene_alone, "duct/weight"),
    "scene_blades": partial(draw_scene_alone, "blades/passage"),
    "scene_airway": partial(draw_scene_alone, "airway/left_lower"),
    "path_airway_tour": partial(draw_path, "airway/tour"),
    "robustness_airway_tour": partial(draw_tolerances, "airway/tour"),
    "published_network": partial(run_benchmark, ["published.py", "--picture", "{file}"]),
    "planning_growth": partial(run_benchmark, ["planning.py", "--only", "growth", "--seeds", "5", "--out", "{folder}"]),
}


def main() -> None:
    """Draws the pictures that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(DRAWINGS))
    names = parser.parse_args().names or list(DRAWINGS)
    unknown = sorted(set(names) - set(DRAWINGS))
    if unknown:
        parser.error(f"expected {', '.join(DRAWINGS)}; got {', '.join(unknown)}")
    for name in names:
        file = PICTURES / f"{name}.png"
        DRAWINGS[name](file)
        print(file.relative_to(ROOT), flush=True)


if __name__ == "__main__":
    main()
