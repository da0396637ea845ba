"""The visibility tests of a scenario in a session's scene."""

from __future__ import annotations

from tdcr_planner.errors import InputError
from tdcr_planner.inspection.camera import scenario_camera
from tdcr_planner.inspection.targets import make_targets
from tdcr_planner.inspection.visibility import Visibility
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.session import PlanningSession


def check_inspects(query: Scenario) -> None:
    """Raises InputError unless a scenario says what to inspect."""
    if query.file.inspect is None:
        raise InputError("scenario", "one with [inspect], which says what is to be seen", str(query.path))


def make_visibility(session: PlanningSession, scenario: Scenario | None = None) -> Visibility:
    """Returns the visibility tests of a scenario in a session's scene.

    Raises:
        InputError: The scenario says nothing of what to inspect, or there is no camera.
        FormatError: A surface is unknown or empty, or its spacing makes too many points.
    """
    query = scenario or session.scenario
    check_inspects(query)
    camera = scenario_camera(query)
    return Visibility(camera, make_targets(query, session.meshes), session.meshes, session.scene.body)
