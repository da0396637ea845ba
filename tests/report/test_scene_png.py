import matplotlib
import numpy as np
from matplotlib.image import imread

from tdcr_planner.report import plots
from tdcr_planner.report.picture import gather_picture, gather_scenario_picture
from tdcr_planner.report.scene_png import HEIGHT_PX, SCENE_PX, WIDTH_PX, draw_figure, summary_line, write_png


def _near(image, colour, tolerance=0.08):
    """Share of the pixels whose colour is within a tolerance of another one."""
    wanted = np.array(matplotlib.colors.to_rgb(colour))
    return float((np.abs(image[..., :3] - wanted).max(axis=-1) < tolerance).mean())


def test_picture_of_a_path_shows_scene_robot_and_curves(make_result, tmp_path):
    write_png(gather_picture(make_result()), tmp_path / "path.png")
    image = imread(tmp_path / "path.png")
    assert image.shape[:2] == (HEIGHT_PX, WIDTH_PX)
    scene = image[-SCENE_PX[1] :, : SCENE_PX[0]]
    side = image[-SCENE_PX[1] :, SCENE_PX[0] :]
    assert 0.03 < (scene[..., :3].min(axis=-1) < 0.97).mean() < 0.9  # neither blank nor covered
    red, green, blue = scene[..., 0], scene[..., 1], scene[..., 2]
    assert ((blue > red + 0.25) & (blue > green + 0.1)).mean() > 0.002  # the robot is the only thing so blue
    assert _near(side, plots.ALERT) > 1e-4
    assert _near(side, plots.PALETTE["blue"]) > 1e-3


def test_picture_without_a_path_shows_the_start(make_result, tmp_path):
    picture = gather_picture(make_result(found=False))
    assert not picture.has_path
    assert picture.known.all()
    write_png(picture, tmp_path / "path.png")
    image = imread(tmp_path / "path.png")
    red, blue = image[..., 0], image[..., 2]
    assert (blue > red + 0.25).mean() > 0.002


def test_picture_of_a_scenario(make_scenario, tmp_path):
    picture = gather_scenario_picture(make_scenario("two_segment"))
    write_png(picture, tmp_path / "scenario.png")
    assert imread(tmp_path / "scenario.png").std() > 0.02


def test_states_without_a_shape_are_left_out(make_result, tmp_path):
    result = make_result()
    result.verification.positions[4:] = np.nan
    picture = gather_picture(result)
    assert picture.known.sum() == 4
    write_png(picture, tmp_path / "path.png")
    result.verification.positions[:] = np.nan
    write_png(gather_picture(result), tmp_path / "none.png")
    assert imread(tmp_path / "none.png").std() > 0.02


def test_drawing_leaves_no_global_state(make_result):
    before = dict(matplotlib.rcParams)
    with plots.plot_style():
        draw_figure(gather_picture(make_result(found=False)))
    assert dict(matplotlib.rcParams) == before
    from matplotlib import _pylab_helpers

    assert not _pylab_helpers.Gcf.figs


def test_same_picture_same_bytes(make_result, tmp_path):
    picture = gather_picture(make_result())
    write_png(picture, tmp_path / "a.png")
    write_png(picture, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_summary_names_the_worst_values(make_result):
    line = summary_line(gather_picture(make_result()))
    assert "least clearance 0.80 mm" in line  # 2 - 1.2 sin(pi / 2) at state 5
    assert "within 1 mm" in line
