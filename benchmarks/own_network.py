"""Other people's networks: what is let through, what they plan, their margins by state, and engines against each other.

Prints tables. Ratios are of one run; times are of this process on one thread.

Run: python benchmarks/own_network.py [--parts safety honest margin engines plan] [--cases N] [--states N]
"""

from __future__ import annotations

import argparse
import platform
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from foreign_attacks import attacks
from foreign_networks import exported, honest_modules

from tdcr_planner.adoption.adopt import AdoptSettings, adopt
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.compare.verdicts import sample_configurations
from tdcr_planner.errors import FormatError
from tdcr_planner.learning.dataset import Sample, draw_cases, solve_cases
from tdcr_planner.learning.judge import body_errors
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.learning.state_margin import measure_coverage
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.robot import load_robot
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.shape.script_archive import check_script

ROOT = Path(__file__).resolve().parents[1]
PAPER = ROOT / "models/robots/paper.toml"
PUBLISHED, OWN = ROOT / "models/shape/paper/published.pt", ROOT / "models/shape/paper/model.pt"
ENGINE_SCENES = ("duct/scenario_elbow", "airway/scenario_trachea", "blades/scenario_passage")
BATCH = 1000
NEAR_M = 1e-6


def with_model(scenario: Scenario, file: Path, **planner: object) -> Scenario:
    """Returns a scenario with another model file and planner settings."""
    changed = scenario.file.model_copy(update={"shape_model": str(file)})
    return replace(scenario, file=changed).with_planner(**planner)


def unloaded_scenarios() -> Iterator[tuple[str, Scenario]]:
    """Yields the shipped scenarios of the robot `paper` that shall end with a verified path."""
    for path in sorted(ROOT.glob("scenes/*/scenario_*.toml")):
        scenario = load_scenario(path)
        expected = scenario.file.expected_status == "verified"
        if scenario.robot.name == "paper" and expected and not scenario.tip_force.any():
            yield f"{path.parent.name}/{path.stem.removeprefix('scenario_')}", scenario


def run_safety() -> None:
    """Tries to load each archive that does more than to compute."""
    found = attacks()
    loaded = []
    begin = time.process_time()
    for name, content in found.items():
        try:
            check_script(Path(name), content)
            loaded.append(name)
        except FormatError:
            continue
    spent = 1e3 * (time.process_time() - begin) / len(found)
    print(f"attacks: {len(found)} archives, {len(loaded)} loaded {loaded[:5]}, {spent:.2f} ms each")


def run_honest() -> None:
    """Adopts each honest kind of network and plans with it."""
    robot = load_robot(PAPER)
    scenario = next(scenario for name, scenario in unloaded_scenarios() if name == "duct/narrowing")
    settings = AdoptSettings(domain=DomainSettings(gravity_m_s2=0.0, tip_force_n=0.0), alpha=0.1, cases=120, judged=60)
    verified = 0
    with tempfile.TemporaryDirectory() as folder:
        kinds: dict[str, Callable[[Path], Path]] = {
            name: lambda path, make=make: (path.write_bytes(make()), path)[1]  # type: ignore[misc]
            for name, make in honest_modules(robot).items()
        }
        kinds["plain, to ONNX"] = lambda path: exported("plain", robot, path.with_suffix(".onnx"))
        kinds["neural ode, to ONNX"] = lambda path: exported("neural ode", robot, path.with_suffix(".onnx"))
        for name, write in kinds.items():
            module = write(Path(folder) / "mine.pt")
            model = Path(folder) / "model.pt"
            adopt(module, robot, model, settings)
            result = PlanningSession(with_model(scenario, model)).plan()
            verified += result.status.value == "verified"
            worst = result.verification.worst["deviation_m"] if result.verification else np.nan
            print(f"  {name:<32} {result.status.value:<12} off by {1e6 * worst:.3g} um at most")
    print(f"honest kinds: {verified} of {len(kinds)} load and plan")


def run_margin(cases: int) -> None:
    """Measures the published network's margin by state on unseen cases."""
    model = load_shape_model(PUBLISHED)
    uniform = load_shape_model(PUBLISHED, bound="uniform")
    robot = model.robot
    kinds: tuple[Sample, ...] = ("planner", "uniform")
    for index, sample in enumerate(kinds):
        drawn = draw_cases(robot, model.card.domain, sample, cases, np.random.default_rng([77, index]))
        solved = solve_cases(robot, drawn)
        poses, bounds = model.poses_and_bounds(solved.cases.tensions, solved.cases.gravity, solved.cases.tip_force)
        errors = body_errors(robot, poses.positions, poses.rotations, solved)
        own = measure_coverage(errors[poses.solved], bounds[poses.solved])
        whole = measure_coverage(errors, uniform.error_bound)
        ratio = whole.median_tip_m / own.median_tip_m
        print(
            f"margin, {sample}: {own.cases:,} unseen cases, {len(errors) - own.cases} without shape; by state "
            f"{1e3 * own.median_tip_m:.3g} mm, uniform {1e3 * whole.median_tip_m:.3g} mm, {ratio:.2f} times; "
            f"covered {own.overall:.5f} (uniform {whole.overall:.5f}), tenths {min(own.deciles):.5f} to "
            f"{max(own.deciles):.5f}"
        )


def run_engines(states: int) -> None:
    """Compares the verdicts of both engines of this project's models on random states."""
    each = -(-states // len(ENGINE_SCENES))
    wrong = near = total = 0
    for name in ENGINE_SCENES:
        scenario = load_scenario(ROOT / f"scenes/{name}.toml")
        session = PlanningSession(scenario)
        rows, _ = sample_configurations(session.space, each, 5)
        spent, codes = {}, {}
        for engine in ("compiled", "torchscript"):
            checker = session.checker(scenario.with_planner(shape_engine=engine))
            checker.check(rows[:BATCH])
            begin = time.process_time()
            codes[engine] = np.concatenate([checker.check(rows[at : at + BATCH]) for at in range(0, each, BATCH)])
            spent[engine] = time.process_time() - begin
        differing = np.flatnonzero((codes["compiled"] == 0) != (codes["torchscript"] == 0))
        far = sum(not _near_limit(session, row) for row in rows[differing])
        total, near, wrong = total + each, near + len(differing) - far, wrong + far
        rates = {engine: each / seconds for engine, seconds in spent.items()}
        print(
            f"  {name:<28} {each:,} states, valid {np.mean(codes['compiled'] == 0):.1%}: "
            + ", ".join(f"{engine} {rate:,.0f} states/s" for engine, rate in rates.items())
            + f", {rates['compiled'] / rates['torchscript']:.1f} times"
        )
    print(f"engines: {total:,} states, {wrong} verdicts differ, {near} more within {NEAR_M:g} m of the limit")


def _near_limit(session: PlanningSession, row: np.ndarray) -> bool:
    """Returns whether margins changed by 1e-6 m change the verdict on a state."""
    checker = session.checker()
    scene = checker.scene
    assert isinstance(scene, CollisionScene)
    positions, rotations, _ = checker.world_poses(row[None])
    verdicts = {
        int(scene.with_margins(np.maximum(scene.body.margins + change, 0.0)).check(positions, rotations)[0]) != 0
        for change in (-NEAR_M, NEAR_M)
    }
    return len(verdicts) == 2


def run_plan() -> None:
    """Plans the unloaded shipped scenarios with the published network and with this project's, by one engine."""
    for name, scenario in unloaded_scenarios():
        times, told = {}, {}
        for file in (PUBLISHED, OWN):
            session = PlanningSession(with_model(scenario, file, shape_engine="torchscript"))
            begin = time.process_time()
            result = session.plan()
            times[file] = time.process_time() - begin
            told[file] = result.status.value
        uniform = PlanningSession(
            with_model(scenario, PUBLISHED, shape_engine="torchscript", error_bound="uniform")
        ).plan()
        print(
            f"  {name:<24} published {told[PUBLISHED]} ({times[PUBLISHED]:.2f} s), with the uniform bound "
            f"{uniform.status.value}; model.pt {told[OWN]} ({times[OWN]:.2f} s): "
            f"{times[PUBLISHED] / times[OWN]:.2f} times the time"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=re.sub(r"\n\nRun:.*", "", __doc__ or "", flags=re.DOTALL))
    parts = ("safety", "honest", "margin", "engines", "plan")
    parser.add_argument("--parts", nargs="+", choices=parts, default=parts)
    parser.add_argument("--cases", type=int, default=100_000, help="unseen cases of each sample for the margin")
    parser.add_argument("--states", type=int, default=1_000_000, help="states for the engines")
    options = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    runs: dict[str, Callable[[], None]] = {
        "safety": run_safety,
        "honest": run_honest,
        "margin": lambda: run_margin(options.cases),
        "engines": lambda: run_engines(options.states),
        "plan": run_plan,
    }
    for part in options.parts:
        print(f"{part}:", flush=True)
        runs[part]()


if __name__ == "__main__":
    main()
