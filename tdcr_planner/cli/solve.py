"""tdcr solve: one shape from the Cosserat reference."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from tdcr_planner.cli.vectors import parse_vector
from tdcr_planner.errors import InputError

if TYPE_CHECKING:
    from tdcr_planner.statics.solver import RodSolution


def solve(
    robot: tyro.conf.Positional[Path],
    *,
    bending_n: str,
    gravity: str = "0,0,0",
    tip_force: str = "0,0,0",
    out: Path | None = None,
) -> int:
    """Solve one shape with the Cosserat reference and print or write its disk poses.

    Example: tdcr solve models/robots/inspection.toml --bending-n 1.5,0
    --gravity 0,0,-9.81

    Exit code 1 when the reference finds no shape.

    Args:
        robot: Robot file.
        bending_n: Bending vector in N, X,Y for each segment, base to tip, separated by commas.
        gravity: Gravity x,y,z in m/s^2, base frame.
        tip_force: Force x,y,z in N on the last disk, base frame.
        out: File to write, .json or .npz; without it printed as JSON, with a summary on standard error.
    """
    import numpy as np

    from tdcr_planner.files import check_file_target, write_file_whole
    from tdcr_planner.limits import at_most
    from tdcr_planner.robot import load_robot
    from tdcr_planner.statics.solver import solve_statics

    if out is not None and out.suffix not in {".json", ".npz"}:
        raise InputError("--out", "a file ending in .json or .npz", str(out))
    if out is not None:
        check_file_target(out)
    spec = load_robot(robot)
    bending = parse_vector("--bending-n", bending_n, 2 * spec.segment_count).reshape(1, -1, 2)
    tensions = spec.tensions_from_bending(bending)
    if not at_most(tensions, spec.max_tensions).all():
        tendon = int(np.argmax(tensions[0] - spec.max_tensions))
        raise InputError(
            "--bending-n",
            f"a bending vector whose tensions stay at or below {spec.max_tensions[tendon]:g} N",
            f"{bending_n!r}, which asks tendon {tendon + 1} for {tensions[0, tendon]:.4g} N",
        )
    solution = solve_statics(
        spec,
        tensions,
        gravity=parse_vector("--gravity", gravity, 3),
        tip_force=parse_vector("--tip-force", tip_force, 3),
    )
    arrays: dict[str, Any] = {
        "tensions_n": tensions[0],
        "arc_lengths_m": solution.arc_lengths,
        "positions_m": solution.positions[0],
        "rotations": solution.rotations[0],
        "residual_nm": solution.residual[0],
        "converged": solution.converged[0],
        "stable": solution.stable[0],
        "status": str(solution.status[0]),
    }
    content = {key: value if isinstance(value, str) else np.asarray(value).tolist() for key, value in arrays.items()}
    content = {"format": "tdcr-shape/1", "robot": spec.name, **content}
    if not solution.converged[0]:
        # JSON has no NaN: a case without a shape says so by leaving its poses out.
        content.update(positions_m=None, rotations=None)
    if out is None:
        print(json.dumps(content, indent=1))
        print(_summary(solution), file=sys.stderr)
    else:
        with write_file_whole(out) as temporary:
            if out.suffix == ".json":
                temporary.write_text(json.dumps(content), encoding="utf-8")
            else:
                np.savez(temporary, **arrays)
        print(f"{out}: {_summary(solution)}")
    return 0 if bool(solution.converged[0]) else 1


def _summary(solution: RodSolution) -> str:
    """Returns where the first case's tip is and how far its shape can be trusted, in one line."""
    import numpy as np

    residual = f"residual {solution.residual[0]:.1e} N m"
    if not solution.converged[0]:
        return f"no shape: {solution.status[0]}, {residual}"
    tip = "({:.2f}, {:.2f}, {:.2f})".format(*(np.round(1e3 * solution.positions[0, -1], 2) + 0.0))
    return f"tip {tip} mm, converged, {'stable' if solution.stable[0] else 'not stable'}, {residual}"
