"""Stated risk: whether paths asked to hold for a share of robots do, on robots that took no part, and what it costs.

    python benchmarks/risk.py [SCENARIO ...] [--robots 1000] [--probability 0.95] [--time-limit-s 120]

Each scenario is planned plainly (median processor time of several seeds), then with the success probability, and the
path is verified on fresh robots within the scenario's tolerances, or the defaults of `tdcr robustness`. Times are
processor times of this process, so that ratios hold on a machine under load.
"""

from __future__ import annotations

import argparse
import platform
import time
from pathlib import Path
from statistics import median

from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.query.drawn_robot import draw_robot
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.result import PlanResult
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.query.tolerances import tolerances_of
from tdcr_planner.rates import Rate, binomial_rate

SCENES = Path(__file__).resolve().parents[1] / "scenes"
SCENARIOS = (
    "airway/scenario_cross.toml",
    "airway/scenario_right_main.toml",
    "airway/scenario_roll.toml",
    "airway/scenario_tour.toml",
    "airway/scenario_trachea.toml",
    "blades/scenario_passage.toml",
    "blades/scenario_port.toml",
    "blades/scenario_vane.toml",
    "duct/scenario_elbow.toml",
    "duct/scenario_mouth.toml",
)
PLAIN_SEEDS = 5
FRESH_SEED = 2**31  # of robots that no query draws: queries count from their own seed, which is below


def share(session: PlanningSession, result: PlanResult, robots: int) -> Rate:
    """Returns for how many fresh robots a path is verified."""
    assert result.path is not None  # it is verified
    query = result.scenario
    rows, tolerances = path_rows(session.space, result.path), tolerances_of(query)
    goals = [(state, query.goals[number]) for state, number in result.path.goal_states]
    verified = 0
    for number in range(robots):
        drawn = draw_robot(session, tolerances, (FRESH_SEED, number), query)
        verified += drawn.verifier(session, query, measure=False).verify(rows, goals)[0].verified
    return binomial_rate(verified, robots)


def processor_time(session: PlanningSession, **changes: object) -> tuple[float, PlanResult]:
    """Returns the seconds that a query of the session's scenario takes, and its result."""
    begin = time.process_time()
    result = session.plan(session.scenario.with_planner(**changes))
    return time.process_time() - begin, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", type=Path)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--probability", type=float, default=0.95)
    parser.add_argument("--time-limit-s", type=float, default=120.0)
    options = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, asked {options.probability:g}, {options.robots} fresh robots")
    print(f"{'scenario':<34}{'plain, s':>9}{'risk, s':>9}{'ratio':>7}  {'said':<12}{'fresh robots':<36}in the way")
    ratios, kept, broken = [], 0, 0
    for path in options.scenarios or [SCENES / name for name in SCENARIOS]:
        session = PlanningSession(load_scenario(path).with_planner(time_limit_s=options.time_limit_s))
        plain = median(processor_time(session, seed=seed)[0] for seed in range(1, PLAIN_SEEDS + 1))
        spent, result = processor_time(session, success_probability=options.probability)
        name = f"{path.parent.name}/{path.stem}"
        ratios.append(spent / plain)
        if result.risk is None:
            print(f"{name:<34}{plain:>9.2f}{spent:>9.2f}{ratios[-1]:>7.1f}  {result.status.value}", flush=True)
            continue
        found = share(session, result, options.robots)
        reached = result.risk["reached"]
        kept += reached and found.value >= options.probability
        broken += reached and found.value < options.probability
        said, limiting = "reached" if reached else "not reached", result.risk["limiting_tolerance"] or ""
        print(f"{name:<34}{plain:>9.2f}{spent:>9.2f}{ratios[-1]:>7.1f}  {said:<12}{found!s:<36}{limiting}", flush=True)
    print(f"median ratio {median(ratios):.1f}; said to be reached: {kept} hold, {broken} do not")


if __name__ == "__main__":
    main()
