"""tdcr info: what a robot, model, scenario, result or roadmap file holds."""

from __future__ import annotations

import math
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.arrays import FloatArray
    from tdcr_planner.planning.scenario import Goal, Scenario
    from tdcr_planner.robot import Backbone, Drive, RobotSpec, Tendon
    from tdcr_planner.sweep.suite import Suite


def info(file: tyro.conf.Positional[Path]) -> int:
    """Say what a robot, model, scenario, suite, result or roadmap file holds.

    Example: tdcr info models/shape/inspection/model.pt

    Args:
        file: A robot, scenario or suite (.toml), a shape model (.pt), a result (.json) or a roadmap (.npz).
    """
    from tdcr_planner.errors import FormatError
    from tdcr_planner.files import read_toml

    if file.suffix == ".pt":
        from tdcr_planner.shape.learned import load_shape_model

        print(load_shape_model(file).card.describe())
    elif file.suffix == ".json":
        from tdcr_planner.cli.plan import describe
        from tdcr_planner.report.results import read_result

        result = read_result(file)
        print(f"result of {result.scenario.path}, seed {result.seed}\n{describe(result)}")
    elif file.suffix == ".npz":
        from tdcr_planner.cli.roadmap import describe as describe_roadmap
        from tdcr_planner.planning.roadmap import Roadmap

        print(describe_roadmap(Roadmap.load(file)))
    elif file.suffix == ".toml":
        from tdcr_planner.planning.scenario import load_scenario
        from tdcr_planner.robot import load_robot

        kind = read_toml(file).get("format")
        if kind in ("tdcr-robot/1", "tdcr-robot/2"):
            print(_describe_robot(load_robot(file)))
        elif kind == "tdcr-scenario/1":
            print(_describe_scenario(load_scenario(file)))
        elif kind == "tdcr-suite/1":
            from tdcr_planner.sweep.suite import load_suite

            print(_describe_suite(load_suite(file, import_planners=False)))
        else:
            raise FormatError(
                file,
                f"expected 'tdcr-robot/1', 'tdcr-robot/2', 'tdcr-scenario/1' or 'tdcr-suite/1', got {kind!r}",
                "format",
            )
    else:
        raise FormatError(file, f"expected a file ending in .toml, .pt, .json or .npz, got {file.suffix!r}")
    return 0


def _describe_robot(robot: RobotSpec) -> str:
    weight = robot.disk_masses.sum() + robot.tip.mass_kg + robot.backbone_mass
    lines = [f"robot {robot.name!r}, mechanics {robot.mechanics_hash[:12]}"]
    for index, (segment, backbone) in enumerate(zip(robot.segments, robot.segment_backbones, strict=True)):
        masses = sorted({f"{1e3 * mass:g}" for mass in segment.masses}, key=float)
        lines.append(
            f"segment {index + 1}: {1e3 * segment.length_m:g} mm, {segment.disks} disks of "
            f"{2e3 * segment.disk_radius_m:g} mm and {' to '.join(dict.fromkeys([masses[0], masses[-1]]))} g"
            + (", rigid" if segment.rigid else "")
        )
        if segment.tendon_angles_deg is not None:
            angles = ", ".join(f"{angle:g}" for angle in segment.tendon_angles_deg)
            lines.append(
                f"  tendons at {angles} degrees on a circle of {1e3 * (segment.tendon_circle_radius_m or 0.0):g} mm, "
                f"{segment.pretension_n:g} to {segment.max_tension_n:g} N"
            )
        lines.append(f"  backbone {_describe_rod(backbone)}")
    if robot.format == "tdcr-robot/2":
        lines += [f"tendon {index + 1}: {_describe_tendon(tendon)}" for index, tendon in enumerate(robot.tendons)]
        lines += _describe_drive(robot.drive)
    if robot.camera is not None:
        near, far = robot.camera.range_m
        lines.append(
            f"camera with a field of view of {_angles(robot.camera.field_of_view_deg)} degrees, from {1e3 * near:g} to "
            f"{1e3 * far:g} mm"
        )
    lines.append(f"moving weight {1e3 * weight:.2f} g, of which {1e3 * robot.tip.mass_kg:g} g payload")
    if robot.features:
        lines += wrap(
            "beyond what the planner and learned models know: " + ", ".join(sorted(robot.features)),
            79,
            subsequent_indent="  ",
        )
    return "\n".join(lines)


def _describe_rod(backbone: Backbone) -> str:
    stiffness = backbone.stiffness_bending_torsion
    if backbone.radius_points_m is not None:
        radii = [radius for _, radius in backbone.radius_points_m]
        return f"{2e3 * max(radii):g} to {2e3 * min(radii):g} mm, EI up to {stiffness[0]:.4g} N m^2"
    both = "" if stiffness[0] == stiffness[1] else f" about x and {stiffness[1]:.4g} N m^2 about y"
    return f"{2e3 * backbone.radius_m:g} mm, EI {stiffness[0]:.4g} N m^2{both}"


def _describe_tendon(tendon: Tendon) -> str:
    """Returns where a tendon runs and ends, and what there is to it besides."""
    text = f"disk {tendon.start_disk} to {tendon.end_disk}, {_describe_path(tendon)}"
    if tendon.between_disks == "straight":
        text += ", straight between disks"
    if not math.isinf(tendon.max_tension):
        text += f", to {tendon.max_tension:g} N"
    if tendon.friction_coefficient:
        text += f", friction {tendon.friction_coefficient:g}"
    return text


def _describe_path(tendon: Tendon) -> str:
    from tdcr_planner.robot import PolarPath

    ends = tendon.offsets([tendon.start_arc_length, tendon.end_arc_length])
    radii = [f"{1e3 * math.hypot(x, y):.4g}" for x, y in ends]
    angle = f"{math.degrees(math.atan2(ends[0, 1], ends[0, 0])):.4g} degrees"
    across = " to ".join(dict.fromkeys(radii)) + " mm from the backbone"
    if "tendons through points" in tendon.path.kinds:
        return f"through points from {angle}, {across}"
    if isinstance(tendon.path, PolarPath) and tendon.path.winding:
        turns = tendon.path.winding * (tendon.end_arc_length - tendon.start_arc_length) / (2.0 * math.pi)
        return f"winding by {turns:.4g} turns from {angle}, {across}"
    return f"at {angle}, {across}"


def _describe_drive(drive: Drive) -> list[str]:
    def several(values: FloatArray, unit: str) -> str:
        low, high = values.min(), values.max()
        return f"{low:g} {unit}" if low == high else f"{low:g} to {high:g} {unit}"

    line = f"{drive.kind} drive, pretension {several(drive.pretension, 'N')}"
    if not math.isinf(drive.transmission_stiffness.min()):
        line += f", transmission {several(drive.transmission_stiffness, 'N/m')}"
    if drive.backlash.any():
        line += f", backlash {several(1e3 * drive.backlash, 'mm')}"
    return [line]


def _describe_suite(suite: Suite) -> str:
    """Returns what a sweep of a suite runs: scenarios by difficulty, planners, models, seeds, and how many jobs."""
    file = suite.file
    lines = [f"suite {file.title or suite.path.name!r}: {len(suite.jobs)} jobs"]
    for difficulty in dict.fromkeys(entry.difficulty for entry in file.scenarios):
        names = [entry.file for entry in file.scenarios if entry.difficulty == difficulty]
        lines += wrap(f"{difficulty}: " + ", ".join(names), 79, subsequent_indent="  ", break_on_hyphens=False)
    lines.append("planners: " + ", ".join(file.planners) + "; models: " + ", ".join(file.models))
    seeds = ", ".join(str(seed) for seed in file.seeds)
    limit = "each scenario's own time limit" if file.time_limit_s is None else f"{file.time_limit_s:g} s a job"
    return "\n".join([*lines, *wrap(f"seeds: {seeds}; {limit}", 79, subsequent_indent="  ")])


def _describe_scenario(scenario: Scenario) -> str:
    file, planner = scenario.file, scenario.planner
    lines = [f"scenario {file.title or scenario.path.name!r} for robot {scenario.robot.name!r}"]
    if file.shape_model is not None:
        lines.append(f"shape model {file.shape_model}")
    lines += [surface.describe() for surface in file.surfaces]
    lines.append("gravity ({:g}, {:g}, {:g}) m/s^2, ".format(*scenario.gravity) + _describe_force(scenario))
    if file.base.insertion_m is not None:
        lines.append("insertion {:g} to {:g} mm".format(*(1e3 * value for value in file.base.insertion_m)))
    if file.base.roll_deg is not None:
        lines.append("roll {:g} to {:g} degrees".format(*file.base.roll_deg))
    lines += [f"goal {index + 1}: {_describe_goal(goal)}" for index, goal in enumerate(scenario.goals)]
    if file.inspect is not None:
        names = ", ".join(dict.fromkeys(surface.mesh for surface in file.inspect.surfaces))
        lines.append(f"to be seen: {names}, points {1e3 * file.inspect.spacing_m:g} mm apart")
    lines.append(
        f"{planner.name} with {planner.validity} validity, {planner.time_limit_s:g} s, "
        f"step {1e3 * planner.step_m:g} mm, clearance {1e3 * planner.clearance_m:g} mm"
    )
    return "\n".join(lines)


def _describe_force(scenario: Scenario) -> str:
    force = scenario.tip_force
    return "tip force ({:g}, {:g}, {:g}) N".format(*force) if force.any() else "no tip force"


def _describe_goal(goal: Goal) -> str:
    from tdcr_planner.planning.scenario import DRIVE_KEYS

    if goal.tip_position_m is None:
        key = next(name for name in DRIVE_KEYS if getattr(goal, name) is not None)
        drive = f"{key.split('_')[0]} {getattr(goal, key)} {'N' if key.endswith('n') else 'm'}"
        return f"{drive}, insertion {1e3 * goal.insertion_m:g} mm, roll {goal.roll_deg:g} degrees"
    text = "tip at ({:g}, {:g}, {:g}) mm".format(*(1e3 * value for value in goal.tip_position_m))
    if goal.view_direction is not None:
        text += " looking along ({:g}, {:g}, {:g})".format(*goal.view_direction)
    return text


def _angles(angles: float | tuple[float, float]) -> str:
    """Returns an opening angle, or a width and a height, as text."""
    return f"{angles:g}" if isinstance(angles, float) else f"{angles[0]:g} x {angles[1]:g}"
