"""Reach measured: how many cells of the airway are judged in half a minute, and what the reference says of a sample.

    python benchmarks/reach.py               10,000 cells, 500 of the attained ones put to the reference anew

The map's own confirmation asks the reference about every attained cell; the sample here is solved again by itself, one
case at a time and with the statics alone, and its clearance is measured by python-fcl.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from pathlib import Path

import numpy as np

from tdcr_planner.inspection.reach import NAMES, Verdict, map_reach
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.query.solved_states import StateSolver

SCENARIO = Path(__file__).resolve().parents[1] / "scenes/airway/inspect_bronchi.toml"
WANTED_S = 30.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=10_000)
    parser.add_argument("--time", type=float, default=25.0, help="seconds of the search")
    parser.add_argument("--sample", type=int, default=500)
    parser.add_argument("--scenario", type=Path, default=SCENARIO)
    arguments = parser.parse_args()
    query = load_scenario(arguments.scenario)
    session = PlanningSession(query)
    begin, processor = time.monotonic(), time.process_time()
    found = map_reach(session, cells=arguments.cells, time_limit_s=arguments.time)
    spent, processor = time.monotonic() - begin, time.process_time() - processor
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}, one thread")
    print(
        f"{arguments.scenario.name}: {found.grid.cells:,} cells of {1e3 * found.grid.size:.1f} mm in {spent:.1f} s on "
        f"the clock (wanted {WANTED_S:g}), {processor:.1f} s of the processor, {found.states:,} states"
    )
    for verdict in Verdict:
        print(f"  {found.count(verdict):>8,}  {NAMES[verdict]}")
    attained = np.flatnonzero(found.verdicts <= Verdict.NO_PATH)
    generator = np.random.default_rng(1)
    sample = generator.choice(attained, min(arguments.sample, len(attained)), replace=False)
    solver = StateSolver(session.space, session.scene)
    wrong = 0
    for cell in sample.tolist():
        states = solver.solve(found.rows[cell][None])
        inside = int(found.grid.find(states.positions[:, -1])[0]) == cell
        kept = bool(
            states.converged[0]
            and states.stable[0]
            and states.in_limits(query.robot)[0]
            and not states.touches_itself[0]
            and states.clearance[0] >= query.planner.clearance_m
            and session.scene.first_contact(states.positions[0], states.rotations[0]) is None
        )
        wrong += not (inside and kept)
    print(f"sample of {len(sample)} attained cells by the reference: {wrong} are not")
    return 0 if wrong == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
