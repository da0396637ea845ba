"""The files of a robustness assessment: robustness.json and a figure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tdcr_planner.arrays import FloatArray
from tdcr_planner.files import write_folder_whole
from tdcr_planner.query.result import PlanResult, library_versions
from tdcr_planner.rates import quantiles
from tdcr_planner.report.drawing import draw_pictures
from tdcr_planner.report.plain import plain_json
from tdcr_planner.report.plots import ALERT, INK, MUTED, PALETTE, new_figure, plot_style, save_figure
from tdcr_planner.robustness import Robustness, Spread

ROBUSTNESS_FORMAT = "tdcr-robustness/1"
TOLERANCE_NAMES = {
    "youngs_modulus": "Young's modulus",
    "tension": "tension",
    "mass": "mass",
    "base_position_m": "base position",
    "base_angle_deg": "base angle",
    "tension_offset_n": "tension offset",
    "displacement": "displacement",
    "displacement_offset_m": "displacement offset",
    "friction": "friction",
    "length": "length",
    "tendon_circle": "tendon circle",
    "tendon_angle_deg": "tendon angle",
    "mesh_position_m": "mesh position",
    "mesh_angle_deg": "mesh angle",
    "mesh_scale": "mesh scale",
}


def write_robustness(result: PlanResult, found: Robustness, folder: str | Path) -> Path:
    """Writes robustness.json, then draws robustness.png.

    Args:
        result: The result whose path was assessed.
        found: What came out.
        folder: Where to write; made when missing.

    Returns:
        The path of robustness.json.

    Raises:
        FormatError: The folder cannot be written. A picture that cannot be drawn is a warning.
    """
    file = write_robustness_data(result, found, folder)
    draw_robustness(found, folder)
    return file


def write_robustness_data(result: PlanResult, found: Robustness, folder: str | Path) -> Path:
    """Writes robustness.json and returns its path.

    Raises:
        FormatError: The folder cannot be written.
    """
    with write_folder_whole(folder, last="robustness.json") as staging:
        text = json.dumps(plain_json(robustness_content(result, found)), indent=1, allow_nan=False)
        (staging / "robustness.json").write_text(text + "\n", encoding="utf-8")
    return Path(folder) / "robustness.json"


def draw_robustness(found: Robustness, folder: str | Path) -> list[str]:
    """Draws robustness.png and returns the names of what was drawn; a picture that cannot be drawn is a warning."""
    return draw_pictures(folder, {"robustness.png": lambda file: _plot(found, file)})


def robustness_content(result: PlanResult, found: Robustness) -> dict[str, Any]:
    """Returns the content of robustness.json."""
    return {
        "format": ROBUSTNESS_FORMAT,
        "scenario": str(result.scenario.path),
        "hashes": result.hashes,
        "versions": library_versions(),
        "seed": found.seed,
        "samples": found.samples,
        "tolerances": dict(found.tolerances.items()),
        "clearance_m": found.asked,
        "verified": found.verified_rate.as_dict(),
        "collision_free": found.collision_free_rate.as_dict(),
        "not_verified_because_of": found.causes,
        "nominal_least_clearance_m": float(found.nominal.min()),
        "all_together": _numbers(found.spread),
        "alone": {name: _numbers(spread) for name, spread in found.effects.items()},
        "time_s": found.times,
        "nominal_clearance_m": found.nominal,
        "clearance_m_p05": lowest_of(found.spread.clearance, 0.05),
    }


def lowest_of(clearance: FloatArray, level: float) -> FloatArray:
    """Returns the quantile over robots of each state's clearance; minus infinity where too many have no shape.

    Args:
        clearance: Shape (samples, k), m; NaN where a robot has no stable shape.
        level: 0 to 1.

    Returns:
        Shape (k,), m.
    """
    return np.asarray(np.quantile(np.nan_to_num(clearance, nan=-np.inf), level, axis=0, method="lower"))


def _numbers(spread: Spread) -> dict[str, Any]:
    return {
        "least_clearance_m": quantiles(spread.least_clearance),
        "largest_tip_shift_m": quantiles(spread.largest_tip_shift),
        "without_stable_shape": int(np.isinf(spread.least_clearance).sum()),
    }


def _plot(found: Robustness, path: Path) -> None:
    with plot_style():
        figure = new_figure(1200, 460)
        along, alone = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
        _draw_along(along, found)
        _draw_alone(alone, found)
        figure.tight_layout(w_pad=2.5)
        save_figure(figure, path)


def _draw_along(axes: Axes, found: Robustness) -> None:
    """Draws the clearance along the path: as the file has the robot, and what the drawn ones leave of it."""
    times = found.times
    for low, high, shade in ((0.0, 1.0, 0.15), (0.05, 0.95, 0.3)):
        bottom, top = (1e3 * lowest_of(found.spread.clearance, level) for level in (low, high))
        label = f"{found.samples} robots" if low == 0.0 else "90 % of them"
        axes.fill_between(times, bottom, top, color=PALETTE["blue"], alpha=shade, linewidth=0.0, label=label)
    axes.plot(times, 1e3 * found.nominal, color=INK, label="robot as in the file")
    asked = 1e3 * found.asked
    axes.axhline(asked, color=ALERT, linewidth=1.2, linestyle=(0, (5, 3)), label=f"required {asked:g} mm")
    axes.axhline(0.0, color=MUTED, linewidth=1.0)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("clearance (mm)")
    rate = found.verified_rate
    interval = f"95 %: {100.0 * rate.low:.0f} to {100.0 * rate.high:.0f} %"
    axes.set_title(f"Verified for {rate.count} of {rate.total} robots ({interval})", fontsize=10.5)
    axes.legend(ncols=2)


def _draw_alone(axes: Axes, found: Robustness) -> None:
    """Draws how much clearance each tolerance takes by itself, as the 5th percentile over the robots."""
    nominal = 1e3 * float(found.nominal.min())
    spreads = {"all together": found.spread}
    spreads |= {f"{TOLERANCE_NAMES[name]}\n{_size(found, name)}": spread for name, spread in found.effects.items()}
    rows = np.arange(len(spreads))[::-1]
    left = [1e3 * float(np.quantile(spread.least_clearance, 0.05, method="lower")) for spread in spreads.values()]
    shown = np.maximum(left, -nominal)
    colours = [PALETTE["vermilion"] if value < 1e3 * found.asked else PALETTE["blue"] for value in left]
    axes.barh(rows, shown, color=colours, height=0.6)
    for row, value, end in zip(rows, left, shown, strict=True):
        text = f"{value:.2f}" if np.isfinite(value) else "no stable shape"
        axes.annotate(
            text, (max(end, 0.0), row), xytext=(4, 0), textcoords="offset points", va="center", color=INK, fontsize=9.0
        )
    axes.axvline(nominal, color=INK, linewidth=1.8)
    axes.axvline(1e3 * found.asked, color=ALERT, linewidth=1.2, linestyle=(0, (5, 3)))
    axes.set_yticks(rows, list(spreads))
    axes.set_xlabel("least clearance of the path, 5th percentile (mm)")
    axes.set_title("What takes the clearance", fontsize=10.5)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.12)


def _size(found: Robustness, name: str) -> str:
    value = getattr(found.tolerances, name)
    for ending, text in (("_m", f"{1e3 * value:g} mm"), ("_deg", f"{value:g}°"), ("_n", f"{value:g} N")):
        if name.endswith(ending):
            return text
    return f"{100.0 * value:g} %"
