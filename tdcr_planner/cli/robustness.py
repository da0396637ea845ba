"""tdcr robustness: a result's path on robots that are not quite as their file says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.robustness import Robustness


def robustness(
    result: tyro.conf.Positional[Path],
    *,
    out: Path | None = None,
    samples: int = 100,
    seed: int = 1,
    youngs_modulus: float = 0.05,
    tension: float = 0.02,
    mass: float = 0.02,
    base_position_mm: float = 0.5,
    base_angle_deg: float = 0.2,
    progress: bool = True,
) -> int:
    """Send a result's path through robots drawn within tolerances and count for how many the reference verifies it.

    Example: tdcr robustness out/elbow/result.json --youngs-modulus 0.1 --out out/elbow_robustness

    Every tolerance is a standard deviation: of what differs from robot to robot and stays the same along a path. 0
    leaves it as the files say.

    Args:
        result: The result.json that `tdcr plan` wrote.
        out: Folder for robustness.json and robustness.png; none are written without it.
        samples: Robots to draw; as many again for each tolerance by itself.
        seed: Seed of the draws.
        youngs_modulus: Of the backbone's Young's modulus, relative: 0.05 is 5 %.
        tension: Of each tendon's gain from commanded to real tension, relative.
        mass: Of backbone, disks and payload, one factor for all, relative.
        base_position_mm: Of the base's position, each axis, mm.
        base_angle_deg: Of the base's orientation, about each axis, degrees.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from tdcr_planner.bounds import ROBOTS, SEED
    from tdcr_planner.cli.cost import REFERENCE_S, SHAPE_BYTES, tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CountBar
    from tdcr_planner.errors import FormatError
    from tdcr_planner.files import check_folder
    from tdcr_planner.report.results import read_result
    from tdcr_planner.report.robustness_results import draw_robustness, write_robustness_data
    from tdcr_planner.robustness import Tolerances, assess_robustness

    tolerances = Tolerances(youngs_modulus, tension, mass, 1e-3 * base_position_mm, base_angle_deg)
    ROBOTS.check("--samples", samples)
    SEED.check("--seed", seed)
    planned = read_result(result)
    if planned.path is None:
        raise FormatError(result, f"holds no path to assess (status {planned.status.value!r})", "path")
    states = len(planned.path)
    tell_cost("--samples", 6 * samples * states * REFERENCE_S, samples * states * SHAPE_BYTES)
    if out is not None:
        check_folder(out)
    with CountBar("drawing robots", shown=progress) as bar:
        found = assess_robustness(planned, tolerances, samples=samples, seed=seed, progress=bar.update)
    if out is not None:
        write_robustness_data(planned, found, out)
    print(describe(found), flush=True)
    if out is not None:
        drawn = draw_after("robustness.json", lambda: draw_robustness(found, out))
        print(f"files: {' '.join([f'{out}/robustness.json', *drawn])}")
    return 0


def describe(found: Robustness) -> str:
    """Returns an assessment as a table for a terminal."""
    import numpy as np

    from tdcr_planner.report.robustness_results import TOLERANCE_NAMES

    lines = [f"verified for         {found.verified_rate}", f"touches nothing for  {found.collision_free_rate}"]
    for cause, count in sorted(found.causes.items(), key=lambda item: -item[1]):
        lines.append(f"  not verified because of {cause}: {count}")
    lines.append(f"{'least clearance, mm':<24}{'median':>10}{'5 %':>10}{'tip shift, 95 %':>18}")
    lines.append(f"  {'robot as in the file':<22}{1e3 * found.nominal.min():>10.2f}{'':>10}{'':>18}")
    named = {TOLERANCE_NAMES[name]: spread for name, spread in found.effects.items()}
    for name, spread in {"all together": found.spread, **named}.items():
        low, middle = (1e3 * np.quantile(spread.least_clearance, level, method="lower") for level in (0.05, 0.5))
        shift = 1e3 * np.quantile(spread.largest_tip_shift, 0.95, method="higher")
        lines.append(f"  {name:<22}{middle:>10.2f}{low:>10.2f}{shift:>18.2f}")
    return "\n".join(lines)
