"""The files of a comparison: compare.json, tables, plots and pictures of the worst disagreements."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict

from tdcr_planner.compare.comparison import Comparison
from tdcr_planner.compare.confusion import agreement_by_clearance
from tdcr_planner.compare.paths import path_rates
from tdcr_planner.compare.verdicts import REFERENCE_VERDICTS, Variant
from tdcr_planner.errors import FormatError
from tdcr_planner.files import FileModel, parse_table, read_json, write_folder_whole
from tdcr_planner.planning.causes import CAUSES
from tdcr_planner.query.result import library_versions
from tdcr_planner.rates import quantiles, ratio_at_least
from tdcr_planner.report.compare_plots import compare_drawings
from tdcr_planner.report.disagreement import disagreement_drawings
from tdcr_planner.report.drawing import draw_pictures
from tdcr_planner.report.plain import plain_json
from tdcr_planner.report.tables import Row, write_csv

COMPARE_FORMAT = "tdcr-compare/1"


def write_comparison(comparison: Comparison, folder: str | Path) -> Path:
    """Writes a comparison's numbers, all files or none, then draws its plots and pictures.

    Args:
        comparison: The comparison.
        folder: Where to write; made when missing. Files of an earlier comparison are replaced, and pictures and plots
            that it had and this one has not are removed.

    Returns:
        The path of compare.json.

    Raises:
        FormatError: The folder cannot be written. A picture that cannot be drawn is a warning.
    """
    file = write_comparison_data(comparison, folder)
    draw_comparison(comparison, folder)
    return file


def write_comparison_data(comparison: Comparison, folder: str | Path) -> Path:
    """Writes the numbers of a comparison, all files or none; returns the path of compare.json.

    compare.json; verdicts.csv (a row a variant), agreement.csv (a row a variant and clearance bin), states.csv (a row
    a state), paths.csv (a row a query).

    Raises:
        FormatError: The folder cannot be written.
    """
    content = comparison_content(comparison)
    content["pictures"] = list(disagreement_drawings(comparison))
    earlier = _optional_files(Path(folder) / "compare.json")
    with write_folder_whole(folder, last="compare.json") as staging:
        for name, rows in (
            ("verdicts", verdict_rows(comparison)),
            ("agreement", agreement_rows(comparison)),
            ("states", state_rows(comparison)),
            ("paths", [asdict(path) for path in comparison.paths]),
        ):
            if rows:
                write_csv(rows, list(rows[0]), staging / f"{name}.csv")
        text = json.dumps(plain_json(content), indent=1, allow_nan=False)
        (staging / "compare.json").write_text(text + "\n", encoding="utf-8")
    for name in earlier - _optional_files(Path(folder) / "compare.json"):
        (Path(folder) / name).unlink(missing_ok=True)
    return Path(folder) / "compare.json"


def draw_comparison(comparison: Comparison, folder: str | Path) -> list[str]:
    """Draws plots as PNG and PDF and a picture of each of the worst disagreements; returns what was drawn.

    A picture that cannot be drawn is a warning that names it.
    """
    return draw_pictures(folder, compare_drawings(comparison) | disagreement_drawings(comparison))


def _optional_files(path: Path) -> set[str]:
    """Returns the files of a comparison that another one in the same folder may not have; none without a comparison."""
    try:
        earlier = parse_table(_EarlierFile, read_json(path), path)
    except FormatError:
        return set()
    # Only names that pictures have: a damaged file must not have others removed.
    pictures = {name for name in earlier.pictures if Path(name).name == name and name.endswith(".png")}
    return pictures | ({"paths.csv", "paths.png", "paths.pdf"} if earlier.paths else set())


class _EarlierFile(FileModel):
    """What is read of an earlier compare.json."""

    model_config = ConfigDict(extra="ignore")

    format: Literal["tdcr-compare/1"]
    pictures: list[str]
    paths: list[dict[str, Any]]


def comparison_content(comparison: Comparison) -> dict[str, Any]:
    """Returns the content of compare.json."""
    scenario, verdicts = comparison.scenario, comparison.verdicts
    rates = {variant.name: comparison.confusion(variant).rates for variant in verdicts.variants}
    causes = np.bincount(verdicts.reference, minlength=len(REFERENCE_VERDICTS))
    return {
        "format": COMPARE_FORMAT,
        "scenario": str(scenario.path),
        "hashes": comparison.hashes,
        "versions": library_versions(),
        "seed": comparison.seed,
        "samples": len(verdicts.rows),
        "draws": comparison.drawn,
        "beyond_tension_limits": comparison.drawn - len(verdicts.rows),
        "clearance_m": scenario.planner.clearance_m,
        "step_m": scenario.planner.step_m,
        "error_bound_m": comparison.error_bound,
        "reference": {name: int(count) for name, count in zip(REFERENCE_VERDICTS, causes, strict=True)},
        "variants": {
            variant.name: {
                "model": variant.model,
                "margin": {"error_bound": variant.with_bound, "half_step": variant.with_half_step},
                "confusion": asdict(comparison.confusion(variant)),
                "rates": {name: rate.as_dict() for name, rate in rates[variant.name].items()},
                "deviation_m": _deviations(comparison, variant),
                "missing_clearance_m": _missing_clearance(comparison, variant),
                "agreement_by_clearance": [asdict(part) for part in _bins(comparison, variant)],
            }
            for variant in verdicts.variants
        },
        "false_valid_ratio": {
            name: _ratio(
                rates[f"{verdicts.models[1]}{suffix}"]["false_valid"],
                rates[f"{verdicts.models[0]}{suffix}"]["false_valid"],
            )
            for name, suffix in (("states", ""), ("as_planned", "_as_planned"))
            if len(verdicts.models) > 1
        },
        "times": [asdict(time) for time in comparison.times],
        "paths": [
            {
                "model": rate.model,
                "found": rate.found.as_dict(),
                "verified_at_once_of_found": rate.verified_at_once.as_dict(),
                "verified": rate.verified.as_dict(),
            }
            for rate in (path_rates(comparison.paths, verdicts.models) if comparison.paths else ())
        ],
        "disagreements": [
            {
                "variant": item.variant,
                "kind": item.kind,
                "state": item.state,
                "cause": item.cause,
                "row": item.row,
                "clearance_m": item.clearance,
                "deviation_m": item.deviation,
            }
            for item in comparison.disagreements
        ],
        "seconds": comparison.seconds,
    }


def _ratio(above: Any, below: Any) -> dict[str, float | None]:
    """Returns the ratio of two rates (None where the lower one is zero) and its 95 % lower bound."""
    return {"value": above.value / below.value if below.count else None, "at_least": ratio_at_least(above, below)}


def _deviations(comparison: Comparison, variant: Variant) -> dict[str, Any]:
    valid, truth = comparison.verdicts.valid(variant), comparison.verdicts.reference_valid
    deviation = comparison.verdicts.deviation_of(variant.model)
    return {
        "all": quantiles(deviation),
        "false_valid": quantiles(deviation[valid & ~truth]),
        "false_invalid": quantiles(deviation[~valid & truth]),
    }


def _missing_clearance(comparison: Comparison, variant: Variant) -> dict[str, Any]:
    """Returns quantiles of how much clearance the false-valid states lack, m."""
    wrong = comparison.verdicts.valid(variant) & ~comparison.verdicts.reference_valid
    return quantiles(comparison.scenario.planner.clearance_m - comparison.verdicts.clearance[wrong])


def _bins(comparison: Comparison, variant: Variant) -> Any:
    verdicts = comparison.verdicts
    return agreement_by_clearance(
        verdicts.valid(variant),
        verdicts.reference_valid,
        verdicts.clearance,
        comparison.scenario.planner.clearance_m,
    )


def verdict_rows(comparison: Comparison) -> list[Row]:
    """Returns a row a variant: confusion matrix, each rate with its interval, deviations and missing clearance."""
    rows = []
    for variant in comparison.verdicts.variants:
        confusion = comparison.confusion(variant)
        row: Row = {"variant": variant.name, "states": confusion.total, **asdict(confusion)}
        for name, rate in confusion.rates.items():
            row |= {name: rate.as_dict()["value"], f"{name}_low": rate.low, f"{name}_high": rate.high}
        for group, spread in _deviations(comparison, variant).items():
            row |= {f"deviation_{group}_{name}_m": spread[name] for name in ("median", "max")}
        missing = _missing_clearance(comparison, variant)
        row |= {f"missing_clearance_{name}_m": missing[name] for name in ("median", "max")}
        rows.append(row)
    return rows


def agreement_rows(comparison: Comparison) -> list[Row]:
    """Returns a row a variant and clearance bin."""
    return [
        {
            "variant": variant.name,
            "excess_clearance_from_m": part.low,
            "excess_clearance_to_m": part.high,
            "states": part.agreement.total,
            "agreement": part.agreement.value,
            "agreement_low": part.agreement.low,
            "agreement_high": part.agreement.high,
        }
        for variant in comparison.verdicts.variants
        for part in _bins(comparison, variant)
    ]


def state_rows(comparison: Comparison) -> list[Row]:
    """Returns a row a state: configuration, the reference's verdict and clearance, each variant's verdict."""
    verdicts = comparison.verdicts
    names = coordinate_names(comparison)
    words = ["valid", *(cause.value for cause in CAUSES)]
    deviations = {f"deviation_{model}_m": verdicts.deviation_of(model).tolist() for model in verdicts.models}
    rows = []
    for state, (row, reference, clearance) in enumerate(
        zip(verdicts.rows.tolist(), verdicts.reference.tolist(), verdicts.clearance.tolist(), strict=True)
    ):
        rows.append(
            {
                "state": state,
                **dict(zip(names, row, strict=True)),
                "reference": REFERENCE_VERDICTS[reference],
                "clearance_m": clearance,
                **{name: values[state] for name, values in deviations.items()},
                **{
                    variant.name: words[verdicts.codes[state, place]] for place, variant in enumerate(verdicts.variants)
                },
            }
        )
    return rows


def coordinate_names(comparison: Comparison) -> list[str]:
    """Returns the names of a configuration's coordinates, with units."""
    base = comparison.scenario.file.base
    names = [
        f"bending_{segment + 1}_{axis}_n" for segment in range(comparison.scenario.robot.segment_count) for axis in "xy"
    ]
    names += ["insertion_m"] if base.insertion_m is not None else []
    return names + (["roll_rad"] if base.roll_deg is not None else [])
