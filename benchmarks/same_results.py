"""Compares the results of two checkouts: statics, learned shapes, and the paths of every shipped scenario.

    python benchmarks/same_results.py OTHER [--only statics shapes paths] [--scenarios NAME ...]

OTHER is another checkout of this project. Each part runs in a process of its own in either checkout and writes its
numbers, which are compared: statics and learned shapes to 1e-12 m, and for every scenario under scenes/, seed 1, the
status, the bending, the tensions, the tip and the verdict to 1e-9. The exit code is 1 where something differs.

Planners that improve a path until the time is over, and queries that the time limit ends, depend on the machine; their
rows say so by the number of states that were checked.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
POSITION_M, PATH = 1e-12, 1e-9
STATES = 200
TIME_LIMIT_S = 120.0

# What runs in a checkout: only calls that every version offers.
STATICS = """
import sys, numpy as np
from pathlib import Path
from tdcr_planner import load_robot, solve_statics
found = {}
for file in sorted(Path("models/robots").glob("*.toml")):
    robot = load_robot(file)
    tensions = np.random.default_rng(1).uniform(0.0, 1.0, (STATES, robot.tendon_count)) * robot.max_tensions
    solution = solve_statics(robot, tensions, gravity=[0.0, 0.5, -9.81])
    found[f"{file.stem} positions"] = np.where(solution.converged[:, None, None], solution.positions, 0.0)
    found[f"{file.stem} converged"] = solution.converged.astype(float)
np.savez(sys.argv[1], **found)
"""
SHAPES = """
import sys, numpy as np
from pathlib import Path
from tdcr_planner import load_shape_model
found = {}
for file in sorted(Path("models/shape").glob("*/*.pt")):
    model = load_shape_model(file)
    most = np.asarray(model.card.domain.max_tension_n)
    tensions = np.random.default_rng(1).uniform(0.0, 1.0, (STATES, len(most))) * most
    gravity = [0.0, 0.0, -min(9.81, model.card.domain.gravity_m_s2)]
    poses = model.disk_poses(tensions, gravity=gravity)
    name = f"{file.parent.name}/{file.stem}"
    found[f"{name} positions"], found[f"{name} rotations"] = poses.positions, poses.rotations
np.savez(sys.argv[1], **found)
"""
PLAN = """
import sys, json, numpy as np
from tdcr_planner import load_scenario, plan
scenario = load_scenario(sys.argv[2]).with_planner(time_limit_s=TIME_LIMIT_S)
result = plan(scenario, seed=1)
path, report = result.path, result.verification
found = {"status": result.status.value, "verified": None if report is None else report.verified}
found["states_checked"] = result.planner.get("states_checked")
found["message"] = result.message
if path is not None:
    for name in ("bending", "insertion", "roll", "tensions", "tip_positions"):
        found[name] = getattr(path, name).tolist()
    found["clearance"] = report.clearance.tolist()
json.dump(found, open(sys.argv[1], "w"))
"""


def run_in(checkout: Path, program: str, *arguments: str) -> None:
    """Runs a program in a checkout; its standard output goes nowhere."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    text = program.replace("TIME_LIMIT_S", repr(TIME_LIMIT_S), 1).replace("STATES", str(STATES))
    subprocess.run([sys.executable, "-c", text, *arguments], cwd=checkout, env=environment, check=True)


def largest_difference(mine: object, other: object) -> float:
    """Returns the largest difference between two arrays; infinite where their shapes differ or one alone is NaN."""
    a, b = np.asarray(mine, dtype=np.float64), np.asarray(other, dtype=np.float64)
    if a.shape != b.shape or not np.array_equal(np.isnan(a), np.isnan(b)):
        return float("inf")
    return float(np.nanmax(np.abs(a - b), initial=0.0))


def compare_arrays(other: Path, program: str, folder: Path) -> bool:
    """Prints a row an array of two checkouts and returns whether all agree."""
    files = [folder / "mine.npz", folder / "other.npz"]
    for checkout, file in zip((ROOT, other), files, strict=True):
        run_in(checkout, program, str(file))
    agree = True
    with np.load(files[0]) as mine, np.load(files[1]) as theirs:
        for name in sorted({*mine.files, *theirs.files}):
            if name not in mine.files or name not in theirs.files:
                print(f"{name:44} only in {'this checkout' if name in mine.files else 'the other'}")
                continue
            difference = largest_difference(mine[name], theirs[name])
            agree &= difference <= POSITION_M
            print(f"{name:44} {difference:9.2g}  {'equal' if difference <= POSITION_M else 'DIFFERENT'}")
    return agree


def compare_paths(other: Path, folder: Path, names: list[str]) -> bool:
    """Prints a row a scenario of two checkouts and returns whether all agree."""
    agree = True
    for scenario in sorted((ROOT / "scenes").glob("*/scenario_*.toml")):
        name = str(scenario.relative_to(ROOT))
        if names and not any(part in name for part in names):
            continue
        found = []
        for checkout in (ROOT, other):
            file = folder / "plan.json"
            run_in(checkout, PLAN, str(file), str(checkout / name))
            found.append(json.loads(file.read_text()))
        mine, theirs = found
        same = all(mine[key] == theirs[key] for key in ("status", "verified"))
        keys = sorted({*mine, *theirs} - {"status", "verified", "states_checked", "message"})
        difference = max((largest_difference(mine.get(key), theirs.get(key)) for key in keys), default=0.0)
        equal = same and difference <= PATH
        agree &= equal
        counts = f"{mine['states_checked']} and {theirs['states_checked']} states checked"
        verdict = "equal" if equal else f"DIFFERENT ({mine['status']}, {theirs['status']})"
        print(f"{name:44} {mine['status']:14} {difference:9.2g}  {verdict}; {counts}", flush=True)
    return agree


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path)
    parser.add_argument(
        "--only", nargs="+", choices=("statics", "shapes", "paths"), default=("statics", "shapes", "paths")
    )
    parser.add_argument("--scenarios", nargs="+", default=[], help="parts of scenarios' names; all without it")
    options = parser.parse_args()
    other, agree = options.other.resolve(), True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print("largest difference (m; path: N, m, rad)")
        if "statics" in options.only:
            agree &= compare_arrays(other, STATICS, folder)
        if "shapes" in options.only:
            agree &= compare_arrays(other, SHAPES, folder)
        if "paths" in options.only:
            agree &= compare_paths(other, folder, options.scenarios)
    print("all equal" if agree else "NOT all equal")
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
