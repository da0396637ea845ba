"""tdcr scene: what files of a place hold, where the robot fits in, and a scenario that plans."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

if TYPE_CHECKING:
    from tdcr_planner.robot import RobotSpec
    from tdcr_planner.survey.proposal import Proposal
    from tdcr_planner.survey.survey import Place


def scene(
    files: tyro.conf.Positional[tuple[Path, ...]],
    *,
    out: Path,
    robot: Path | None = None,
    shape_model: Path | None = None,
    unit: Literal["m", "cm", "mm", "in"] | None = None,
    label: int | None = None,
    threshold: tuple[float, float] | None = None,
) -> int:
    """Say what meshes, volumes or point clouds hold, where a robot fits in, and write a scenario that plans there.

    Example: tdcr scene airway.stl --robot models/robots/borescope.toml --out survey

    The file with the widest opening is taken as the cavity, the others as obstacles. The goal lies on the line along
    which the robot has most room, as deep as a plan is found. Exit code 0 when the scenario was planned and verified,
    1 when no scenario could be.

    Args:
        files: Meshes (STL, OBJ, PLY, OFF, glTF, 3MF, STEP, IGES), volumes (NIfTI, NRRD, MetaImage, a folder of DICOM
            slices) or point clouds (PLY, PCD, XYZ, LAS, LAZ, E57).
        out: Folder for the scenario and its picture.
        robot: Robot file; without one a borescope is sized for the opening.
        shape_model: The robot's shape model; without one the reference gives the shapes.
        unit: Unit of length of the meshes and clouds, in place of a guess.
        label: Of a volume: the value of the voxels inside.
        threshold: Of a volume: the lowest and the highest value inside.
    """
    from tdcr_planner.collision.volumes.surface import Region
    from tdcr_planner.errors import InputError
    from tdcr_planner.files import check_folder
    from tdcr_planner.robot import load_robot
    from tdcr_planner.survey.survey import describe_place, survey_place

    if not files:
        raise InputError("files", "one or more files of a place", "none")
    check_folder(out, ("scenario.toml", "robot.toml", "scene.png", "scene.html"))
    body = None if robot is None else load_robot(robot)
    region = None if label is None and threshold is None else Region(label, threshold, 1e-8)
    length, diameter = (None, None) if body is None else (body.length, 2.0 * float(body.disk_radii.max()))
    places = [survey_place(file, unit, region, length, diameter) for file in files]
    for place in places:
        print("\n".join(describe_place(place)))
    return _propose(places, out, robot, body, shape_model)


def _propose(
    places: list[Place], out: Path, robot: Path | None, body: RobotSpec | None, shape_model: Path | None
) -> int:
    """Writes the deepest scenario that plans, and returns the exit code."""
    from tdcr_planner.robot import load_robot
    from tdcr_planner.survey.proposal import propose, relative_name
    from tdcr_planner.survey.sized_robot import sized_robot
    from tdcr_planner.survey.survey import centreline_of

    mouths = [place.report.loops[0].diameter if place.report and place.report.loops else 0.0 for place in places]
    cavity = max(range(len(places)), key=lambda index: mouths[index])
    if mouths[cavity] == 0.0:
        print("no scenario: none of the files has an opening; cut one where the robot enters, or place the base in it")
        return 1
    out.mkdir(parents=True, exist_ok=True)
    if body is None:
        robot = out / "robot.toml"
        robot.write_text(sized_robot(mouths[cavity]))
        body = load_robot(robot)
    assert robot is not None  # given, or just written
    radius = float(body.disk_radii.max())
    entry = places[cavity].opening_entry(2.0 * radius)
    line = None if entry is None else centreline_of(places[cavity], entry, radius + places[cavity].error)
    if entry is None or line is None:
        print(f"no scenario: a robot of {2e3 * radius:.3g} mm does not fit through the opening")
        return 1
    room, depth = line.narrowest()
    print(
        f"a robot of {2e3 * radius:.3g} mm fits in to a depth of {1e3 * line.depths[-1]:.4g} mm; "
        f"the narrowest place is {2e3 * room:.3g} mm wide, {1e3 * depth:.4g} mm behind the opening"
    )
    tables = [
        place.to_toml(relative_name(place.file, out), entry if index == cavity else None)
        for index, place in enumerate(places)
    ]
    model = None if shape_model is None else relative_name(shape_model, out)
    proposals = propose(entry, line, body, "\n".join(tables), relative_name(robot, out), model)
    return _write_planned(proposals, f"Into {places[cavity].file.stem}", out)


def _write_planned(proposals: list[Proposal], title: str, out: Path) -> int:
    """Writes scenarios, the deepest first, until one plans."""
    import numpy as np

    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.planning.scenario import load_scenario
    from tdcr_planner.query.result import PlanStatus
    from tdcr_planner.query.session import PlanningSession
    from tdcr_planner.report.results import draw_result, write_result_data

    file = out / "scenario.toml"
    session = None
    for proposal in proposals:
        file.write_text(proposal.to_toml(title))
        query = load_scenario(file)
        session = PlanningSession(query) if session is None else session
        result = session.plan(query)
        verified = result.status is PlanStatus.VERIFIED
        goal = np.round(1e3 * proposal.goal, 2).tolist()
        print(f"goal {goal} mm: {result.status.value} {'' if verified else result.message}".rstrip(), flush=True)
        if verified:
            write_result_data(result, out / "plan")
            draw_after("the result", partial(draw_result, result, out / "plan"))
            print(f"files: {file} and its plan in {out / 'plan'}")
            return 0
    print(f"no goal could be planned; {file} has the last one")
    return 1
