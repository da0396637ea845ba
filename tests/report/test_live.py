import urllib.request

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.report import live
from tdcr_planner.report.live import LiveScene, describe, serve_live
from tdcr_planner.session import PlanningSession


@pytest.fixture
def session(make_scenario):
    return PlanningSession(make_scenario("paper"))


@pytest.fixture
def viewer(session):
    """A viewer on a port that viser finds free."""
    viewer = serve_live(session, port=18732)
    yield viewer
    viewer.stop()


def test_look_tells_free_from_touching(session):
    scene = LiveScene(session)
    assert scene.models == ("reference", "constant_curvature")
    inside = session.space.row(((0.0, 0.0),), insertion_m=-0.05)
    look = scene.look(inside, "constant_curvature")
    assert look.problem == ""
    # pipe of 14 mm, disks of 10 mm on its axis; the pipe has 48 flat sides
    assert look.clearance == pytest.approx(0.004, abs=14e-3 * (1 - np.cos(np.pi / 48)) + 1e-6)
    bent = session.space.row(((-1.0, 0.0),), insertion_m=-0.05)
    look = scene.look(bent, "constant_curvature")
    assert "pipe.stl" in look.problem
    assert look.clearance < 0.0
    assert "not allowed" in describe(look)


def test_moving_the_sliders_moves_the_robot(viewer):
    with urllib.request.urlopen(viewer.address, timeout=10) as page:
        assert page.status == 200
    row = np.array([0.3, -0.2, -0.05, 0.4])
    viewer.move(row)
    # sliders have a thousand steps; the value that a program sets is kept as it is
    np.testing.assert_allclose(viewer.row, row, atol=1e-9)
    assert "tensions" in viewer._note.content


def test_without_viser_the_message_says_what_to_install(session, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(InputError, match=r"tdcr-planner\[live\]"):
        live.serve_live(session)
