import pytest
from matplotlib.text import Text

from tdcr_planner.report import plots
from tdcr_planner.report.tendon_style import (
    describe_limits,
    limit_labels,
    tendon_colour,
    tendon_dash,
    tension_limits,
)


@pytest.fixture
def make_robot(two_segment_robot):
    """A robot of segments with so many tendons each and these limits."""

    def make(tendons, limits):
        segment = two_segment_robot.segments[0]
        angles = tuple(360.0 * index / tendons for index in range(tendons))
        segments = [
            segment.model_copy(update={"tendon_angles_deg": angles, "max_tension_n": limit}) for limit in limits
        ]
        return two_segment_robot.model_copy(update={"segments": tuple(segments)})

    return make


@pytest.mark.parametrize(("tendons", "segments"), [(3, 20), (4, 20), (5, 7), (6, 7), (8, 7)])
def test_no_two_tendons_look_the_same(tendons, segments):
    looks = {(tendon_colour(i), tendon_dash(i // tendons)) for i in range(tendons * segments)}
    assert len(looks) == tendons * segments


def test_twelve_tendons_have_twelve_colours():
    assert len({tendon_colour(index) for index in range(12)}) == 12


def test_every_different_limit_is_told_with_its_segments(make_robot):
    robot = make_robot(3, (20.0, 15.0, 10.0, 15.0))
    limits = tension_limits(robot)
    assert [(limit.newton, limit.segments) for limit in limits] == [(10.0, (3,)), (15.0, (2, 4)), (20.0, (1,))]
    assert [describe_limits([limit], robot) for limit in limits] == [
        "limit 10 N, segment 3",
        "limit 15 N, segments 2, 4",
        "limit 20 N, segment 1",
    ]
    same = make_robot(3, (8.0, 8.0))
    assert [describe_limits([limit], same) for limit in tension_limits(same)] == ["limit 8 N"]


def test_limits_near_each_other_share_a_label(make_robot):
    labels = limit_labels(make_robot(3, (20.0, 19.5, 10.0)), 1.0)
    assert labels == [(10.0, "limit 10 N, segment 3"), (20.0, "limits 19.5 to 20 N, segments 1 to 2")]


@pytest.mark.parametrize(("tendons", "segments"), [(3, 1), (3, 3), (4, 3), (4, 8), (3, 16)])
def test_legend_shows_every_tendon_within_the_figure_and_every_limit_has_a_line(make_robot, random, tendons, segments):
    robot = make_robot(tendons, [20.0 - index for index in range(segments)])
    times = [0.0, 1.0]
    tensions = random.uniform(0.0, 5.0, (2, robot.tendon_count))
    with plots.plot_style():
        figure = plots.new_figure(1600, 900, 120)
        axes = figure.add_axes((0.69, 0.085, 0.29, 0.365))
        plots.draw_tensions(axes, times, tensions, robot)
        figure.canvas.draw()
        legend = axes.get_legend()
        names = [text.get_text() for text in legend.get_texts()]
        box = legend.get_window_extent()
        title = next(text for text in axes.findobj(Text) if text.get_text() == "Tendon tensions").get_window_extent()
    assert {str(index + 1) for index in range(robot.tendon_count)} <= set(names)
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
    assert box.y0 >= axes.bbox.y1 - 1.0  # above the curves
    assert title.y0 >= box.y1 - 1.0  # and below the title
    heights = {line.get_ydata()[0] for line in axes.lines if len(set(line.get_ydata())) == 1}
    assert {limit.newton for limit in tension_limits(robot)} <= heights
    assert axes.get_ylim()[1] > 20.0
