"""Ends commands at random moments and looks at what they leave: files, processes, and what the next run makes of it.

Each of plan, train, sweep and roadmap is started in a small scene, ended by SIGKILL, SIGINT or SIGTERM at a moment
drawn from its usual time, and started again. Every file must be whole or absent, the second run must end with the files
of a run that nobody interrupted, and neither processes nor staging folders may be left. An interrupted command says so
in one line, without a traceback. Linux only: processes are found in /proc.

    python benchmarks/interrupts.py --moments 50 --seed 1
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from tdcr_planner.planning.roadmap import Roadmap
from tdcr_planner.shape.learned import load_shape_model

PROGRAM = [sys.executable, "-c", "from tdcr_planner.cli.main import main; main()"]
MARK = "TDCR_INTERRUPTS_RUN"
SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)
# A worker that notices its parent's end may still be importing, or inside of compiled code.
GONE_WITHIN_S = 20.0
ENDS_WITHIN_S = 60.0

ROBOT = """format = "tdcr-robot/1"
name = "small"
backbone = { youngs_modulus_pa = 60e9, poisson_ratio = 0.3, radius_m = 0.0005, density_kg_m3 = 8000.0 }
[[segments]]
length_m = 0.1
disks = 4
disk_radius_m = 0.01
disk_thickness_m = 0.002
disk_mass_kg = 0.0005
tendon_circle_radius_m = 0.008
tendon_angles_deg = [90.0, -30.0, 210.0]
max_tension_n = 3.5
"""
SCENARIO = """format = "tdcr-scenario/1"
robot = "robot.toml"
meshes = [{ file = "box.stl", unit = "mm", role = "obstacle" }]
start = { bending_n = [[0.0, 0.0]] }
goal = { bending_n = [[2.0, 1.0]] }
planner = { validity = "constant_curvature", time_limit_s = 60.0, step_m = 0.004 }
"""
SUITE = """format = "tdcr-suite/1"
scenarios = [{ file = "scenario.toml", difficulty = "easy" }]
planners = ["RRTConnect"]
models = ["constant_curvature"]
seeds = [1, 2, 3, 4, 5, 6]
"""
TRAIN = """format = "tdcr-train/1"
dataset = { cases = 800, validation_cases = 50 }
shooting = { hidden = [8] }
optimiser = { epochs = 6 }
bound = { alpha = 0.02, cases = 300 }
"""


@dataclass(frozen=True)
class Task:
    """A command to be interrupted.

    Attributes:
        name: The subcommand.
        arguments: What follows it; `{out}` stands for the output folder.
        content: What two runs of it must agree in; raises when a file is there that is not whole.
        keeps_part: Whether Ctrl-C has it write what it has until then.
    """

    name: str
    arguments: tuple[str, ...]
    content: Callable[[Path], Any]
    keeps_part: bool = False


@dataclass
class Tally:
    """What has been seen of one command and signal."""

    moments: int = 0
    interrupted: int = 0
    faults: list[str] = field(default_factory=list)


def read_plan(out: Path) -> Any:
    if not (out / "result.json").exists():
        return None
    content = json.loads((out / "result.json").read_text())
    with np.load(out / "shapes.npz") as shapes:
        states = len(shapes["positions_m"])
    lines = (out / "trajectory.csv").read_text().count("\n")
    pictures = (out / "path.png").stat().st_size > 0 and "</html>" in (out / "path.html").read_text()[-100:]
    return content["status"], content["path"], states, lines, pictures


def read_sweep(out: Path) -> Any:
    journal = out / "jobs.jsonl"
    if journal.exists():
        whole = journal.read_bytes().rpartition(b"\n")[0]
        for line in whole.splitlines():
            json.loads(line)
    return (out / "results.csv").read_text() if (out / "results.csv").exists() else None


def read_model(out: Path) -> Any:
    file = out / "model.pt"
    if not file.exists():
        return None
    load_shape_model(file)
    return file.read_bytes()


def read_roadmap(out: Path) -> Any:
    file = out / "scene.npz"
    return Roadmap.load(file).rows.tolist() if file.exists() else None


TASKS = (
    Task("plan", ("scenario.toml", "--out", "{out}"), read_plan),
    Task("train", ("robot.toml", "--config", "train.toml", "--out", "{out}/model.pt"), read_model),
    Task("sweep", ("suite.toml", "--out", "{out}", "--jobs", "2"), read_sweep, keeps_part=True),
    Task(
        "roadmap",
        ("scenario.toml", "--out", "{out}/scene.npz", "--vertices", "300", "--seconds", "600"),
        read_roadmap,
        keeps_part=True,
    ),
)


def make_scene(folder: Path) -> None:
    """Writes robot, scenario, mesh, suite and training settings."""
    box = trimesh.creation.box((40.0, 40.0, 40.0))
    box.apply_translation((70.0, 0.0, 90.0))
    box.export(folder / "box.stl")
    for name, text in (("robot", ROBOT), ("scenario", SCENARIO), ("suite", SUITE), ("train", TRAIN)):
        (folder / f"{name}.toml").write_text(text)


def start(task: Task, folder: Path, out: Path, mark: str) -> subprocess.Popen[str]:
    """Starts a command in a session of its own; its processes carry the mark in their environment."""
    arguments = [argument.format(out=out) for argument in task.arguments]
    return subprocess.Popen(
        [*PROGRAM, task.name, *arguments, "--no-progress"],
        cwd=folder,
        env={**os.environ, MARK: mark},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def living(mark: str) -> list[int]:
    """Returns the processes that carry a mark and have not ended."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if f"{MARK}={mark}".encode() in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
            except OSError:
                continue
    return found


def staging_folders(folder: Path) -> list[Path]:
    return list(folder.rglob(".tdcr-writing-*"))


def interrupt(task: Task, folder: Path, number: signal.Signals, delay_s: float, expected: Any, tally: Tally) -> None:
    """Ends one run of a command after a delay, checks what it left, runs it again and compares with what it should."""
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    mark = uuid.uuid4().hex
    tally.moments += 1

    def fault(text: str) -> None:
        tally.faults.append(f"{task.name} {number.name} after {delay_s:.2f} s: {text}")

    process = start(task, folder, out, mark)
    time.sleep(delay_s)
    tally.interrupted += process.poll() is None
    process.send_signal(number)
    try:
        _, errors = process.communicate(timeout=ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        fault(f"still runs after {ENDS_WITHIN_S:g} s")
        process.kill()
        _, errors = process.communicate()
    if number != signal.SIGKILL:
        if "Traceback" in errors or "Exception ignored" in errors or errors.count("\n") > 1:
            fault(f"said {errors.strip()[-400:]!r}")
        if process.returncode not in (0, 1, -number):
            fault(f"exit code {process.returncode}")
        if staging_folders(folder):
            fault("left a staging folder")
    end = time.monotonic() + GONE_WITHIN_S
    while (left := living(mark)) and time.monotonic() < end:
        time.sleep(0.1)
    if left:
        fault(f"left {len(left)} processes")
        for pid in left:
            os.kill(pid, signal.SIGKILL)
    try:
        found = task.content(out)
        may_be_part = task.keeps_part and number != signal.SIGKILL
        if found is not None and found != expected and not may_be_part:
            fault("left a file with other content")
    except Exception as error:
        fault(f"left a file that is not whole: {type(error).__name__}: {error}")
    _, errors = start(task, folder, out, mark).communicate()
    if task.content(out) != expected:
        fault(f"the next run ended otherwise {errors.strip()[-400:]!r}")
    if staging_folders(folder):
        fault("the next run left the staging folder")


def moments(seed: int, count: int, usual_s: float) -> Iterator[float]:
    """Draws moments from the start to a little after the usual end of a run, one in each of `count` equal spans."""
    random = np.random.default_rng(seed)
    yield from ((index + random.uniform()) / count * 1.05 * usual_s for index in range(count))


def run_task(task: Task, folder: Path, count: int, seed: int, numbers: tuple[signal.Signals, ...]) -> list[str]:
    """Returns the lines of the table for one command."""
    usual_s, expected = 0.0, None
    for _ in range(2):  # the first run warms caches
        shutil.rmtree(folder / "out", ignore_errors=True)
        began = time.monotonic()
        _, errors = start(task, folder, folder / "out", uuid.uuid4().hex).communicate()
        usual_s = time.monotonic() - began
        expected = task.content(folder / "out")
        if expected is None:
            raise SystemExit(f"{task.name} does not work uninterrupted: {errors}")
    lines = []
    for number in numbers:
        tally = Tally()
        for delay_s in moments(seed + number, count, usual_s):
            interrupt(task, folder, number, delay_s, expected, tally)
        seen = (tally.moments, tally.interrupted, f"{usual_s:.1f}", len(tally.faults))
        lines.append(f"| {task.name} | {number.name} | " + " | ".join(map(str, seen)) + " |")
        print(lines[-1], *tally.faults, sep="\n", flush=True)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moments", type=int, default=50, help="of each command and signal")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", nargs="+", default=[task.name for task in TASKS])
    parser.add_argument("--signals", nargs="+", default=[number.name for number in SIGNALS])
    options = parser.parse_args()
    numbers = tuple(number for number in SIGNALS if number.name in options.signals)
    lines = []
    for task in TASKS:
        if task.name in options.commands:
            with tempfile.TemporaryDirectory() as folder:
                make_scene(Path(folder))
                lines += run_task(task, Path(folder), options.moments, options.seed, numbers)
    print(f"\n{platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}\n")
    print("| command | signal | moments | still running | usual time s | faults |\n|---|---|---|---|---|---|")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
