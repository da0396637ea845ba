import threading
import webbrowser

import numpy as np
import pytest
import trimesh

from tdcr_planner.cli.main import run
from tdcr_planner.cli.view import view
from tdcr_planner.errors import FormatError
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.report.picture import gather_scenario_picture, with_start_checked
from tdcr_planner.report.results import write_result
from tdcr_planner.report.scene_figure import build_figure


@pytest.fixture
def opened(monkeypatch):
    """Pages that a pretended browser was asked to open."""
    pages = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(webbrowser, "open", lambda address: pages.append(address) or True)
    return pages


def test_view_of_a_result_opens_the_page_beside_it(make_result, tmp_path, opened, capsys):
    file = write_result(make_result(), tmp_path / "out")
    file.with_name("path.html").unlink()
    assert view(file) == 0
    assert opened == [file.with_name("path.html").as_uri()]
    assert capsys.readouterr().out.strip() == str(file.with_name("path.html"))
    assert "Plotly" in file.with_name("path.html").read_text(encoding="utf-8")


def test_view_of_a_scenario_writes_where_it_is_told(make_scenario, tmp_path, opened):
    page = tmp_path / "deep" / "look.html"
    assert view(make_scenario("paper").path, out=page, open_browser=False) == 0
    assert page.stat().st_size > 1e6
    assert opened == []


def test_view_of_a_scenario_says_that_the_start_is_valid(make_scenario, tmp_path, capsys):
    scenario = make_scenario("paper")
    page = tmp_path / "look.html"
    assert view(scenario.path, out=page, open_browser=False) == 0
    written, start = capsys.readouterr().out.splitlines()
    assert written == str(page)
    # straight along the axis of a pipe of 48 sides and 14 mm radius
    widest = 1e3 * scenario.robot.disk_radii.max()
    assert start == f"start: valid, clearance {14.0 * np.cos(np.pi / 48) - widest:.1f} mm"
    assert start in page.read_text(encoding="utf-8")


def test_view_of_a_scenario_names_and_marks_what_the_start_touches(make_scenario, tmp_path, capsys):
    scenario = make_scenario("paper")
    ball = scenario.path.with_name("ball.stl")
    mesh = trimesh.load_mesh(ball)
    mesh.apply_translation([-35.0, -5.0, 0.5e3 * scenario.robot.length - 150.0 - 120.0 + 60.0])
    mesh.export(ball)
    assert view(scenario.path, out=tmp_path / "look.html", open_browser=False) == 0
    start = capsys.readouterr().out.splitlines()[1]
    assert start.startswith("start: not valid, obstacle: ")
    assert "touches ball.stl" in start
    marked = with_start_checked(gather_scenario_picture(load_scenario(scenario.path)))
    _, distance, _ = trimesh.proximity.closest_point(mesh, 1e3 * marked.contact[None])
    # within what the body and the ball have in common
    assert distance[0] < 1e3 * scenario.robot.disk_radii.max()
    names = [trace.get("name") for trace in build_figure(marked, marked.frame_states(1))["data"]]
    assert "contact of the start" in names


def test_view_shows_a_scene_whose_start_cannot_be_checked(make_scenario, tmp_path, monkeypatch, capsys):
    def refuse(scenario):
        raise FormatError(scenario.path, "no model for these loads")

    monkeypatch.setattr("tdcr_planner.query.session.PlanningSession", refuse)
    assert view(make_scenario("paper").path, out=tmp_path / "look.html", open_browser=False) == 0
    assert "start: not checked" in capsys.readouterr().out
    assert "no model for these loads" in (tmp_path / "look.html").read_text(encoding="utf-8")


def test_view_of_a_scenario_writes_into_the_current_folder(make_scenario, tmp_path, monkeypatch, opened):
    monkeypatch.chdir(tmp_path)
    assert view(make_scenario("paper").path) == 0
    assert opened == [(tmp_path / "scenario_pipe.html").as_uri()]


def test_view_exports_besides(make_result, tmp_path, opened, capsys):
    file = write_result(make_result(), tmp_path / "out")
    targets = (tmp_path / "a.glb", tmp_path / "deep" / "a.json")
    assert view(file.parent, export=targets, open_browser=False) == 0
    assert all(target.stat().st_size > 1000 for target in targets)
    assert capsys.readouterr().out.splitlines() == [str(path) for path in (file.with_name("path.html"), *targets)]


@pytest.mark.parametrize("reason", ["no display", "no browser"])
def test_without_a_browser_the_page_stays(make_scenario, tmp_path, monkeypatch, capsys, reason):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    if reason == "no browser":
        monkeypatch.setenv("DISPLAY", ":0")

        def fail(address):
            raise webbrowser.Error("could not locate runnable browser")

        monkeypatch.setattr(webbrowser, "open", fail)
    page = tmp_path / "page.html"
    assert view(make_scenario("paper").path, out=page) == 1
    assert page.exists()
    assert "no browser could be opened" in capsys.readouterr().err


def test_what_is_no_result_is_refused(tmp_path):
    (tmp_path / "mesh.stl").write_text("")
    with pytest.raises(FormatError, match="expected a result"):
        view(tmp_path / "mesh.stl")
    with pytest.raises(FormatError, match="no such file"):
        view(tmp_path / "result.json")


def test_an_export_that_no_writer_has_is_refused_before_anything_is_written(make_scenario, tmp_path, capsys):
    page, scenario = tmp_path / "out" / "page.html", make_scenario("paper").path
    command = ["view", str(scenario), "--out", str(page), "--no-open-browser", "--export", str(tmp_path / "x.stp")]
    assert run(command) == 2
    assert capsys.readouterr().err.startswith("error: --export: expected a name that ends in .png, .glb, .gif, .mp4 (a")
    assert not page.parent.exists()


def test_an_output_folder_that_is_a_file_is_refused(make_scenario, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="cannot be written"):
        view(make_scenario("paper").path, out=tmp_path / "file" / "page.html")


def test_the_live_viewer_runs_until_it_is_interrupted(make_scenario, monkeypatch, opened, capsys):
    wait = threading.Event.wait

    def interrupt(self, timeout=None):
        if threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt
        return wait(self, timeout)

    stopped = []

    class Viewer:
        address = "http://127.0.0.1:8099"

        def stop(self):
            stopped.append(True)

    def serve(session, port, host):
        assert (port, host) == (8099, "127.0.0.1")
        assert session.scenario.file.title == "Pipe & <ball>"
        return Viewer()

    monkeypatch.setattr("tdcr_planner.report.live.serve_live", serve)
    monkeypatch.setattr("tdcr_planner.report.live.find_port", lambda _, port: port)
    monkeypatch.setattr("threading.Event.wait", interrupt)
    assert view(make_scenario("paper").path, live=True, port=8099) == 0
    assert opened == ["http://127.0.0.1:8099"]
    assert stopped == [True]
    assert "Ctrl-C ends it" in capsys.readouterr().out


def test_an_export_that_fails_costs_no_other_file(make_result, tmp_path, monkeypatch, capsys, caplog):
    def fail(picture, file):
        raise ValueError("no such colour")

    monkeypatch.setattr("tdcr_planner.report.export.write_glb", fail)
    file = write_result(make_result(), tmp_path / "out")
    exports = tuple(tmp_path / name for name in ("a.glb", "b.csv"))
    assert view(file, export=exports, open_browser=False) == 1
    assert not exports[0].exists()
    assert exports[1].stat().st_size > 0
    assert capsys.readouterr().out.splitlines() == [str(file.with_name("path.html")), str(exports[1])]
    assert f"{exports[0]} is not drawn: ValueError: no such colour" in caplog.text


def test_the_verdict_on_a_start_is_told_though_its_page_fails(make_scenario, tmp_path, monkeypatch, capsys, caplog):
    def fail(picture, file):
        raise ValueError("no such colour")

    monkeypatch.setattr("tdcr_planner.report.scene_html.write_html", fail)
    scenario = make_scenario("paper")
    assert view(scenario.path, out=tmp_path / "look.html", open_browser=False) == 1
    assert capsys.readouterr().out.startswith("start: valid")
    assert "look.html is not drawn" in caplog.text
