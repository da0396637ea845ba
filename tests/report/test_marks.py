from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.collision.scene import Contact, Verdict
from tdcr_planner.errors import FormatError
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.report.marks import Mark, contact_marks, marks_of
from tdcr_planner.report.picture import gather_picture
from tdcr_planner.report.results import read_result, write_result_data
from tdcr_planner.report.scene_figure import build_figure
from tdcr_planner.report.scene_png import write_png

coordinate = st.floats(-10.0, 10.0)
part = st.one_of(st.integers(1, 99).map("disk {}".format), st.integers(1, 99).map("gap {}".format), st.just("shaft"))


@given(
    st.sampled_from(["wall.stl", "a (2).stl", "at (x).stl", "wand_$ä.stl", "two\nlines.stl"]),
    part,
    st.sampled_from([(Verdict.OBSTACLE, 5), (Verdict.CAVITY, 0), (Verdict.OBSTACLE, -1), (Verdict.CAVITY, -1)]),
    st.tuples(coordinate, coordinate, coordinate),
)
def test_a_contact_in_a_message_is_marked_where_it_is(mesh, part, verdict, point):
    contact = Contact(mesh, part, verdict[1], np.array(point), verdict[0])
    (mark,) = contact_marks(f"the start is not valid: obstacle: {contact}", at_start=True)
    assert mark.part == part
    np.testing.assert_allclose(mark.point, point, atol=6e-6)  # messages have 0.01 mm


@given(st.integers(1, 40), st.integers(50, 90), st.tuples(coordinate, coordinate, coordinate))
def test_a_self_contact_marks_both_parts(one, other, point):
    contact = Contact("robot", f"gap {one} and disk {other}", -1, np.array(point), Verdict.SELF)
    (mark,) = contact_marks(str(contact), at_start=True)
    assert mark.part == f"gap {one} and disk {other}"


@pytest.mark.parametrize("message", ["", "no path in 10 s", "the tip is at (0.1, 0.2, 0.3) m", "disk 3 is tired"])
def test_a_message_without_a_contact_marks_nothing(message):
    assert contact_marks(message) == ()


@pytest.fixture
def failed(make_result):
    """A result without a path whose message tells a contact."""

    def make(status):
        contact = Contact("pipe.stl", "disk 7", 3, np.array([0.01, 0.0, 0.02]), Verdict.CAVITY)
        return replace(make_result(found=False), status=status, message=f"the start is not valid: {contact}")

    return make


@pytest.mark.parametrize("status", [PlanStatus.INVALID_START, PlanStatus.INVALID_GOAL, PlanStatus.NO_PATH])
def test_a_failure_picture_marks_the_contact(failed, status, tmp_path):
    picture = gather_picture(failed(status))
    np.testing.assert_allclose(picture.contact, [0.01, 0.0, 0.02])
    labels = [trace["meta"]["label"] for trace in build_figure(picture, picture.frame_states(1))["data"]]
    name = "contact of the start" if status is PlanStatus.INVALID_START else "contact of disk 7"
    # the start's own part is highlighted; which state of a search touched is not known
    assert labels.count(name) == (2 if status is PlanStatus.INVALID_START else 1)
    write_png(picture, tmp_path / "path.png")


def test_an_unverified_path_shows_the_state_that_fails(make_result, tmp_path):
    result = make_result()
    report = replace(result.verification, verified=False, cause="clearance", worst_state=2)
    result = replace(result, status=PlanStatus.UNVERIFIED, verification=report)
    picture = gather_picture(result)
    assert picture.worst_state == 2
    assert picture.worst_label.startswith("failing state (clearance), 1.")
    report.positions[2:] = np.nan  # no stable shape from there on
    picture = gather_picture(result)
    assert picture.worst_state == 1
    names = [trace.get("name") for trace in build_figure(picture, picture.frame_states(8))["data"]]
    assert picture.worst_label in names
    write_png(picture, tmp_path / "path.png")


def test_a_result_carries_marks_through_its_file(make_result, tmp_path):
    bent = {"label": "retracted to here", "bending_n": [[0.3, 0.0]], "insertion_m": -0.1, "part": "disk 20"}
    place = {"label": "stuck <b>here</b>", "point_m": [0.0, 0.0, 0.05]}
    result = replace(make_result(), planner={"name": "RRTConnect", "marks": [bent, place]})
    again = read_result(write_result_data(result, tmp_path))
    first, second = marks_of(again)
    assert (first.label, first.part, first.point) == ("retracted to here", "disk 20", None)
    assert first.positions.shape == (result.scenario.robot.disk_count, 3)
    np.testing.assert_array_equal(second.point, [0.0, 0.0, 0.05])
    picture = gather_picture(again, [Mark("of the caller", np.zeros(3))])
    assert [mark.label for mark in picture.marks] == ["of the caller", first.label, second.label]
    entries = [
        trace["meta"]["label"] for trace in build_figure(picture, picture.frame_states(4))["data"] if "meta" in trace
    ]
    assert entries.count("retracted to here") == 2  # its outline and its part
    assert "stuck <b>here</b>" in entries
    write_png(picture, tmp_path / "path.png")


def test_a_mark_of_another_form_is_refused(make_result):
    result = replace(make_result(), planner={"marks": [{"label": "x", "colour": "red"}]})
    with pytest.raises(FormatError, match="colour: unknown key"):
        marks_of(result)
