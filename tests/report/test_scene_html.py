import json
import os
import queue
import re
import shutil
import subprocess
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from string import Template
from threading import Thread

import numpy as np
import pytest
import trimesh
from plotly import graph_objects

from tdcr_planner.report.marks import Mark
from tdcr_planner.report.picture import DisplayMesh, gather_picture, gather_scenario_picture
from tdcr_planner.report.scene_figure import build_figure
from tdcr_planner.report.scene_html import MAX_FRAMES, render_html, write_html
from tdcr_planner.report.text import SHORT, plain_text, plotly_text

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1366,768",
)
# Runs before any other script of the page: notes what a console would show as an error, goes through the steps that
# the test asks for, each of which is repeated until it answers true, and reports.
WATCH = """<script>
const faults = [], steps = [$steps], answers = [];
window.addEventListener("error", function (event) { faults.push(event.message); });
window.addEventListener("unhandledrejection", function (event) { faults.push(String(event.reason)); });
console.error = function () { faults.push(Array.from(arguments).join(" ")); };
window.addEventListener("load", function () {
  const timer = window.setInterval(function () {
    const answer = steps.length ? steps[0]() : null;
    if (answer) { steps.shift(); answers.push(answer); }
    if (steps.length && !faults.length) { return; }
    window.clearInterval(timer);
    fetch("report", {method: "POST", body: JSON.stringify({faults: faults, answers: answers})});
  }, 50);
});
</script>"""


@pytest.fixture
def picture(make_result):
    return gather_picture(make_result())


def test_page_is_one_file_that_names_no_other(picture, tmp_path):
    write_html(picture, tmp_path / "path.html")
    assert (tmp_path / "path.html").stat().st_size < 10e6
    text = (tmp_path / "path.html").read_text(encoding="utf-8")
    assert not re.search(r"<script[^>]*\ssrc=|<link[^>]*href=\"(?!data:)|@import", text)
    assert text.count('id="plot"') == 1
    for part in ('id="slider"', 'id="play"', 'id="readout"'):
        assert part in text


def test_titles_and_messages_cannot_break_the_page(picture):
    text = render_html(picture)
    assert '<h1 dir="auto">Pipe &amp; &lt;ball&gt;</h1>' in text
    assert "reached &lt;/script&gt; the goal" in text


def test_figure_holds_scene_robot_both_shapes_and_curves(picture):
    shown = picture.frame_states(MAX_FRAMES)
    figure = build_figure(picture, shown)
    names = {trace.get("name") for trace in figure["data"]}
    assert {"pipe.stl (cavity)", "ball.stl (obstacle)", "tip trace", "start", "goal", "disks"} <= names
    assert {"backbone (reference)", "constant curvature shape", "tendon 1", "tendon 2", "tendon 3"} <= names
    assert len(figure["frames"]) == len(shown) == 12
    walls = [trace for trace in figure["data"] if trace.get("name", "").endswith(("(cavity)", "(obstacle)"))]
    assert len(walls) == 2
    assert all(0.0 < trace["opacity"] < 1.0 for trace in walls)


def test_worst_state_is_drawn_where_it_is(picture):
    traces = build_figure(picture, picture.frame_states(MAX_FRAMES))["data"]
    worst = next(trace for trace in traces if trace.get("name") == "worst state, 0.80 mm")
    points = np.stack([worst[axis] for axis in "xyz"], axis=1)
    pieces = np.split(points, np.flatnonzero(np.isnan(points[:, 0])))
    backbone, *rims = [piece[np.isfinite(piece[:, 0])] for piece in pieces]
    np.testing.assert_allclose(backbone[-1], 1e3 * picture.positions[5, -1], atol=1e-4)
    assert len(rims) == picture.robot.disk_count
    middles = np.array([rim[:-1].mean(axis=0) for rim in rims])  # the last point closes the rim
    np.testing.assert_allclose(middles, 1e3 * picture.positions[5], atol=1e-4)


def test_scene_and_robot_fit_into_their_part_of_the_page(picture):
    layout = build_figure(picture, picture.frame_states(MAX_FRAMES))["layout"]["scene"]
    eye, centre, up = (np.array([layout["camera"][key][a] for a in "xyz"]) for key in ("eye", "center", "up"))
    towards = (eye - centre) / np.linalg.norm(eye - centre)
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    low, high = np.array([layout[f"{axis}axis"]["range"] for axis in "xyz"]).T
    ratio = np.array([layout["aspectratio"][axis] for axis in "xyz"])
    points = 1e3 * np.concatenate([picture.positions.reshape(-1, 3), *(mesh.vertices for mesh in picture.meshes)])
    # plotly puts the middle of the axes at 0 and scales each to its aspect ratio
    local = ((points - 0.5 * (low + high)) / (high - low) * ratio - centre) @ np.stack(
        [right, np.cross(towards, right)]
    ).T
    assert max(np.abs(local[:, 1]).max(), np.abs(local[:, 0]).max() * 590.0 / 840.0) > 0.85
    assert np.abs(local[:, 1]).max() < 1.0  # half the height that a parallel projection shows
    assert np.abs(local[:, 0]).max() < 840.0 / 590.0


def test_axes_of_the_curves_carry_their_units(picture):
    layout = build_figure(picture, picture.frame_states(MAX_FRAMES))["layout"]
    titles = [layout[axis]["title"]["text"] for axis in ("yaxis", "yaxis2", "xaxis2")]
    assert titles == ["mm", "N", "time (s)"]


def test_figure_keeps_to_the_schema_of_plotly(picture, make_scenario):
    # Plotly's own class refuses whatever its schema does not know, and keeps every trace that it accepts.
    for shown in (picture, gather_scenario_picture(make_scenario("two_segment"))):
        figure = build_figure(shown, shown.frame_states(MAX_FRAMES))
        assert len(graph_objects.Figure(figure).data) == len(figure["data"]) > 0


def test_each_frame_shows_its_state(picture):
    shown = picture.frame_states(MAX_FRAMES)
    figure = build_figure(picture, shown)
    for frame, state in zip(figure["frames"], shown, strict=True):
        names = (figure["data"][index].get("name") for index in frame["traces"])
        traces = dict(zip(names, frame["data"], strict=True))
        backbone = traces["backbone (reference)"]
        # mm in single precision
        np.testing.assert_allclose(
            [backbone["x"][-1], backbone["y"][-1], backbone["z"][-1]], 1e3 * picture.positions[state, -1], atol=1e-4
        )
        model = traces["constant curvature shape"]
        np.testing.assert_allclose(model["y"], 1e3 * picture.model_positions[state][:, 1], atol=1e-4)
        cursors = [trace for trace in frame["data"] if trace["type"] == "scatter"]
        assert {value for trace in cursors for value in trace["x"]} == {picture.times[state]}


def test_long_paths_are_thinned_but_keep_first_last_and_worst(make_result):
    short = gather_picture(make_result())
    count = 1000
    pick = np.linspace(0, 11, count).astype(int)
    clearance = np.full(count, 0.002)
    clearance[777] = 0.0007
    long = replace(
        short,
        times=np.linspace(0.0, 50.0, count),
        positions=short.positions[pick],
        rotations=short.rotations[pick],
        clearance=clearance,
    )
    shown = long.frame_states(MAX_FRAMES)
    assert len(shown) <= MAX_FRAMES
    assert {0, 777, count - 1} <= set(shown.tolist())
    assert np.diff(long.times[shown]).max() < 2 * 50.0 / (MAX_FRAMES - 2)


def test_large_meshes_are_thinned(picture):
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    heavy = DisplayMesh("big", "obstacle", np.asarray(ball.vertices), np.asarray(ball.faces))
    text = render_html(replace(picture, meshes=(heavy,)))
    assert len(ball.faces) > 80_000
    assert len(text) < 10e6


def test_scenario_page_has_no_controls(make_scenario):
    text = render_html(gather_scenario_picture(make_scenario("paper")))
    assert "<footer hidden>" in text


@pytest.fixture(scope="session")
def browser():
    found = [path for path in map(shutil.which, BROWSERS) if path]
    if not found:
        reason = f"needs a browser on the PATH: {', '.join(BROWSERS)}"
        if os.environ.get("TDCR_BROWSER_REQUIRED"):
            pytest.fail(reason)
        pytest.skip(reason)
    return found[0]


@pytest.fixture
def visit(browser, tmp_path):
    """Opens a page in a headless browser, goes through steps in it, and returns what the page reported."""

    def run(text, *steps):
        watch = Template(WATCH).substitute(steps=", ".join(f"function () {{ return {step}; }}" for step in steps))
        page = text.replace("<head>", "<head>" + watch, 1).encode()
        reports = queue.Queue()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(200)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.end_headers()
                self.wfile.write(page)

            def do_POST(self):
                reports.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
                self.send_response(204)
                self.end_headers()

            def log_message(self, *args):
                """Keeps the test's output quiet."""

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/"
        command = [browser, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", "--remote-debugging-port=0", address]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            return reports.get(timeout=90)
        finally:
            process.terminate()
            process.wait(timeout=30)
            server.shutdown()
            server.server_close()

    return run


@pytest.mark.browser
def test_page_opens_fits_a_laptop_plays_and_seeks_without_a_fault(picture, visit):
    report = visit(
        render_html(replace(picture, times=picture.times / 6.0)),
        'document.querySelector("#plot .gl-container canvas") && document.getElementById("readout").textContent',
        "[document.documentElement.scrollWidth - innerWidth, document.documentElement.scrollHeight - innerHeight]",
        'document.getElementById("play").click() || document.getElementById("play").textContent',
        'document.getElementById("plot").dataset.shown === "11" && document.getElementById("play").textContent',
        "(function () { const slider = document.getElementById('slider'); slider.value = 5;"
        " slider.dispatchEvent(new Event('input')); return 'moved'; })()",
        'document.getElementById("plot").dataset.shown === "5" && document.getElementById("readout").textContent',
        "document.getElementById('plot')._fullData.filter(t => t.name === 'backbone (reference)')[0].z.slice(-1)[0]",
        "(function () { document.getElementById('play').focus(); document.getElementById('slider').value = 0;"
        " document.getElementById('worst').click(); return document.getElementById('slider').value; })()",
    )
    assert report["faults"] == []
    opened, overflow, playing, ended, _, sought, tip, worst = report["answers"]
    assert opened.startswith("0.00 s · state 0")
    assert max(overflow) <= 0
    assert "Pause" in playing
    assert "Play" in ended
    assert "state 5" in sought
    assert "worst state" in sought
    assert tip == pytest.approx(1e3 * picture.positions[5, -1, 2], abs=1e-4)
    assert worst == "5"


AWKWARD = "a_$REV_$DATE <b>&lt;</b> %{x} \u202e\udcff שלום 😀 " + 30 * "long "


@pytest.mark.browser
def test_names_from_files_are_shown_as_they_are(picture, visit):
    meshes = tuple(replace(mesh, name=AWKWARD) for mesh in picture.meshes)
    marks = (Mark(AWKWARD, np.array([0.0, 0.0, 0.05])),)
    awkward = replace(picture, title=AWKWARD, message=AWKWARD, meshes=meshes, marks=marks, status="no_path")
    report = visit(
        render_html(awkward),
        "document.querySelector('#plot .gl-container canvas') && document.querySelector('h1').textContent",
        "Array.from(document.querySelectorAll('#legend button span')).map(e => e.textContent)",
        "document.querySelectorAll('header b, #legend button b').length + 1",
        "document.getElementById('plot')._fullData.filter(t => t.type === 'mesh3d').map(t => t.name)",
        "document.documentElement.scrollWidth - innerWidth <= 0",
    )
    assert report["faults"] == []
    title, legend, tags, names, fits = report["answers"]
    assert title == plain_text(AWKWARD)
    assert legend[0] == f"{plain_text(AWKWARD, SHORT)} (cavity)"
    assert plain_text(AWKWARD, SHORT) in legend
    assert tags == 1
    assert names[0] == f"{plotly_text(AWKWARD)} (cavity)"
    assert fits


def many_tendons(picture):
    """The same picture with three segments of four tendons, a sleeve and a shaft."""
    robot = picture.robot
    segment = robot.segments[0].model_copy(
        update={"tendon_angles_deg": (0.0, 90.0, 180.0, 270.0), "length_m": robot.length / 3, "disks": 4}
    )
    segments = tuple(segment.model_copy(update={"max_tension_n": limit}) for limit in (9.0, 6.0, 3.0))
    body = robot.body.model_copy(update={"between_disks": "sleeve"})
    robot = robot.model_copy(update={"segments": segments, "body": body})
    file = picture.scenario.file
    base = file.base.model_copy(update={"shaft_radius_m": 0.003})
    file = file.model_copy(update={"base": base})
    scenario = replace(picture.scenario, robot=robot, file=file)
    states, disks = len(picture.times), robot.disk_count
    return replace(
        picture,
        scenario=scenario,
        tensions=np.linspace(0.0, 3.0, states)[:, None] * np.linspace(0.1, 1.0, 12),
        positions=picture.positions[:, :disks],
        rotations=picture.rotations[:, :disks],
        model_positions=None,
    )


def test_sleeve_shaft_and_every_limit_are_drawn(picture):
    full = many_tendons(picture)
    figure = build_figure(full, full.frame_states(MAX_FRAMES))
    names = [trace.get("name") for trace in figure["data"]]
    assert {"sleeve (tested)", "shaft (tested)"} <= set(names)
    limits = [trace["y"][0] for trace in figure["data"] if "limit" in trace.get("hovertemplate", "")]
    assert limits == [3.0, 6.0, 9.0]
    assert figure["layout"]["yaxis2"]["range"][1] > 9.0
    # each frame moves them
    place = names.index("sleeve (tested)")
    for frame in figure["frames"]:
        moved = frame["data"][frame["traces"].index(place)]
        assert len(moved["x"]) == len(figure["data"][place]["x"])
    assert len(graph_objects.Figure(figure).data) == len(figure["data"])


@pytest.mark.browser
def test_legend_is_not_cut_and_axes_do_not_overlap_at_any_width(picture, visit):
    boxes = (
        "(function () { const box = s => Array.from(document.querySelectorAll(s)).map(e => e.getBoundingClientRect());"
        " const legend = box('#legend button'), plot = box('#plot')[0], page = document.body.getBoundingClientRect();"
        " const areas = document.getElementById('plot')._fullLayout, size = areas._size, axis = a => areas[a].domain;"
        " const scene = areas.scene.domain;"
        " return {count: legend.length, right: Math.max(...legend.map(b => b.right)) - page.right,"
        " x: axis('xaxis'), y: axis('yaxis'), x2: axis('xaxis2'), y2: axis('yaxis2'), scene: [scene.x, scene.y],"
        " width: plot.width, captions: box('.annotation').map(b => [b.left, b.top, b.right, b.bottom])}; })()"
    )
    report = visit(
        render_html(many_tendons(picture)),
        f"document.querySelector('#plot .gl-container canvas') && {boxes}",
        "document.body.style.width = '1000px'",
        f"document.querySelector('#plot .main-svg').clientWidth < 1000 && {boxes}",
        "document.body.style.width = '640px'",
        f"document.querySelector('#plot .main-svg').clientWidth < 640 && {boxes}",
    )
    assert report["faults"] == []
    for found in report["answers"][::2]:
        assert found["count"] >= 12 + 6
        assert found["right"] <= 0.5
        for place, (left, top, right, bottom) in enumerate(found["captions"]):
            for other in found["captions"][place + 1 :]:
                assert right <= other[0] or other[2] <= left or bottom <= other[1] + 1 or other[3] <= top + 1
        areas = [(found["x"], found["y"]), (found["x2"], found["y2"]), tuple(found["scene"])]
        for place, (across, along) in enumerate(areas):
            for other_across, other_along in areas[place + 1 :]:
                apart = across[1] <= other_across[0] or other_across[1] <= across[0]
                assert apart or along[1] <= other_along[0] or other_along[1] <= along[0]


@pytest.mark.browser
def test_coordinates_under_the_mouse_are_on_the_surface(make_scenario, visit):
    scenario = gather_scenario_picture(make_scenario("paper"))
    # coarse, so that the vertices are far from the point; about the robot, so that the middle of the view shows it
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    vertices = np.asarray(ball.vertices) + scenario.positions[0].mean(axis=0)
    around = replace(scenario, meshes=(DisplayMesh("ball.stl", "obstacle", vertices, np.asarray(ball.faces)),))
    # moves by a pixel each second until the page has answered
    move = (
        "(function () { const canvas = document.querySelector('#plot .gl-container canvas');"
        " const place = document.getElementById('place'); if (!canvas) { return null; }"
        " if (!place.hidden && place.textContent.includes('ball.stl')) { return place.textContent; }"
        " window.step = (window.step || 0) + 1; if (window.step % 20) { return null; }"
        " const box = canvas.getBoundingClientRect();"
        " const x = box.left + 0.42 * box.width + window.step / 20 % 2, y = box.top + 0.4 * box.height;"
        " canvas.dispatchEvent(new MouseEvent('mousemove', {clientX: x, clientY: y, bubbles: true, view: window}));"
        " return null; })()"
    )
    report = visit(render_html(around), move)
    assert report["faults"] == []
    x, y, z = (1e-3 * float(value) for value in re.findall(r"[xyz] (-?[\d.]+)", report["answers"][0]))
    _, distance, _ = trimesh.proximity.closest_point(trimesh.Trimesh(vertices, ball.faces), [[x, y, z]])
    assert distance[0] < 2e-4  # told to 0.1 mm along each axis


@pytest.mark.browser
def test_page_of_a_scenario_opens_without_a_fault(make_scenario, visit):
    report = visit(
        render_html(gather_scenario_picture(make_scenario("two_segment"))),
        "document.querySelector('#plot .gl-container canvas') && document.getElementById('plot').clientHeight",
        "String(document.querySelector('footer').offsetHeight)",
    )
    assert report["faults"] == []
    assert report["answers"][0] > 300
    assert report["answers"][1] == "0"


@pytest.mark.browser
def test_page_fills_its_window_before_and_after_it_is_resized(picture, visit):
    drawn = (
        "(function () { const plot = document.getElementById('plot'), layer = plot.querySelector('.main-svg'),"
        " scene = plot._fullLayout.scene._scene, shape = scene.glplot.shape;"
        " const matrix = scene.glplot.cameraParams.projection, ratio = plot.layout.scene.aspectratio;"
        " return [plot.clientWidth, plot.clientHeight, layer.clientWidth, layer.clientHeight,"
        " document.querySelector('footer').getBoundingClientRect().bottom - document.body.clientHeight,"
        " matrix[0] * shape[0] / shape[1], matrix[5], ratio.x, plot.layout.meta.right, plot.layout.meta.above,"
        " shape[0] / shape[1]]; })()"
    )
    canvas = "document.querySelector('#plot .gl-container canvas')"
    report = visit(
        render_html(picture),
        f"{canvas} && {drawn}",
        "document.body.style.width = '700px'",
        f"document.querySelector('#plot .main-svg').clientWidth < 700 && {drawn}",
    )
    assert report["faults"] == []
    first = build_figure(picture, picture.frame_states(MAX_FRAMES))["layout"]["scene"]["aspectratio"]["x"]
    for answer in (report["answers"][0], report["answers"][2]):
        width, height, drawn_width, drawn_height, below, across, up, ratio, right, above, aspect = answer
        assert (drawn_width, drawn_height) == (width, height)
        assert abs(below) <= 1.0
        assert (across, up) == pytest.approx((1.0, 1.0), rel=0.02)  # the view is 2 units high and as wide as its shape
        # what must be seen just fills the width or the height
        zoom = ratio / first
        assert max(zoom * above / 2.0, zoom * right / (2.0 * aspect)) == pytest.approx(1.0, rel=0.02)
    assert report["answers"][2][0] < report["answers"][0][0]
