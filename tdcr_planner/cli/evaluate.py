"""tdcr evaluate: accuracy and speed of a shape model against the reference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

if TYPE_CHECKING:
    from tdcr_planner.learning.evaluate import Evaluation
    from tdcr_planner.shape.learned import LearnedShape


def evaluate(
    models: tyro.conf.Positional[tuple[Path, ...]],
    *,
    samples: int = 10_000,
    out: Path | None = None,
    seed: int = 0,
    progress: bool = True,
) -> int:
    """Measure a shape model on fresh cases: accuracy, physics, error bound and speed against the reference.

    Example: tdcr evaluate models/shape/inspection/model.pt --samples 20000 --out out/inspection

    Says too whether the model is fit for planning with its robot, as `tdcr train` does. Exit code 1 says that fresh
    cases exceed the model's error bound more often than it promises.

    Args:
        models: Model file; of several a table and a plot of error against time.
        samples: Cases of each sample (uniform in the domain, and as the planner meets them).
        out: Folder for evaluation.json, evaluation.md and plots; only printed without it.
        seed: Seed of the cases.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from tdcr_planner.bounds import EVALUATION_SAMPLES, SEED
    from tdcr_planner.cli.cost import REFERENCE_S, SHAPE_BYTES, tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import StageBar
    from tdcr_planner.errors import InputError
    from tdcr_planner.files import check_folder
    from tdcr_planner.learning.evaluate import evaluate_model
    from tdcr_planner.learning.fitness import judge_fitness
    from tdcr_planner.report.model_plots import draw_evaluation
    from tdcr_planner.report.side_by_side import PLOT, draw_error_against_time
    from tdcr_planner.shape.learned import load_shape_model

    EVALUATION_SAMPLES.check("--samples", samples)
    SEED.check("--seed", seed)
    if out is not None:
        check_folder(out)
    if not models:
        raise InputError("models", "a model file or more", "none")
    loaded = [load_shape_model(model) for model in models]
    states = sum(2 * samples * model.robot.disk_count for model in loaded)
    tell_cost("--samples", 4 * samples * len(loaded) * REFERENCE_S, states * SHAPE_BYTES)
    found: list[tuple[LearnedShape, Evaluation]] = []
    texts = []
    with StageBar(shown=progress) as bar:
        for model in loaded:
            evaluation = evaluate_model(model, samples, seed=seed, progress=bar.update)
            fitness = judge_fitness(model, seed=seed, progress=bar.update)
            found.append((model, evaluation))
            texts.append(f"{describe(model, evaluation)}\n\n{fitness.describe()}")
    if len(found) > 1:
        texts.append(_describe_together(found))
    print("\n\n".join(texts), flush=True)
    if out is not None:
        _write(found, "\n\n".join(texts), out)

        def draw() -> list[str]:
            if len(found) == 1:
                return draw_evaluation(*found[0], out)
            draw_error_against_time(_points(found), out / PLOT)
            return [PLOT]

        print(f"files: {' '.join([f'{out}/evaluation.json', 'evaluation.md', *draw_after('the evaluation', draw)])}")
    return 0 if all(_bound_holds(model, evaluation) for model, evaluation in found) else 1


def _points(found: list[tuple[LearnedShape, Evaluation]]) -> list[tuple[str, float, float, float]]:
    """Returns models, and constant curvature and the reference of the first, as points of error against time."""
    points = []
    for model, evaluation in found:
        overall = evaluation.accuracy[-1].overall
        errors = overall["position_median_mm"], overall["position_p99_mm"]
        points.append((model.path.name, evaluation.timings[0].model_us, *errors))
    first = found[0][1]
    return [*points, ("reference", first.timings[0].reference_us, 0.0, 0.0)]


def _describe_together(found: list[tuple[LearnedShape, Evaluation]]) -> str:
    """Returns one table of several models as Markdown: uniform cases of each one's own domain."""
    from tdcr_planner.report.tables import format_markdown
    from tdcr_planner.report.text import markdown_text

    rows = []
    for model, evaluation in found:
        overall = evaluation.accuracy[-1].overall
        tip = model.error_bound[-1]
        if evaluation.margin:
            tip = evaluation.margin["planner"].median_tip_m
        rows.append(
            [
                markdown_text(str(model.path)),
                markdown_text(model.card.robot.name),
                f"{overall['position_median_mm']:.3g}",
                f"{overall['position_p99_mm']:.3g}",
                f"{1e3 * tip:.3g}",
                "state" if model.bound_follows_state else "uniform",
                f"{min(evaluation.coverage.values()):.3%}",
                f"{evaluation.timings[0].model_us:.3g}",
                f"{evaluation.timings[0].reference_us:.3g}",
            ]
        )
    first = found[0][1].constant_curvature.overall
    rows.append(
        [
            "constant curvature",
            "",
            f"{first['position_median_mm']:.3g}",
            f"{first['position_p99_mm']:.3g}",
            "0",
            "none",
            "",
            "",
            "",
        ]
    )
    header = [
        "model",
        "robot",
        "median mm",
        "99 % mm",
        "bound at the tip mm",
        "bound",
        "covered",
        "us a shape",
        "reference us",
    ]
    return format_markdown(header, rows)


def describe(model: LearnedShape, evaluation: Evaluation) -> str:
    """Returns an evaluation as Markdown tables."""
    from tdcr_planner.report.tables import format_markdown
    from tdcr_planner.report.text import markdown_text

    header = ["model", "sample", "cases", "median mm", "99 % mm", "largest mm", "rotation median °", "residual N m"]
    rows = []
    for name, accuracy in [
        *((model.card.network, accuracy) for accuracy in evaluation.accuracy),
        ("constant curvature", evaluation.constant_curvature),
    ]:
        overall = accuracy.overall
        figures = [overall[key] for key in ("position_median_mm", "position_p99_mm", "position_max_mm")]
        rows.append(
            [
                name,
                accuracy.sample,
                str(accuracy.cases),
                *(f"{figure:.4g}" for figure in figures),
                f"{overall['rotation_median_deg']:.4g}",
                f"{overall['residual_median_nm']:.2g}" if "residual_median_nm" in overall else "",
            ]
        )
    loads = [
        [f"{index / len(evaluation.by_load):.0%} to {(index + 1) / len(evaluation.by_load):.0%}"]
        + [f"{1e3 * value:.4g}" for value in row]
        for index, row in enumerate(evaluation.by_load)
    ]
    speed = [
        [
            f"{timing.batch}",
            f"{timing.model_us:.2f}",
            f"{timing.reference_us:.1f}",
            f"{timing.reference_us / timing.model_us:.1f}",
        ]
        for timing in evaluation.timings
    ]
    bound = model.card.error_bound
    lines = [
        f"# {markdown_text(model.card.robot.name)}: {markdown_text(model.path.name)} {model.sha256[:12]}\n",
        format_markdown(header, rows),
        f"Largest | \\|p'\\| - 1 | {evaluation.arc_length_violation:.1e} (axial strain included), "
        f"largest \\|R'R - I\\| {evaluation.rotation_violation:.1e}.\n",
        f"Error bound {1e3 * max(bound.disk_m):.4g} mm for alpha = {bound.alpha:g}; inside it at every disk: "
        + ", ".join(f"{share:.4%} of {sample} cases" for sample, share in evaluation.coverage.items())
        + ".\n",
        *(
            f"Bound by state, {sample} cases: {1e3 * covered.median_tip_m:.3g} mm at the tip in the median; "
            f"inside it {covered.overall:.3%}, tenths {min(covered.deciles):.3%} to {max(covered.deciles):.3%}.\n"
            for sample, covered in evaluation.margin.items()
        ),
        format_markdown(["load", "median mm", "99 % mm"], loads),
        format_markdown(["batch", "model, us a shape", "reference, us a shape", "ratio"], speed),
    ]
    return "\n".join(lines)


def _bound_holds(model: LearnedShape, evaluation: Evaluation) -> bool:
    """Whether the share outside is one that alpha explains: its mean plus three standard deviations, and one case."""
    alpha = model.card.error_bound.alpha
    for accuracy in evaluation.accuracy:
        outside = (1.0 - evaluation.coverage[accuracy.sample]) * accuracy.cases
        expected = alpha * accuracy.cases
        if outside > expected + 3.0 * expected**0.5 + 1.0:
            return False
    return True


def _write(found: list[tuple[LearnedShape, Evaluation]], text: str, out: Path) -> None:
    import json

    from tdcr_planner.files import write_folder_whole

    contents = [_content(model, evaluation) for model, evaluation in found]
    content = contents[0] if len(contents) == 1 else {"models": contents}
    with write_folder_whole(out, last="evaluation.json") as staging:
        (staging / "evaluation.md").write_text(text, encoding="utf-8")
        (staging / "evaluation.json").write_text(json.dumps(content, indent=1), encoding="utf-8")


def _content(model: LearnedShape, evaluation: Evaluation) -> dict[str, Any]:
    return {
        "model": str(model.path),
        "model_sha256": model.sha256,
        "accuracy": [accuracy.model_dump() for accuracy in evaluation.accuracy],
        "constant_curvature": evaluation.constant_curvature.model_dump(),
        "coverage": evaluation.coverage,
        "margin": {
            sample: {"overall": covered.overall, "deciles": covered.deciles, "median_tip_m": covered.median_tip_m}
            for sample, covered in evaluation.margin.items()
        },
        "arc_length_violation": evaluation.arc_length_violation,
        "rotation_violation": evaluation.rotation_violation,
        "timings_us": [
            {"batch": timing.batch, "model": timing.model_us, "reference": timing.reference_us}
            for timing in evaluation.timings
        ],
    }
