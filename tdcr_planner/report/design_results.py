"""The files of a design study: summary, a table of all designs, Pareto front, importance, the best robots."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdcr_planner.design.search import Design, DesignOutcome
from tdcr_planner.files import real_path, write_file_whole
from tdcr_planner.report import plots
from tdcr_planner.report.drawing import draw_pictures
from tdcr_planner.report.plain import plain_json
from tdcr_planner.report.text import figure_text

DESIGN_FORMAT = "tdcr-design/1"
UNITS = {"coverage": "share of the surfaces that can be seen", "reach": "reached volume, m\u00b3",
         "clearance": "least clearance, m", "success": "share of scenarios solved"}  # fmt: skip


def write_design_data(outcome: DesignOutcome, folder: str | Path, confirmed: dict[int, dict[str, Any]]) -> None:
    """Writes design.json, design.csv and design.md, and robot.toml of each of the best into best_1, best_2, ...

    Args:
        outcome: What the study has come to.
        folder: The study's folder.
        confirmed: What a full verified inspection or plan of the best designs came to, by trial.

    Raises:
        FormatError: The folder cannot be written.
    """
    target = real_path(folder)
    content = {
        "format": DESIGN_FORMAT,
        "study": str(outcome.study.path),
        "study_sha256": outcome.study.sha256,
        "title": outcome.study.file.title,
        "measures": list(outcome.study.file.measures),
        "trials": len(outcome.designs),
        "asked": outcome.study.file.trials,
        "failed": sum(1 for design in outcome.designs if design.reason),
        "best": [_entry(outcome.design(number)) | {"confirmed": confirmed.get(number)} for number in outcome.best],
        "importance": outcome.importance,
        "interrupted": outcome.interrupted,
    }
    with write_file_whole(target / "design.json") as file:
        file.write_text(json.dumps(plain_json(content), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with write_file_whole(target / "design.csv") as file:
        _write_csv(outcome, file)
    with write_file_whole(target / "design.md") as file:
        file.write_text(_markdown(outcome, confirmed), encoding="utf-8")
    for place, number in enumerate(outcome.best, start=1):
        home = target / f"best_{place}"
        home.mkdir(exist_ok=True)
        source = outcome.design(number).folder / "robot.toml"
        if source.is_file():
            shutil.copyfile(source, home / "robot.toml")


def _entry(design: Design) -> dict[str, Any]:
    return {"design": design.number, "values": design.values, "measures": design.measures}


def _write_csv(outcome: DesignOutcome, file: Path) -> None:
    labels = [parameter.label for parameter in outcome.study.file.parameters]
    measures = outcome.study.file.measures
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["design", *labels, *measures, "best", "reason"])
        for design in outcome.designs:
            values = [f"{design.values[label]:.9g}" for label in labels]
            found = [f"{design.measures[name]:.9g}" if name in design.measures else "" for name in measures]
            best = "yes" if design.number in outcome.best else ""
            writer.writerow([design.number, *values, *found, best, design.reason])


def _markdown(outcome: DesignOutcome, confirmed: dict[int, dict[str, Any]]) -> str:
    file = outcome.study.file
    labels = [parameter.label for parameter in file.parameters]
    failed = [design for design in outcome.designs if design.reason]
    lines = [f"# {file.title or outcome.study.path.stem}", ""]
    lines += [f"{len(outcome.designs)} of {file.trials} designs, {len(failed)} failed.", ""]
    lines += ["## Best designs", "", f"| design | {' | '.join(labels)} | {' | '.join(file.measures)} | confirmed |"]
    lines.append("|" + " --- |" * (len(labels) + len(file.measures) + 2))
    for number in outcome.best:
        design = outcome.design(number)
        values = [f"{design.values[label]:.4g}" for label in labels]
        found = [f"{design.measures[name]:.4g}" for name in file.measures]
        lines.append(f"| {number} | {' | '.join([*values, *found])} | {_confirmed_text(confirmed.get(number))} |")
    if outcome.importance:
        lines += ["", f"## Importance of each parameter for {file.measures[0]} (PED-ANOVA)", ""]
        lines += [f"- {name}: {100 * share:.0f} %" for name, share in outcome.importance.items()]
    if failed:
        lines += ["", "## Failed designs", "", *(f"- {design.number}: {design.reason}" for design in failed[:20])]
    return "\n".join(lines) + "\n"


def _confirmed_text(found: dict[str, Any] | None) -> str:
    return "" if found is None else ", ".join(f"{key} {value}" for key, value in found.items())


def draw_design(outcome: DesignOutcome, folder: str | Path) -> list[str]:
    """Draws design.png into the study's folder; returns the names of those that were drawn."""

    def draw(file: Path) -> None:
        with plots.plot_style():
            plots.save_figure(_draw(outcome), file)

    return draw_pictures(folder, {"design.png": draw})


def _draw(outcome: DesignOutcome) -> Figure:
    figure = plots.new_figure(1500, 620, 120)
    title = outcome.study.file.title or outcome.study.path.stem
    figure.text(0.03, 0.95, figure_text(title), fontsize=15, fontweight="bold", va="center")
    failed = sum(1 for design in outcome.designs if design.reason)
    note = f"{len(outcome.designs)} designs, {failed} failed, {len(outcome.best)} that no other is better than"
    figure.text(0.03, 0.895, note, fontsize=10.5, color=plots.MUTED, va="center")
    left = figure.add_axes((0.075, 0.13, 0.5, 0.67))
    if len(outcome.study.file.measures) > 1:
        _draw_front(left, outcome)
    else:
        _draw_history(left, outcome)
    _draw_importance(figure.add_axes((0.75, 0.13, 0.225, 0.67)), outcome)
    return figure


def _draw_history(axes: Axes, outcome: DesignOutcome) -> None:
    name = outcome.study.file.measures[0]
    good = [design for design in outcome.designs if design.measures]
    numbers = [design.number for design in good]
    values = np.array([design.measures[name] for design in good])
    axes.plot(numbers, values, "o", color=plots.PALETTE["blue"], alpha=0.6, label="designs")
    if len(values):
        axes.plot(
            numbers, np.maximum.accumulate(values), color=plots.TRACE, drawstyle="steps-post", label="best so far"
        )
        axes.legend(loc="lower right")
    axes.set_xlabel("design")
    axes.set_ylabel(UNITS[name])
    axes.set_title("Search", loc="left", fontsize=12, fontweight="bold")


def _draw_front(axes: Axes, outcome: DesignOutcome) -> None:
    first, second = outcome.study.file.measures[:2]
    good = [design for design in outcome.designs if design.measures]
    axes.plot(
        [design.measures[first] for design in good], [design.measures[second] for design in good], "o",
        color=plots.PALETTE["blue"], alpha=0.5, label="designs",
    )  # fmt: skip
    front = sorted((outcome.design(number) for number in outcome.best), key=lambda design: design.measures[first])
    axes.plot(
        [design.measures[first] for design in front], [design.measures[second] for design in front], "o-",
        color=plots.TRACE, label="Pareto front",
    )  # fmt: skip
    for design in front:
        axes.annotate(str(design.number), (design.measures[first], design.measures[second]), (4, 5),
                      textcoords="offset points", fontsize=8.5)  # fmt: skip
    axes.set_xlabel(UNITS[first])
    axes.set_ylabel(UNITS[second])
    axes.set_title("Pareto front", loc="left", fontsize=12, fontweight="bold")
    axes.legend(loc="best")


def _draw_importance(axes: Axes, outcome: DesignOutcome) -> None:
    name = outcome.study.file.measures[0]
    axes.set_title(f"Importance for {name}", loc="left", fontsize=12, fontweight="bold")
    shares = list(outcome.importance.items())[:10][::-1]
    if not shares:
        axes.text(0.0, 0.5, "too few designs to tell", color=plots.MUTED, fontsize=10)
        axes.set_axis_off()
        return
    axes.barh(range(len(shares)), [100 * share for _, share in shares], color=plots.PALETTE["blue"], height=0.6)
    axes.set_yticks(range(len(shares)), [figure_text(label, 30) for label, _ in shares], fontsize=8.5)
    axes.set_xlabel("%")
    axes.grid(axis="y", visible=False)
