"""Success and time of queries through narrow places, against the width of the place, made by scenes/port/make_scene.py.

python benchmarks/narrow.py [--quick] [--seeds 20] [--limit 20] [--only plates,elbows,offset,tube,impossible]
                            [--every K] [--planners RRTConnect,...] [--out docs/pictures]

plates: plates of 10, 30 and 60 mm, hole / robot 1.15 to 2, one to three segments and models/robots/inspection.toml,
gravity none, across and along, roll fixed and free, goals ahead, beside the axis and looking back at the plate.
elbows: pipes of 1.6, 2 and 2.5 times the robot with a bend of 45, 90 and 180 degrees.
offset: two plates 30 mm apart with holes of twice the robot offset by 6 mm.
tube: a straight push into a tube with room for the required clearance and 0.05 mm.
impossible: holes too small, goals inside of walls, bends too tight; right is an end within 5 s that is not verified.

The robot is models/robots/borescope.toml with its learned model; with its segments repeated or left out the reference
is the shape model, since no model is trained for these. Goals may have no free goal state: such queries are counted by
themselves, and --every K runs each K-th of a group's places. Times are CPU seconds of this process for plan and
verify: what else runs on the machine hardly moves them. The clearance asked for is a tenth of the room.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import importlib.util
import itertools
import platform
import re
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import trimesh

from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.shape.learned import load_shape_model

ROOT = Path(__file__).resolve().parents[1]
DIAMETER = 3.0  # of the borescope, mm
SEGMENT = 50.0  # its length, mm
TRAINED_SEGMENTS = 2  # of the borescope that has a learned model
INSPECTION = (20.0, 200.0)  # diameter and length of models/robots/inspection.toml, one segment, mm
BACK_RADIUS = 50.0  # of the arc that looks back: a segment of the borescope bends to 40 mm
# Behind both plates, mm. Nearer to the second hole no shape is free: the second segment has no length to bend back in.
OFFSET_GOALS = ((76.0, 4.0, 0.0), (76.0, 7.0, 0.0), (78.0, 2.0, 0.0), (80.0, 0.0, 0.0))
GRAVITY = {"none": (0.0, 0.0, 0.0), "across": (0.0, 0.0, -9.81), "along": (9.81, 0.0, 0.0)}
ENDED_WITHIN_S = 5.0

SCENARIO = """format = "tdcr-scenario/1"
robot = "{robot}"
{model}gravity_m_s2 = {gravity}
[[meshes]]
file = "{mesh}"
unit = "mm"
role = "{role}"
{entry}
[base]
position_m = [{base}, 0.0, 0.0]
quaternion_wxyz = [0.0, 0.7071067811865476, 0.0, 0.7071067811865476]
insertion_m = [0.0, {travel}]
{roll}[start]
bending_n = {straight}
[goal]
{goal}
[planner]
name = "{planner}"
time_limit_s = {limit}
step_m = 0.0005
clearance_m = {clearance}
validity = "{validity}"
"""


@dataclass(frozen=True)
class Case:
    """One query: lengths in mm, the goal a tip position, with a view or without, or a straight push by so much."""

    group: str
    label: str
    width: float  # of the place, in robot diameters
    mesh: trimesh.Trimesh
    role: str
    goal: tuple[float, ...] | float
    clearance: float
    segments: int = 2
    gravity: str = "none"
    view: tuple[float, float, float] | None = None
    robot: str = "borescope"
    rolls: bool = False

    @property
    def length(self) -> float:
        """Length of the robot, mm."""
        return INSPECTION[1] if self.robot == "inspection" else SEGMENT * self.segments


@dataclass(frozen=True)
class Answers:
    """What the seeds of a case came to.

    Attributes:
        verified: Whether each ended verified.
        possible: Whether each had a goal state.
        seconds: CPU seconds of each.
        told: What answered, or the message, and how often.
    """

    verified: list[bool]
    possible: list[bool]
    seconds: list[float]
    told: Counter[str]


def load_generator() -> ModuleType:
    """Returns scenes/port/make_scene.py as a module."""
    spec = importlib.util.spec_from_file_location("make_port", ROOT / "scenes/port/make_scene.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def room(width: float, diameter: float = DIAMETER) -> float:
    """Returns the room on each side of a robot in the middle of a place, mm."""
    return 0.5 * diameter * (width - 1.0)


def goals_behind(thickness: float, length: float, segments: int) -> Iterator[tuple[str, tuple[float, ...], Any]]:
    """Yields name, place and view of goals behind a plate that the robot reaches by an arc, mm."""
    yield "ahead", (thickness + 0.5 * length, 0.0, 0.0), None
    if segments > 1:
        yield "beside", (thickness + 0.8 * SEGMENT, 0.4 * SEGMENT, 0.0), None
        turned = 0.9 * length / BACK_RADIUS
        place = (thickness + 2.0 + BACK_RADIUS * np.sin(turned), BACK_RADIUS * (1.0 - np.cos(turned)), 0.0)
        yield "looking back", place, (np.cos(turned), np.sin(turned), 0.0)


def behind(thickness: float) -> tuple[float, float, float]:
    """Returns the goal beside the axis behind a plate."""
    return (thickness + 0.8 * SEGMENT, 0.4 * SEGMENT, 0.0)


def plates(make: ModuleType, quick: bool) -> Iterator[Case]:
    """Yields plates with one hole."""
    robots = [("borescope", 2)] if quick else [("borescope", 1), ("borescope", 2), ("borescope", 3), ("inspection", 1)]
    for width in (1.3, 2.0) if quick else (1.15, 1.3, 1.6, 2.0):
        for thickness in (10.0,) if quick else (10.0, 30.0, 60.0):
            for robot, segments in robots:
                diameter, length = INSPECTION if robot == "inspection" else (DIAMETER, SEGMENT * segments)
                mesh = make.make_plate(width * diameter, thickness)
                for name, place, view in goals_behind(thickness, length, segments):
                    for gravity in ("none",) if quick else GRAVITY:
                        for rolls in (False,) if quick else (False, True):
                            label = f"plate {thickness:g} mm, {robot} of {segments}, {name}, gravity {gravity}"
                            label += ", roll free" if rolls else ""
                            clearance = 0.1 * room(width, diameter)
                            yield Case(
                                "plates", label, width, mesh, "obstacle", place, clearance, segments, gravity, view,
                                robot, rolls,
                            )  # fmt: skip


def elbows(make: ModuleType, quick: bool) -> Iterator[Case]:
    """Yields bent pipes, the goal on the axis at the end of the bend."""
    for width in (2.5,) if quick else (1.6, 2.0, 2.5):
        for angle in (45.0,) if quick else (45.0, 90.0, 180.0):
            for radius in (60.0,) if quick else (48.0, 78.0):  # 1.2 and 2 times the tightest of a segment
                turned = np.deg2rad(min(angle, 0.9 * np.rad2deg(2.0 * SEGMENT / radius)))
                goal = (20.0 + radius * np.sin(turned), radius * (1.0 - np.cos(turned)), 0.0)
                mesh = make.make_pipe(width * DIAMETER, 20.0, radius, angle, 40.0)
                yield Case(
                    "elbows", f"{angle:g} degrees, {radius:g} mm", width, mesh, "cavity", goal, 0.1 * room(width)
                )


def offset(make: ModuleType, _: bool) -> Iterator[Case]:
    """Yields two plates with offset holes."""
    mesh = make.make_plates(2.0 * DIAMETER, 5.0, 30.0, 6.0)
    for goal in OFFSET_GOALS:
        yield Case(
            "offset", f"two plates, to {goal[0]:g}, {goal[1]:g} mm", 2.0, mesh, "obstacle", goal, 0.1 * room(2.0)
        )


def tube(make: ModuleType, _: bool) -> Iterator[Case]:
    """Yields a straight push into a tube that leaves 0.05 mm beyond what is required: clearance and error bound."""
    clearance = 0.2
    bound = 1e3 * float(load_shape_model(ROOT / "models/shape/borescope/model.pt").error_bound.max())
    width = 1.0 + 2.0 * (clearance + bound + 0.05) / DIAMETER
    yield Case("tube", "push", width, make.make_pipe(width * DIAMETER, 120.0), "cavity", 90.0, clearance)


def impossible(make: ModuleType, quick: bool) -> Iterator[Case]:
    """Yields goals that cannot be had."""
    for width in (0.9,) if quick else (0.5, 0.7, 0.9, 0.95, 0.99, 1.0):
        for thickness in (10.0,) if quick else (10.0, 30.0):
            mesh = make.make_plate(width * DIAMETER, thickness)
            yield Case("impossible", f"hole, {thickness:g} mm", width, mesh, "obstacle", behind(thickness), 0.05)
    for depth in (5.0,) if quick else (3.0, 5.0, 15.0, 25.0):
        mesh = make.make_plate(2.0 * DIAMETER, 30.0)
        yield Case("impossible", f"{depth:g} mm inside of a wall", 2.0, mesh, "obstacle", (depth, 15.0, 0.0), 0.1)
    for radius in (8.0,) if quick else (6.0, 8.0, 10.0, 12.0):
        mesh = make.make_pipe(1.6 * DIAMETER, 20.0, radius, 90.0, 60.0)
        goal = (20.0 + radius, radius + 35.0, 0.0)
        yield Case("impossible", f"bend of {radius:g} mm", 1.6, mesh, "cavity", goal, 0.1)


def write_robot(folder: Path, segments: int) -> Path:
    """Returns the file of the borescope with so many segments."""
    text = (ROOT / "models/robots/borescope.toml").read_text()
    head, *parts = re.split(r"(?=^\[\[segments\]\])", text, flags=re.MULTILINE)
    last, tail = re.split(r"(?=^\[tip\])", parts[-1], maxsplit=1, flags=re.MULTILINE)
    parts = [*parts[:-1], last]
    path = folder / f"robot_{segments}.toml"
    path.write_text(head + "".join(parts[k % len(parts)] for k in range(segments)) + tail)
    return path


def open_session(folder: Path, case: Case, planner: str, limit: float) -> PlanningSession:
    """Returns the session of a case, its files written into a folder."""
    mesh = folder / "mesh.stl"
    case.mesh.export(mesh)
    straight = [[0.0, 0.0]] * case.segments
    if isinstance(case.goal, float):
        goal = f"bending_n = {straight}\ninsertion_m = {1e-3 * case.goal}"
    else:
        goal = f"tip_position_m = {[float(1e-3 * value) for value in case.goal]}"
        if case.view is not None:
            goal += f"\nview_direction = {[float(value) for value in case.view]}"
    length = 1e-3 * case.length
    path = folder / "scenario.toml"
    trained = case.robot == "inspection" or case.segments == TRAINED_SEGMENTS
    model = f'shape_model = "{ROOT / "models/shape" / case.robot / "model.pt"}"\n' if trained else ""
    path.write_text(
        SCENARIO.format(
            robot=ROOT / f"models/robots/{case.robot}.toml" if trained else write_robot(folder, case.segments),
            model=model,
            validity="learned" if trained else "reference",
            gravity=list(GRAVITY[case.gravity]),
            mesh=mesh,
            role=case.role,
            entry="entry = { point_m = [0.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0] }" if case.role == "cavity" else "",
            base=-(length + 0.005),
            travel=length + 0.07,
            roll="roll_deg = [-180.0, 180.0]\n" if case.rolls else "",
            straight=straight,
            goal=goal,
            planner=planner,
            limit=limit,
            clearance=1e-3 * case.clearance,
        )
    )
    return PlanningSession(load_scenario(path))


def run(case: Case, planner: str, seeds: int, limit: float) -> Answers:
    """Returns what a case's seeds have come to."""
    answers = Answers([], [], [], Counter())
    with tempfile.TemporaryDirectory() as folder:
        session = open_session(Path(folder), case, planner, limit)
        for seed in range(1, seeds + 1):
            begin = time.process_time()
            result = session.plan(session.scenario.with_planner(seed=seed))
            answers.seconds.append(time.process_time() - begin)
            answers.verified.append(result.status is PlanStatus.VERIFIED)
            answers.possible.append(result.planner["goal_states"] > 0)
            answered = result.planner["answered_by"] if answers.verified[-1] else result.message[:160]
            answers.told[answered] += 1
    return answers


def summary(group: str, answers: list[Answers]) -> str:
    """Returns a sentence on the queries of a group that have a goal state."""
    possible = [flag for each in answers for flag in each.possible]
    verified = [flag for each in answers for flag in each.verified]
    seconds = [value for each in answers for value, flag in zip(each.seconds, each.possible, strict=True) if flag]
    if not seconds:
        return f"{group}: no goal state in any of {len(possible)} queries"
    late = np.quantile(seconds, 0.95)
    return (
        f"{group}: {sum(verified)} of {sum(possible)} queries with a goal state verified, "
        f"median {np.median(seconds):.2f} s, 95 % within {late:.2f} s; {len(possible) - sum(possible)} without one"
    )


def plot(rows: list[tuple[Case, str, float, float]], folder: Path) -> None:
    """Draws success and median time against the width of the place, a line a group and planner."""
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 6.0), layout="constrained")
    for group, planner in dict.fromkeys((case.group, planner) for case, planner, _, _ in rows):
        mine = [row for row in rows if (row[0].group, row[1]) == (group, planner)]
        widths = sorted({case.width for case, *_ in mine})
        for axis, column in ((above, 2), (below, 3)):
            means = [np.mean([row[column] for row in mine if row[0].width == width]) for width in widths]
            axis.plot(widths, means, marker="o", label=f"{group}, {planner}")
    above.set_ylabel("verified, share")
    below.set_ylabel("plan and verify, CPU s")
    below.set_yscale("log")
    below.set_xlabel("width of the place / diameter of the robot")
    above.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "narrow.png", dpi=120)


def main() -> None:
    """Prints the tables and, with --out, draws the picture."""
    # Time limits run on the processor's clock here, so that a busy machine takes nothing from a query.
    time.monotonic = time.process_time
    groups = {"plates": plates, "elbows": elbows, "offset": offset, "tube": tube, "impossible": impossible}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few cases, two seeds")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--limit", type=float, default=20.0, help="time_limit_s, on the processor's clock")
    parser.add_argument("--only", default=",".join(groups))
    parser.add_argument("--every", type=int, default=1, help="run each K-th place of a group")
    parser.add_argument("--planners", default="RRTConnect")
    parser.add_argument("--out", type=Path, help="folder for the picture")
    arguments = parser.parse_args()
    seeds = min(arguments.seeds, 2) if arguments.quick else arguments.seeds
    make, rows = load_generator(), []
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, one thread, {seeds} seeds")
    print(
        "| place | width / robot | planner | verified | median s | most s | what answered |\n"
        "|---|---|---|---|---|---|---|"
    )
    sentences = []
    for group in arguments.only.split(","):
        of_group = []
        for case in itertools.islice(groups[group](make, arguments.quick), 0, None, arguments.every):
            for planner in arguments.planners.split(","):
                found = run(case, planner, seeds, arguments.limit)
                answered = found.told.most_common(1)[0][0]
                print(
                    f"| {group}: {case.label} | {case.width:.3g} | {planner} | {sum(found.verified)} of {seeds} "
                    f"| {np.median(found.seconds):.2f} | {max(found.seconds):.2f} | {answered} |",
                    flush=True,
                )
                rows.append((case, planner, float(np.mean(found.verified)), float(np.median(found.seconds))))
                of_group.append(found)
        sentences.append(summary(group, of_group))
    print("\n".join(sentences))
    late = [case.label for case, _, _, seconds in rows if case.group == "impossible" and seconds > ENDED_WITHIN_S]
    if "impossible" in arguments.only:
        print(f"impossible goals whose median end took more than {ENDED_WITHIN_S:g} s: {', '.join(late) or 'none'}")
    if arguments.out is not None:
        plot([row for row in rows if row[0].group != "impossible"], arguments.out)


if __name__ == "__main__":
    main()
