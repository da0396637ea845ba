import errno
import socket
import threading
import time
import urllib.request

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.report import live
from tdcr_planner.report.live import find_port, serve_live
from tdcr_planner.report.live_scene import Controls

BENT = np.array([0.0, 0.0, 2.5])  # to one side, hard


@pytest.fixture
def session(make_scenario):
    return PlanningSession(make_scenario("paper"))


@pytest.fixture
def viewer(session):
    """A viewer on a port that viser finds free."""
    viewer = serve_live(session, port=18732)
    yield viewer
    viewer.stop()


def drawn(viewer, name):
    """The vertices of what the server shows under a name, m, or None."""
    handle = viewer._server.scene.get_handle_by_name(name)
    return None if handle is None else np.asarray(handle.vertices)


def test_a_slider_for_each_tendon_within_its_limits_then_insertion_and_roll(viewer, session):
    robot = session.scenario.robot
    with urllib.request.urlopen(viewer.address, timeout=10) as page:
        assert page.status == 200
    assert [slider.label for slider in viewer._tendons] == ["tendon 1 (90°)", "tendon 2 (-30°)", "tendon 3 (210°)"]
    assert [slider.min for slider in viewer._tendons] == robot.pretensions.tolist()
    assert [slider.max for slider in viewer._tendons] == robot.max_tensions.tolist()
    assert (viewer._insertion.min, viewer._insertion.max) == pytest.approx((-150.0, 50.0))
    assert (viewer._roll.min, viewer._roll.max) == pytest.approx((-180.0, 180.0))


@pytest.mark.parametrize("port", [-1, 65536, 80000])
def test_a_port_that_cannot_be_is_refused(port):
    with pytest.raises(InputError, match=f"--port: expected a port from 0 to 65535, got {port}"):
        find_port("127.0.0.1", port)


@pytest.mark.parametrize("host", ["nowhere.invalid", "a" * 300, "::1", "", "192.0.2.1"])
def test_a_host_that_is_not_this_machine_is_refused(host):
    with pytest.raises(InputError, match="--host: expected an IPv4 address of this machine"):
        find_port(host, 0)


def test_a_port_that_needs_a_permission_is_refused(monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket, "create_server", refuse)
    with pytest.raises(InputError, match="--port: .* to listen at, got 80: Permission denied"):
        find_port("127.0.0.1", 80)


def test_the_next_free_port_is_found():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert find_port("127.0.0.1", port) > port
    assert find_port("127.0.0.1", 0) > 0


def test_ports_that_are_all_taken_are_told():
    with (
        socket.create_server(("127.0.0.1", 65535)),
        pytest.raises(InputError, match="with a free one from it to 65535"),
    ):
        find_port("127.0.0.1", 65535)


def test_only_this_machine_is_listened_to(viewer):
    """Another address of this machine, such as 127.0.0.2, gets no answer."""
    assert viewer.address.startswith("http://127.0.0.1:")
    port = int(viewer.address.rpartition(":")[2])
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", port), timeout=5.0)


def test_moving_a_slider_moves_the_robot_and_the_bending_vector(viewer, session):
    before = drawn(viewer, "/robot/disks")
    viewer._tendons[1].value = 0.5
    after = drawn(viewer, "/robot/disks")
    # the base disk stays (24 sides: 50 vertices a disk), the tip moves towards the tendon at -30 degrees
    np.testing.assert_allclose(after[:50], before[:50], atol=1e-6)
    shift = (after[-50:] - before[-50:]).mean(axis=0)
    assert shift[:2] @ [np.cos(np.deg2rad(-30.0)), np.sin(np.deg2rad(-30.0))] > 0.01
    x, y = (slider.value for slider in viewer._bending)
    assert (x, y) == pytest.approx((0.5 * np.cos(np.deg2rad(-30.0)), 0.5 * np.sin(np.deg2rad(-30.0))))


def test_a_bending_slider_sets_the_tensions_of_least_sum_and_keeps_the_base(viewer, session):
    viewer.move(Controls(np.zeros(3), -0.05, 0.4))
    viewer._bending[1].value = 0.6
    expected = session.scenario.robot.tensions_from_bending([[[0.0, 0.6]]])[0]
    np.testing.assert_allclose(viewer.controls.tensions, expected, atol=1e-9)
    assert viewer.controls.insertion == pytest.approx(-0.05)
    assert viewer.controls.roll == pytest.approx(0.4)


def test_a_contact_is_shown_in_place_and_goes_again(viewer, session):
    look = viewer.move(Controls(BENT, -0.05, 0.0), "constant_curvature")
    contact = look.contacts[0]
    assert f"{contact.part} touches pipe.stl" in viewer._server.scene.get_handle_by_name("/contact/label").text
    assert "touching" in viewer.note
    mesh = session.scene.meshes[0]
    corners = mesh.wall_vertices[mesh.wall_faces[contact.triangle]]
    triangles = drawn(viewer, "/contact/triangles")
    np.testing.assert_allclose(triangles[:3], corners, atol=1e-6)
    # a ball's first vertices are the first contact's
    balls = drawn(viewer, "/contact/points")
    count = len(balls) // len(look.contacts)
    np.testing.assert_allclose(balls[:count].mean(axis=0), contact.point, atol=1e-5)
    parts = drawn(viewer, "/contact/parts")
    assert np.linalg.norm(parts - contact.point, axis=1).min() < 0.006
    viewer.move(Controls(np.zeros(3), -0.05, 0.0))
    assert drawn(viewer, "/contact/parts") is None
    assert "free" in viewer.note


def test_other_models_are_drawn_as_ghosts_with_their_distance(viewer):
    viewer.move(Controls(np.array([0.0, 0.0, 0.3]), -0.05, 0.0), "reference")
    assert drawn(viewer, "/ghost/constant_curvature") is None
    viewer._ghosts["constant_curvature"].value = True
    # 21 disks and the backbone; without loads both shapes are the same arc
    assert len(drawn(viewer, "/ghost/constant_curvature")) > 21 * 50
    assert "tip of the constant curvature shape less than 0.01 mm away" in viewer.note
    viewer.move(viewer.controls, "constant_curvature")
    assert drawn(viewer, "/ghost/constant_curvature") is None


def test_changes_that_pile_up_are_answered_by_the_last(viewer, monkeypatch):
    looks = []
    look = viewer._scene.look
    monkeypatch.setattr(viewer._scene, "look", lambda *a: looks.append(a[0].insertion) or look(*a))
    threads = []
    with viewer._lock:  # while one is being drawn, five more come, each in a thread of its own as viser's do
        for value in (-140.0, -130.0, -120.0, -110.0, -100.0):
            threads.append(threading.Thread(target=setattr, args=(viewer._insertion, "value", value)))
            threads[-1].start()
            while viewer._insertion.value != value or viewer._asked < len(threads):
                time.sleep(0.001)
    for thread in threads:
        thread.join()
    assert looks == [pytest.approx(-0.1)]


def test_back_to_the_start(viewer, session):
    viewer.move(Controls(BENT, 0.0, 1.0))
    viewer.move(viewer._scene.start)
    np.testing.assert_allclose(viewer.controls.tensions, session.scenario.robot.pretensions, atol=1e-12)
    assert viewer.controls.insertion == pytest.approx(-0.15)


def test_without_viser_the_message_says_what_to_install(session, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(InputError, match=r"tdcr-planner\[live\]"):
        live.serve_live(session)
