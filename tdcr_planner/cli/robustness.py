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
    youngs_modulus: float | None = None,
    tension: float | None = None,
    mass: float | None = None,
    base_position_mm: float | None = None,
    base_angle_deg: float | None = None,
    tension_offset_n: float | None = None,
    displacement: float | None = None,
    displacement_offset_mm: float | None = None,
    friction: float | None = None,
    length: float | None = None,
    tendon_circle: float | None = None,
    tendon_angle_deg: float | None = None,
    mesh_position_mm: float | None = None,
    mesh_angle_deg: float | None = None,
    mesh_scale: float | None = None,
    progress: bool = True,
) -> int:
    """Send a result's path through robots drawn within tolerances and count for how many the reference verifies it.

    Example: tdcr robustness out/elbow/result.json --youngs-modulus 0.1 --out out/elbow_robustness

    Every tolerance is a standard deviation: of what differs from robot to robot and stays the same along a path. 0
    leaves it as the files say. What no option states is as the scenario's [tolerances] have it; without such a table
    5 % of the modulus, 2 % of tension and mass, 0.5 mm and 0.2 degrees of the base, and nothing else.

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
        tension_offset_n: Of each tendon's real tension where none is commanded, N.
        displacement: Of each tendon's gain from commanded to real displacement, relative; displacement drive.
        displacement_offset_mm: Of each tendon's real displacement where none is commanded, mm; displacement drive.
        friction: Of the friction coefficients, one factor for all, relative.
        length: Of each segment's length, relative.
        tendon_circle: Of the radius of each segment's tendon circle, relative.
        tendon_angle_deg: Of each tendon's angle on its circle, degrees.
        mesh_position_mm: Of the place of all surfaces together, each axis, mm.
        mesh_angle_deg: Of the orientation of all surfaces together, about each axis, degrees.
        mesh_scale: Of the size of all surfaces together, relative.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from dataclasses import replace

    from tdcr_planner.bounds import ROBOTS, SEED
    from tdcr_planner.cli.cost import REFERENCE_S, SHAPE_BYTES, tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CountBar
    from tdcr_planner.errors import FormatError
    from tdcr_planner.files import check_folder
    from tdcr_planner.query.tolerances import Tolerances, tolerances_of
    from tdcr_planner.report.results import read_result
    from tdcr_planner.report.robustness_results import draw_robustness, write_robustness_data
    from tdcr_planner.robustness import assess_robustness

    given = {
        "youngs_modulus": youngs_modulus,
        "tension": tension,
        "mass": mass,
        "base_position_m": _in_m(base_position_mm),
        "base_angle_deg": base_angle_deg,
        "tension_offset_n": tension_offset_n,
        "displacement": displacement,
        "displacement_offset_m": _in_m(displacement_offset_mm),
        "friction": friction,
        "length": length,
        "tendon_circle": tendon_circle,
        "tendon_angle_deg": tendon_angle_deg,
        "mesh_position_m": _in_m(mesh_position_mm),
        "mesh_angle_deg": mesh_angle_deg,
        "mesh_scale": mesh_scale,
    }
    stated = {name: value for name, value in given.items() if value is not None}
    Tolerances(**stated)
    ROBOTS.check("--samples", samples)
    SEED.check("--seed", seed)
    planned = read_result(result)
    if planned.path is None:
        raise FormatError(result, f"holds no path to assess (status {planned.status.value!r})", "path")
    tolerances = replace(tolerances_of(planned.scenario), **stated).check_fit(planned.scenario.robot)
    states = len(planned.path)
    tell_cost(
        "--samples", (1 + len(tolerances.varied())) * samples * states * REFERENCE_S, samples * states * SHAPE_BYTES
    )
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


def _in_m(value_mm: float | None) -> float | None:
    return None if value_mm is None else 1e-3 * value_mm


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
