"""What the project claims about its evidence: false-valid rates, comparison times, how sweeps scale, and the benchmark.

Run with --quick for a short version; without it 100,000 states and about 700 queries are judged. The parts `suite`,
`curvature` and `planners` print the tables of docs/benchmark.md as Markdown. With --out their sweeps are kept and an
interrupted one goes on where it was.
"""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import platform
import tempfile
import time
import tomllib
from pathlib import Path

from tdcr_planner.compare.comparison import compare
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.rates import ratio_at_least
from tdcr_planner.report.compare_results import write_comparison
from tdcr_planner.report.sweep_results import write_sweep
from tdcr_planner.report.tables import Row, format_markdown
from tdcr_planner.sweep.runner import run_sweep
from tdcr_planner.sweep.suite import load_suite
from tdcr_planner.sweep.table import group_rows, joined_rows
from tdcr_planner.workers import local_backend

SCENES = Path(__file__).resolve().parents[1] / "scenes"
SCENE = SCENES / "duct/scenario_sag.toml"
SWEPT = ("duct/scenario_mouth.toml", "duct/scenario_sag.toml")


def main() -> None:
    """Runs the parts and prints their tables."""
    parts = {
        "rates": false_valid_rates,
        "time": comparison_time,
        "sweep": sweep_scaling,
        "suite": benchmark_suite,
        "curvature": constant_curvature,
        "planners": all_planners,
    }
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="2,000 states, 16 queries, and 1 seed of each suite")
    parser.add_argument("--only", choices=parts, action="append", help="one part; may be given again for another")
    parser.add_argument("--jobs", type=int, default=1, help="worker processes of the suites")
    parser.add_argument("--out", type=Path, help="folder that keeps the sweeps of the suites")
    arguments = parser.parse_args()
    print(
        f"machine: {platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start", flush=True
    )
    with tempfile.TemporaryDirectory() as folder:
        arguments.out = arguments.out or Path(folder)
        for name, part in parts.items():
            if arguments.only is None or name in arguments.only:
                part(arguments)


def false_valid_rates(arguments: argparse.Namespace) -> None:
    """Prints how often each model calls a state valid that the reference does not."""
    found = compare(load_scenario(SCENE), samples=2_000 if arguments.quick else 100_000, paths=0, jobs=2)
    rates = {variant.name: found.confusion(variant).rates for variant in found.verdicts.variants}
    print(f"\nverdicts in {SCENE.name}, {len(found.verdicts.rows):,} states")
    for name, rate in rates.items():
        print(f"  {name:30} false valid {rate['false_valid']!s:40} false invalid {rate['false_invalid']}")
    bound = ratio_at_least(rates["constant_curvature"]["false_valid"], rates["learned"]["false_valid"])
    print(f"  constant curvature is falsely valid at least {bound:.3g} times as often (claimed: 10)")
    print(f"  learned: upper end {100 * rates['learned']['false_valid'].high:.4f} % (claimed: below 0.1 %)")


def comparison_time(arguments: argparse.Namespace) -> None:
    """Prints how long a comparison of states takes, files included, and what a verdict costs."""
    begin = time.perf_counter()
    samples = 2_000 if arguments.quick else 10_000
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


def sweep_scaling(arguments: argparse.Namespace) -> None:
    """Prints how long the same sweep takes with one worker and with two, and whether the tables are the same."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "suite.toml"
        scenarios = ", ".join(f'{{file = "{SCENES / name}", difficulty = "easy"}}' for name in SWEPT)
        path.write_text(
            f'format = "tdcr-suite/1"\nscenarios = [{scenarios}]\nplanners = ["RRTConnect"]\nmodels = ["learned"]\n'
            f"seeds = {list(range(1, 9 if arguments.quick else 101))}\n"
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


def benchmark_suite(arguments: argparse.Namespace) -> None:
    """Prints the benchmark by difficulty and by scenario: the learned model, all seeds of the suite."""
    rows = swept("benchmark", arguments, "suite")
    everything = [{**row, "difficulty": "all"} for row in rows]
    print_table([*group_rows(rows, ("model", "difficulty")), *group_rows(everything, ("model", "difficulty"))])
    print_table(group_rows(rows, ("scenario",)), brief=True)
    verified = [row for row in rows if row["status"] == "verified"]
    repaired = sum(row["repairs"] > 0 for row in verified)
    deviation = max(row["deviation_m"] for row in verified)
    print(
        f"{repaired} of {len(verified)} verified paths were repaired; largest deviation {1e3 * deviation:.2g} mm",
        flush=True,
    )


def constant_curvature(arguments: argparse.Namespace) -> None:
    """Prints the benchmark with constant curvature as the model that the search asks, one seed, and how queries end."""
    changes = {"models": '["constant_curvature"]', "seeds": "[1]", "time_limit_s": "20.0"}
    rows = swept("benchmark", arguments, "curvature", changes)
    everything = [{**row, "difficulty": "all"} for row in rows]
    print_table([*group_rows(rows, ("model", "difficulty")), *group_rows(everything, ("model", "difficulty"))])
    by_status: dict[str, list[Row]] = {}
    for row in rows:
        by_status.setdefault(row["status"], []).append(row)
    for status, members in by_status.items():
        depths = [-1e3 * row["last_clearance_m"] for row in members if (row["last_clearance_m"] or 0.0) < 0.0]
        through = f"; through a wall by {min(depths):.1f} to {max(depths):.1f} mm" if depths else ""
        names = ", ".join(sorted(shown(row["scenario"]) for row in members))
        print(f"{status}: {len(members)} ({names}){through}")


def all_planners(arguments: argparse.Namespace) -> None:
    """Prints what the planners on offer make of the same scenarios."""
    print_table(group_rows(swept("planners", arguments, "planners"), ("planner",)))


def swept(suite: str, arguments: argparse.Namespace, name: str, changes: dict[str, str] | None = None) -> list[Row]:
    """Returns the joined rows of a suite of scenes/, run now or in an earlier call with the same --out.

    Args:
        suite: The suite file's name without its ending.
        arguments: The command line.
        name: Folder of the sweep.
        changes: Keys of the suite with other values, as TOML.
    """
    changes = {**(changes or {}), **({"seeds": "[1]"} if arguments.quick else {})}
    table = tomllib.loads((SCENES / f"{suite}.toml").read_text(encoding="utf-8"))
    scenarios = ", ".join(
        f"{{file = {json.dumps(str(SCENES / item['file']))}, difficulty = {json.dumps(item['difficulty'])}}}"
        for item in table.pop("scenarios")
    )
    lines = {**{key: json.dumps(value) for key, value in table.items()}, **changes, "scenarios": f"[{scenarios}]"}
    folder = arguments.out / name
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "suite.toml"
    path.write_text("".join(f"{key} = {value}\n" for key, value in lines.items()), encoding="utf-8")
    begin = time.perf_counter()
    outcome = run_sweep(load_suite(path), folder, local_backend(arguments.jobs))
    write_sweep(outcome, folder)
    print(
        f"\n{suite}.toml, {len(outcome.records)} of {len(outcome.suite.jobs)} queries"
        f" ({outcome.resumed} of an earlier run, {len(outcome.failed)} failed): {time.perf_counter() - begin:.0f} s\n"
    )
    return joined_rows(outcome)


def print_table(groups: list[Row], *, brief: bool = False) -> None:
    """Prints groups of rows as a Markdown table; times and lengths are medians over the verified paths."""
    keys = [key for key in ("model", "difficulty", "planner", "scenario") if key in groups[0]]
    rated = ["verified"] if brief else ["queries", "verified", "interval", "repairs"]
    measured = ["search s", "p90", "search and verification s", "tip travel mm", "least clearance mm"]
    body = []
    for group in groups:
        rate, spread = group["verified"], group["quantiles"]
        cells = {
            "queries": str(group["jobs"]),
            "verified": f"{rate['count']} of {rate['total']}" if brief else str(rate["count"]),
            "interval": f"{100 * rate['low']:.0f} to {100 * rate['high']:.0f} %",
            "repairs": str(group["repairs"]),
            "search s": number(spread["plan_s"]["median"], "{:.2f}"),
            "p90": number(spread["plan_s"]["p90"], "{:.2f}"),
            "search and verification s": number(spread["total_s"]["median"], "{:.2f}"),
            "tip travel mm": number(spread["tip_travel_m"]["median"], "{:.0f}", 1e3),
            "least clearance mm": number(spread["clearance_m"]["median"], "{:.1f}", 1e3),
        }
        body.append([*(shown(group[key]) for key in keys), *(cells[name] for name in (*rated, *measured))])
    print(format_markdown([*keys, *rated, *measured], body), flush=True)


def shown(name: str) -> str:
    """Returns a key of a table for people: scenarios without the path to scenes/, models without underscores."""
    scenario = name.removeprefix(f"{SCENES}/").removesuffix(".toml").replace("/scenario_", "/")
    return scenario.replace("constant_curvature", "constant curvature")


def number(value: float | None, form: str, factor: float = 1.0) -> str:
    """Returns a number in a form, and nothing where there is none."""
    return "" if value is None else form.format(factor * value)


if __name__ == "__main__":
    main()
