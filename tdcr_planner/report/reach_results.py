"""The files of a reach map: summary, a table of all cells, the moving picture, slices; of one robot or of two."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.files import real_path, write_folder_whole
from tdcr_planner.inspection.reach import NAMES, ReachMap, Verdict
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.report import plots
from tdcr_planner.report.drawing import draw_pictures
from tdcr_planner.report.legend import legend_entry
from tdcr_planner.report.picture import gather_scenario_picture
from tdcr_planner.report.plain import plain_json
from tdcr_planner.report.scene_html import Beside, render_html
from tdcr_planner.report.text import figure_text

REACH_FORMAT = "tdcr-reach/1"
REACH_FILES = ("reach.json", "reach.csv", "reach.png", "reach.html")
"""What `tdcr reach` writes."""

COLOURS = {
    Verdict.REACHED: "#12A594",
    Verdict.NO_PATH: "#E8A317",
    Verdict.COLLIDES: "#B4436C",
    Verdict.LIMIT: "#6F5BA7",
    Verdict.OUT_OF_REACH: "#D5DBE2",
}
PAIR_NAMES = ("both", "only the first", "only the second", "neither")
PAIR_COLOURS = ("#12A594", "#2176B5", "#D55E00", "#D5DBE2")


def write_reach_data(found: ReachMap, scenario: Scenario, folder: str | Path, other: ReachMap | None = None) -> Path:
    """Writes reach.json and reach.csv, both or none; returns the path of reach.json.

    Args:
        found: The map.
        scenario: What it is of.
        folder: Where to write.
        other: A map of another robot on the same grid.

    Raises:
        FormatError: The folder cannot be written.
    """
    target = real_path(folder)
    with write_folder_whole(target) as staging:
        content = reach_content(found, scenario)
        if other is not None:
            content["other"] = _counts(other)
            pairs = pair_classes(found, other)
            content["difference"] = {name: int((pairs == index).sum()) for index, name in enumerate(PAIR_NAMES)}
        text = json.dumps(plain_json(content), indent=1, allow_nan=False)
        (staging / "reach.json").write_text(text + "\n", encoding="utf-8")
        _write_csv(found, scenario, staging / "reach.csv", other)
    return target / "reach.json"


def _counts(found: ReachMap) -> dict[str, Any]:
    return {
        "cells": {NAMES[verdict]: found.count(verdict) for verdict in Verdict},
        "reached_volume_m3": found.reached_volume,
        "states": found.states,
        "confirmed_by_reference": found.confirmed,
        "refused_by_reference": found.refused,
        "seconds": found.seconds,
    }


def reach_content(found: ReachMap, scenario: Scenario) -> dict[str, Any]:
    """Returns what reach.json says."""
    grid = found.grid
    return {
        "format": REACH_FORMAT,
        "scenario": str(scenario.path),
        "scenario_sha256": scenario.sha256,
        "robot": scenario.robot.name,
        "grid": {"lower_m": grid.lower, "cell_m": grid.size, "shape": list(grid.shape)},
        **_counts(found),
    }


def _write_csv(found: ReachMap, scenario: Scenario, file: Path, other: ReachMap | None) -> None:
    space = ConfigurationSpace(scenario)
    names = [f"bending_{segment + 1}_{axis}_n" for segment in range(scenario.robot.segment_count) for axis in "xy"]
    header = ["cell", "x_m", "y_m", "z_m", "verdict", "cause", *names, "insertion_m", "roll_deg"]
    header += ["tip_x_m", "tip_y_m", "tip_z_m"]
    if other is not None:
        header += ["other_verdict", "other_cause"]
    insertion, roll = space.insertion(found.rows), np.rad2deg(space.roll(found.rows))
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        for cell, centre in enumerate(found.grid.centres):
            attained = found.verdicts[cell] <= Verdict.NO_PATH
            row = found.rows[cell][: space.bending_count]
            values = [*row, insertion[cell], roll[cell], *found.tips[cell]] if attained else [""] * (len(names) + 5)
            line = [cell, *(f"{value:.6g}" for value in centre), NAMES[Verdict(found.verdicts[cell])]]
            line += [found.causes[cell], *(value if value == "" else f"{value:.9g}" for value in values)]
            if other is not None:
                line += [NAMES[Verdict(other.verdicts[cell])], other.causes[cell]]
            writer.writerow(line)


def pair_classes(first: ReachMap, second: ReachMap) -> IntArray:
    """Returns the index into `PAIR_NAMES` of each cell, shape (cells,): which of two robots reaches it."""
    one, two = first.verdicts == Verdict.REACHED, second.verdicts == Verdict.REACHED
    return np.where(one & two, 0, np.where(one, 1, np.where(two, 2, 3)))


def draw_reach(
    found: ReachMap, scenario: Scenario, folder: str | Path, other: tuple[ReachMap, Scenario] | None = None
) -> list[str]:
    """Draws reach.png and reach.html into a folder; returns the names of those that were drawn."""
    return draw_pictures(
        folder,
        {
            "reach.png": partial(_write_png, found, scenario, other),
            "reach.html": partial(_write_html, found, scenario, other),
        },
    )


Layer = tuple[str, str, IntArray, FloatArray]


def _layers(found: ReachMap, other: tuple[ReachMap, Scenario] | None) -> list[Layer]:
    """Returns name, colour, cells and their middles of everything that is shown; out of reach is not."""
    centres = found.grid.centres
    if other is None:
        chosen = [(NAMES[verdict], COLOURS[verdict], np.flatnonzero(found.verdicts == verdict)) for verdict in Verdict]
    else:
        pairs = pair_classes(found, other[0])
        chosen = [
            (name, colour, np.flatnonzero(pairs == index))
            for index, (name, colour) in enumerate(zip(PAIR_NAMES, PAIR_COLOURS, strict=True))
        ]
    return [(name, colour, cells, centres[cells]) for name, colour, cells in chosen[:-1] if len(cells)]


def _write_html(found: ReachMap, scenario: Scenario, other: tuple[ReachMap, Scenario] | None, file: Path) -> None:
    picture = gather_scenario_picture(scenario, "reach", _describe(found, scenario, other))
    attained = found.grid.centres[found.verdicts <= Verdict.NO_PATH]
    picture = replace(picture, in_view=attained)
    traces = []
    for name, colour, cells, centres in _layers(found, other):
        faint = name in (NAMES[Verdict.COLLIDES], NAMES[Verdict.LIMIT])
        texts = [f"{name}{': ' + found.causes[cell] if found.causes[cell] and faint else ''}" for cell in cells]
        traces.append(
            {
                "type": "scatter3d",
                **dict(zip("xyz", 1e3 * centres.T, strict=True)),
                "mode": "markers",
                "marker": {"size": 1.6 if faint else 3.2, "symbol": "square", "color": colour,
                           "opacity": 0.25 if faint else 0.85},
                "text": texts,
                "hoverinfo": "none",
                "visible": "legendonly" if faint else True,
                "name": name,
                "meta": legend_entry(name, "surface", colour),
            }
        )  # fmt: skip
    beside = Beside(traces=traces, summary=_describe(found, scenario, other))
    Path(file).write_text(render_html(picture, beside), encoding="utf-8")


def _describe(found: ReachMap, scenario: Scenario, other: tuple[ReachMap, Scenario] | None) -> str:
    text = (
        f"robot {scenario.robot.name} reaches {found.count(Verdict.REACHED):,} of {found.grid.cells:,} cells of "
        f"{1e3 * found.grid.size:.1f} mm, {1e6 * found.reached_volume:.0f} cm\u00b3"
    )
    if other is not None:
        second, query = other
        pairs = pair_classes(found, second)
        text += (
            f"; {query.robot.name} {second.count(Verdict.REACHED):,}; both {int((pairs == 0).sum()):,}, only the first "
            f"{int((pairs == 1).sum()):,}, only the second {int((pairs == 2).sum()):,}"
        )
    return text


def _write_png(found: ReachMap, scenario: Scenario, other: tuple[ReachMap, Scenario] | None, file: Path) -> None:
    with plots.plot_style():
        plots.save_figure(_draw(found, scenario, other), file)


def _draw(found: ReachMap, scenario: Scenario, other: tuple[ReachMap, Scenario] | None) -> Figure:
    """Returns three views along the axes: of every line of cells the best verdict on it."""
    figure = plots.new_figure(1600, 620, 120)
    if other is None:
        values, colours = found.verdicts, [COLOURS[verdict] for verdict in Verdict]
        names = [NAMES[verdict] for verdict in Verdict]
    else:
        values, colours, names = pair_classes(found, other[0]), list(PAIR_COLOURS), list(PAIR_NAMES)
    volume = values.reshape(found.grid.shape)
    lower = 1e3 * found.grid.lower
    upper = lower + 1e3 * found.grid.size * np.array(found.grid.shape)
    for place, axis in enumerate((1, 2, 0)):
        kept = [index for index in range(3) if index != axis]
        axes = figure.add_axes((0.055 + 0.325 * place, 0.17, 0.265, 0.62))
        axes.imshow(
            volume.min(axis=axis).T, origin="lower", cmap=ListedColormap(colours), vmin=-0.5, vmax=len(colours) - 0.5,
            extent=(lower[kept[0]], upper[kept[0]], lower[kept[1]], upper[kept[1]]), interpolation="nearest",
        )  # fmt: skip
        axes.set_xlabel(f"{'xyz'[kept[0]]} (mm)")
        axes.set_ylabel(f"{'xyz'[kept[1]]} (mm)")
        axes.set_title(f"along {'xyz'[axis]}: the best of each line", loc="left", fontsize=10.5)
        axes.grid(visible=False)
    title = scenario.file.title or scenario.path.stem
    figure.text(0.02, 0.955, figure_text(f"Reach: {title}"), fontsize=15, fontweight="bold", va="center")
    figure.text(
        0.02, 0.90, figure_text(_describe(found, scenario, other)), fontsize=10.5, color=plots.MUTED, va="center"
    )
    for index, (name, colour) in enumerate(zip(names, colours, strict=True)):
        count = int((values == index).sum())
        figure.text(0.022 + 0.195 * index, 0.05, "\u25a0", fontsize=14, color=colour, va="center")
        figure.text(0.036 + 0.195 * index, 0.05, f"{name}: {count:,}", fontsize=8.5, va="center")
    return figure
