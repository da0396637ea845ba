"""What the project claims about its evidence: false-valid rates, the time of a comparison, and how sweeps scale.

Run with --quick for a short version; without it 100,000 states and 200 queries are judged.
"""

from __future__ import annotations

import argparse
import filecmp
import os
import platform
import tempfile
import time
from pathlib import Path

from tdcr_planner.compare.comparison import compare
from tdcr_planner.compare.verdicts import VARIANTS
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.rates import ratio_at_least
from tdcr_planner.report.compare_results import write_comparison
from tdcr_planner.report.sweep_results import write_sweep
from tdcr_planner.sweep.runner import run_sweep
from tdcr_planner.sweep.suite import load_suite
from tdcr_planner.workers import local_backend

SCENES = Path(__file__).resolve().parents[1] / "scenes"
SCENE = SCENES / "duct/scenario_sag.toml"
SWEPT = ("duct/scenario_mouth.toml", "duct/scenario_sag.toml")


def main() -> None:
    """Runs the three parts and prints their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="2,000 states and 16 queries")
    parser.add_argument("--only", choices=("rates", "time", "sweep"), help="one part alone")
    arguments = parser.parse_args()
    print(f"machine: {platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start")
    parts = {"rates": false_valid_rates, "time": comparison_time, "sweep": sweep_scaling}
    for name, part in parts.items():
        if arguments.only in (None, name):
            part(arguments.quick)


def false_valid_rates(quick: bool) -> None:
    """Prints how often each model calls a state valid that the reference does not."""
    found = compare(load_scenario(SCENE), samples=2_000 if quick else 100_000, paths=0, jobs=2)
    rates = {variant.name: found.confusion(variant).rates for variant in VARIANTS}
    print(f"\nverdicts in {SCENE.name}, {len(found.verdicts.rows):,} states")
    for name, rate in rates.items():
        print(f"  {name:30} false valid {rate['false_valid']!s:40} false invalid {rate['false_invalid']}")
    bound = ratio_at_least(rates["constant_curvature"]["false_valid"], rates["learned"]["false_valid"])
    print(f"  constant curvature is falsely valid at least {bound:.3g} times as often (claimed: 10)")
    print(f"  learned: upper end {100 * rates['learned']['false_valid'].high:.4f} % (claimed: below 0.1 %)")


def comparison_time(quick: bool) -> None:
    """Prints how long a comparison of states takes, files included, and what a verdict costs."""
    begin = time.perf_counter()
    samples = 2_000 if quick else 10_000
    found = compare(load_scenario(SCENE), samples=samples, paths=0, jobs=2)
    with tempfile.TemporaryDirectory() as folder:
        write_comparison(found, folder)
    print(f"\n{samples:,} states, two processes: {time.perf_counter() - begin:.1f} s (claimed: 10,000 in 60 s)")
    slowest = max(item.check_us for item in found.times)
    for item in found.times:
        print(
            f"  {item.model:20} {item.check_us:8.1f} us a verdict, {item.shape_us:8.1f} of it the shape,"
            f" {slowest / item.check_us:5.1f} times as fast as the slowest"
        )


def sweep_scaling(quick: bool) -> None:
    """Prints how long the same sweep takes with one worker and with two, and whether the tables are the same."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "suite.toml"
        scenarios = ", ".join(f'{{file = "{SCENES / name}", difficulty = "easy"}}' for name in SWEPT)
        path.write_text(
            f'format = "tdcr-suite/1"\nscenarios = [{scenarios}]\nplanners = ["RRTConnect"]\nmodels = ["learned"]\n'
            f"seeds = {list(range(1, 9 if quick else 101))}\n"
        )
        suite = load_suite(path)
        seconds = {}
        for workers in (1, 2):
            begin = time.perf_counter()
            outcome = run_sweep(suite, Path(folder) / f"{workers}", local_backend(workers))
            seconds[workers] = time.perf_counter() - begin
            write_sweep(outcome, Path(folder) / f"{workers}")
        same = filecmp.cmp(Path(folder) / "1/results.csv", Path(folder) / "2/results.csv", shallow=False)
    print(f"\nsweep of {len(suite.jobs)} queries: {seconds[1]:.1f} s with one worker, {seconds[2]:.1f} s with two")
    print(f"  ratio {seconds[2] / seconds[1]:.2f} (claimed: 0.6); tables {'the same' if same else 'DIFFER'}")


if __name__ == "__main__":
    main()
