"""tdcr verify: a result's path, solved again with the reference."""

from __future__ import annotations

from pathlib import Path

import tyro


def verify(result: tyro.conf.Positional[Path], *, refine: int = 1) -> int:
    """Solve every state of a result's path again with the Cosserat reference and judge it in its scene.

    Example: tdcr verify out/elbow/result.json --refine 10

    Exit code 0 when the path is verified, 1 when it is not.

    Args:
        result: The result.json that `tdcr plan` wrote.
        refine: Verify at steps this many times finer than the scenario's step_m.
    """
    from tdcr_planner.bounds import REFINEMENT
    from tdcr_planner.cli.cost import REFERENCE_S, SHAPE_BYTES, tell_cost
    from tdcr_planner.errors import FormatError
    from tdcr_planner.query.session import verify as verify_result
    from tdcr_planner.report.results import read_result

    REFINEMENT.check("--refine", refine)
    found = read_result(result)
    if found.path is None:
        raise FormatError(result, f"holds no path to verify (status {found.status.value!r})", "path")
    states = len(found.path) * refine
    tell_cost("--refine", states * REFERENCE_S, states * found.scenario.robot.disk_count * SHAPE_BYTES)
    report = verify_result(found, refine=refine)
    worst = report.worst
    print(f"{'verified' if report.verified else 'not verified'}: {report.states} states solved")
    if report.message:
        print(f"  {report.message}")
    print(f"  least clearance    {1e3 * worst['clearance_m']:.3f} mm")
    print(f"  largest deviation  {1e3 * worst['deviation_m']:.3f} mm")
    print(f"  largest residual   {worst['residual_nm']:.1e} N m")
    return 0 if report.verified else 1
