"""Figures of a calibration: what it leaves over, over time, over the actuation, and by the direction of motion."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.calibrate import Calibration
from tdcr_planner.report.plots import ALERT, INK, PALETTE, new_figure, plot_style, save_figure

COLOURS = {"calibrated": PALETTE["blue"], "uncalibrated": PALETTE["orange"], "constant curvature": PALETTE["purple"]}


def plot_residuals(found: Calibration, path: Path) -> None:
    """Draws the errors of held-out states into a picture.

    Args:
        found: The calibration.
        path: The picture.
    """
    with plot_style():
        figure = new_figure(1300, 820)
        axes = figure.subplots(2, 2, width_ratios=(1.5, 1.0))
        _draw_over_time(axes[0, 0], found)
        _draw_models(axes[0, 1], found)
        _draw_over_actuation(axes[1, 0], found)
        _draw_directions(axes[1, 1], found)
        figure.tight_layout(h_pad=2.0, w_pad=2.5)
        save_figure(figure, path)


def point_errors(found: Calibration, model: str = "calibrated") -> FloatArray:
    """Returns the held-out error of the outermost tracked point, shape (n,), m; NaN where it was not seen."""
    return found.errors(model)[:, -1]


def actuation_size(found: Calibration) -> FloatArray:
    """Returns how far the actuation of each state is from one that does not bend, shape (n,), mm or N.

    It is the root mean square over tendons, with the mean of each segment's tendons taken off: what all tendons of a
    segment have in common bends nothing.
    """
    robot, states = found.robot, found.states
    values = states.displacements if found.nominal.drives_displacement else states.tensions
    values = values - values[:1] if found.nominal.drives_displacement else values.copy()
    for segment in np.unique(robot.tendon_segments):
        own = robot.tendon_segments == segment
        values[:, own] -= values[:, own].mean(axis=1, keepdims=True)
    size = np.sqrt(np.mean(values**2, axis=1))
    return np.asarray(1e3 * size if found.nominal.drives_displacement else size)


def too_far(found: Calibration) -> FloatArray:
    """Returns by how much the model bends farther than the robot did, shape (n,), m.

    It is the component of the held-out difference along the motion of the model from its mean place across the base
    axis. Friction that the model lacks is of one sign on the pull and of the other on the release.
    """
    difference = found.held_out["calibrated"][:, -1]
    place = difference + found.states.positions[:, -1]
    from_mean = place - np.nanmean(place, axis=0)
    from_mean[:, 2] = 0.0
    size = np.linalg.norm(from_mean, axis=1, keepdims=True)
    return np.asarray(np.sum(difference * from_mean / np.maximum(size, 1e-9), axis=1))


def _draw_over_time(axes: Axes, found: Calibration) -> None:
    times = found.states.times
    axes.plot(times, 1e3 * point_errors(found), ".", color=COLOURS["calibrated"], markersize=3.5, label="held out")
    measured = found.robot.measured_error
    if measured is not None:
        bound = 1e3 * measured.disks_m[found.states.points[-1]]
        label = f"error bound, {100 * measured.level:g} %: {bound:.3g} mm"
        axes.axhline(bound, color=ALERT, linewidth=1.2, linestyle=(0, (5, 3)), label=label)
    for stretch in range(1, int(found.folds.max()) + 1):
        axes.axvline(times[np.flatnonzero(found.folds == stretch)[0]], color=INK, linewidth=0.6, alpha=0.4)
    axes.set_xlabel("time (s)" if found.states.timed else "state")
    axes.set_ylabel("error (mm)")
    axes.set_ylim(bottom=0.0)
    axes.set_title(f"Error of the {found.states.point_names()[-1]} over time; lines part the stretches held out")
    axes.legend(loc="upper right")


def _draw_models(axes: Axes, found: Calibration) -> None:
    for model, colour in COLOURS.items():
        errors = point_errors(found, model)
        ordered = np.sort(1e3 * errors[np.isfinite(errors)])
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        rms = np.sqrt(np.mean(ordered**2))
        axes.plot(ordered, 100.0 * share, color=colour, label=f"{model}, {rms:.3g} mm")
    axes.set_xscale("log")
    axes.set_xlabel("error (mm)")
    axes.set_ylabel("held-out states with at most this error (%)")
    axes.set_title("Models on held-out states")
    axes.legend(loc="upper left", title="root mean square", fontsize=8.5)


def _draw_over_actuation(axes: Axes, found: Calibration) -> None:
    size, errors = actuation_size(found), 1e3 * point_errors(found)
    axes.plot(size, errors, ".", color=COLOURS["calibrated"], markersize=3.5, alpha=0.6)
    seen = np.isfinite(errors)
    edges = np.quantile(size[seen], np.linspace(0.0, 1.0, 9))
    middles, medians = [], []
    for low, high in itertools.pairwise(edges):
        inside = seen & (size >= low) & (size <= high)
        if inside.any():
            middles.append(float(np.median(size[inside])))
            medians.append(float(np.median(errors[inside])))
    axes.plot(middles, medians, "o-", color=INK, markersize=5, label="median of an eighth of the states", zorder=3)
    unit = "mm" if found.nominal.drives_displacement else "N"
    axes.set_xlabel(f"actuation that bends, root mean square over tendons ({unit})")
    axes.set_ylabel("error (mm)")
    axes.set_ylim(bottom=0.0)
    axes.set_title("Error over the actuation")
    axes.legend(loc="upper left")


def _draw_directions(axes: Axes, found: Calibration) -> None:
    change = np.gradient(actuation_size(found))
    signed = 1e3 * too_far(found)
    seen = np.isfinite(signed)
    groups = {"pulling": seen & (change > 0.0), "releasing": seen & (change < 0.0)}
    values = [signed[group] for group in groups.values()]
    boxes = axes.boxplot(values, whis=(5, 95), widths=0.5, showfliers=False, patch_artist=True)
    for box, colour in zip(boxes["boxes"], (PALETTE["sky"], PALETTE["green"]), strict=True):
        box.set_facecolor(colour)
        box.set_alpha(0.6)
    for line in boxes["medians"]:
        line.set_color(INK)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    labels = [f"{name}\n{int(group.sum())} states" for name, group in groups.items()]
    axes.set_xticks([1, 2], labels)
    axes.set_ylabel("model bends farther than the robot (mm)")
    axes.set_title("By direction of motion (whiskers: 5 to 95 %)")
