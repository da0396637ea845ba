"""tdcr evaluate: accuracy and speed of a shape model against the reference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

if TYPE_CHECKING:
    from tdcr_planner.learning.evaluate import Evaluation
    from tdcr_planner.shape.learned import LearnedShape


def evaluate(
    model: tyro.conf.Positional[Path],
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
        model: Model file.
        samples: Cases of each sample (uniform in the domain, and as the planner meets them).
        out: Folder for evaluation.json, evaluation.md and plots; only printed without it.
        seed: Seed of the cases.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from tdcr_planner.bounds import EVALUATION_SAMPLES, SEED
    from tdcr_planner.cli.cost import REFERENCE_S, SHAPE_BYTES, tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import StageBar
    from tdcr_planner.files import check_folder
    from tdcr_planner.learning.evaluate import evaluate_model
    from tdcr_planner.learning.fitness import judge_fitness
    from tdcr_planner.report.model_plots import draw_evaluation
    from tdcr_planner.shape.learned import load_shape_model

    EVALUATION_SAMPLES.check("--samples", samples)
    SEED.check("--seed", seed)
    if out is not None:
        check_folder(out)
    loaded = load_shape_model(model)
    tell_cost("--samples", 4 * samples * REFERENCE_S, 2 * samples * loaded.robot.disk_count * SHAPE_BYTES)
    with StageBar(shown=progress) as bar:
        evaluation = evaluate_model(loaded, samples, seed=seed, progress=bar.update)
        fitness = judge_fitness(loaded, seed=seed, progress=bar.update)
    text = f"{describe(loaded, evaluation)}\n\n{fitness.describe()}"
    print(text, flush=True)
    if out is not None:
        _write(loaded, evaluation, text, out)
        drawn = draw_after("the evaluation", lambda: draw_evaluation(loaded, evaluation, out))
        print(f"files: {' '.join([f'{out}/evaluation.json', 'evaluation.md', *drawn])}")
    return 0 if _bound_holds(loaded, evaluation) else 1


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


def _write(model: LearnedShape, evaluation: Evaluation, text: str, out: Path) -> None:
    import json

    from tdcr_planner.files import write_folder_whole

    content: dict[str, Any] = {
        "model": str(model.path),
        "model_sha256": model.sha256,
        "accuracy": [accuracy.model_dump() for accuracy in evaluation.accuracy],
        "constant_curvature": evaluation.constant_curvature.model_dump(),
        "coverage": evaluation.coverage,
        "arc_length_violation": evaluation.arc_length_violation,
        "rotation_violation": evaluation.rotation_violation,
        "timings_us": [
            {"batch": timing.batch, "model": timing.model_us, "reference": timing.reference_us}
            for timing in evaluation.timings
        ],
    }
    with write_folder_whole(out, last="evaluation.json") as staging:
        (staging / "evaluation.md").write_text(text, encoding="utf-8")
        (staging / "evaluation.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
