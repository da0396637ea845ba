from __future__ import annotations

import dataclasses
import itertools
import json

import numpy as np
import pytest

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import ConfigurationGoal
from tdcr_planner.planning.planners import search
from tdcr_planner.planning.roadmap import Roadmap, conditions_of
from tdcr_planner.planning.roadmap_build import RoadmapBuilder
from tdcr_planner.planning.roadmap_way import RoadmapConnector
from tdcr_planner.planning.scenario import Scenario, load_scenario

# A post in the way of the tip between bending to one side and to the other.
POST = [[[0.05, -0.02, 0.0], [0.09, 0.02, 0.4]]]
HERE, THERE = np.array([1.5, -1.5]), np.array([1.5, 1.5])


@pytest.fixture
def post(make_setup):
    return make_setup(boxes=POST, planner={"clearance_m": 0.001, "step_m": 0.004})


def build(setup, *, seed=1, vertices=60, first=HERE):
    conditions = conditions_of(setup.scenario, setup.model)
    builder = RoadmapBuilder(setup.edges, conditions=conditions, seed=seed, first=first[None])
    builder.run(vertices=vertices)
    return builder.roadmap()


def fresh_edges(setup):
    return EdgeChecker(setup.checker, setup.scenario.planner.step_m)


def connect(setup, roadmap, start=HERE, goal=THERE, edges=None):
    connector = RoadmapConnector(roadmap)
    goal_states = ConfigurationGoal(setup.checker, goal)
    return connector.connect(edges or fresh_edges(setup), start, goal_states, np.inf), connector


def test_every_motion_of_a_roadmap_keeps_the_clearance_however_finely_it_is_looked_at(post):
    roadmap = build(post)
    assert len(roadmap.rows) == 60
    assert len(roadmap.edges) > 60
    np.testing.assert_array_equal(roadmap.rows[0], HERE)
    along = np.linspace(0.0, 1.0, 40)[:, None]
    for first, second in roadmap.rows[roadmap.edges]:
        positions, rotations, solved = post.checker.world_poses(first + along * (second - first))
        assert solved.all()
        assert post.scene.clearance(positions, rotations).min() >= 0.001


def test_the_seed_decides_the_roadmap(post):
    first, again, other = build(post), build(post), build(post, seed=2)
    np.testing.assert_array_equal(first.rows, again.rows)
    np.testing.assert_array_equal(first.edges, again.edges)
    assert not np.array_equal(first.rows[1:], other.rows[1:])


def test_a_build_goes_on_where_it_ended(post):
    conditions = conditions_of(post.scenario, post.model)
    builder = RoadmapBuilder(post.edges, conditions=conditions, seed=1)
    builder.run(vertices=30)
    before = builder.roadmap()
    builder.run(vertices=60)
    after = builder.roadmap()
    assert (len(before.rows), len(after.rows)) == (30, 60)
    np.testing.assert_array_equal(after.rows[:30], before.rows)
    np.testing.assert_array_equal(after.edges[: len(before.edges)], before.edges)


def test_what_ends_a_build_leaves_what_was_built(post):
    said = []

    def progress(share, remark):
        said.append((share, remark))
        if len(said) == 2:
            raise KeyboardInterrupt

    builder = RoadmapBuilder(post.edges, conditions=conditions_of(post.scenario, post.model), seed=1)
    with pytest.raises(KeyboardInterrupt):
        builder.run(vertices=10_000, progress=progress)
    roadmap = builder.roadmap()
    assert said[1][1] == f"{len(roadmap.rows)} vertices, {len(roadmap.edges)} edges"
    assert 0.0 < said[0][0] < said[1][0] < 1.0
    assert all(fresh_edges(post).check_edge(*roadmap.rows[edge]) for edge in roadmap.edges[-20:])


def test_a_build_needs_an_end(post):
    builder = RoadmapBuilder(post.edges, conditions=conditions_of(post.scenario, post.model), seed=1)
    with pytest.raises(InputError, match="time_limit_s: expected a time, or a number of vertices"):
        builder.run()


def test_a_build_without_anything_valid_ends_empty(make_setup):
    setup = make_setup(boxes=[[[-1.0, -1.0, 0.1], [1.0, 1.0, 0.12]]])
    roadmap = build(setup, first=np.zeros(2))
    assert roadmap.size == {"vertices": 0, "edges": 0}
    assert roadmap.largest_share == 0.0
    assert connect(setup, roadmap)[0] is None


def test_a_way_leads_round_an_obstacle_and_every_edge_of_it_is_valid(post):
    assert not fresh_edges(post).check_edge(HERE, THERE)
    way, connector = connect(post, build(post))
    np.testing.assert_array_equal(way[[0, -1]], [HERE, THERE])
    assert len(way) > 2
    assert fresh_edges(post).path_valid(way)
    assert connector.answers == {"answered": True}


def test_a_way_is_no_longer_than_any_other_through_the_same_vertices(make_setup):
    # Without obstacles every link is valid: the straight way must come out.
    setup = make_setup(planner={"step_m": 0.004})
    way, _ = connect(setup, build(setup, vertices=40))
    np.testing.assert_array_equal(way, [HERE, THERE])


def test_the_nearest_of_several_goal_states_is_taken(post):
    class Two:
        rows = [THERE, np.array([1.4, -1.4])]

    way = RoadmapConnector(build(post)).connect(fresh_edges(post), HERE, Two(), np.inf)
    np.testing.assert_array_equal(way[-1], Two.rows[1])


def test_edges_that_the_query_does_not_pass_are_gone_around(post):
    roadmap = build(post, vertices=150)
    way, _ = connect(post, roadmap)
    middle = way[len(way) // 2]
    post.checker.rule_out(middle, 0.01)
    other, _ = connect(post, roadmap)
    assert other is not None
    assert not any(np.array_equal(row, middle) for row in other)
    assert fresh_edges(post).path_valid(other)


def test_no_way_is_said_and_the_planner_answers(post):
    lonely = build(post, vertices=1)
    way, connector = connect(post, lonely)
    assert way is None
    assert connector.answers == {"answered": False}
    file = post.scenario.file.model_copy(
        update={
            "start": post.scenario.file.start.model_copy(update={"bending_n": (tuple(HERE),)}),
            "goal": post.scenario.goals[0].model_copy(update={"bending_n": (tuple(THERE),)}),
        }
    )
    scenario = Scenario(post.scenario.path, post.scenario.sha256, file, post.scenario.robot)
    answers = {}
    for name, roadmap in (("lonely", lonely), ("whole", build(post))):
        connector = RoadmapConnector(roadmap)
        outcome = search(scenario, post.space, post.checker, connector=connector, time_limit_s=60.0)
        assert outcome.found
        assert fresh_edges(post).path_valid(outcome.rows)
        answers[name] = connector.answers["answered"], outcome.statistics["answered_by"] == "roadmap"
    assert answers == {"lonely": (False, False), "whole": (True, True)}


def test_no_way_is_looked_for_when_the_time_is_over(post):
    roadmap = build(post)
    goal = ConfigurationGoal(post.checker, THERE)
    assert RoadmapConnector(roadmap).connect(fresh_edges(post), HERE, goal, -np.inf) is None


def test_a_saved_roadmap_comes_back_as_it_was(post, tmp_path):
    roadmap = build(post)
    assert roadmap.save(tmp_path / "deep" / "a.npz") == tmp_path / "deep" / "a.npz"
    again = Roadmap.load(tmp_path / "deep" / "a.npz")
    for name in ("rows", "edges", "motion_scale", "components"):
        np.testing.assert_array_equal(getattr(again, name), getattr(roadmap, name))
    assert again.conditions == roadmap.conditions
    assert (again.seed, again.build_s) == (roadmap.seed, roadmap.build_s)
    np.testing.assert_array_equal(connect(post, again)[0], connect(post, roadmap)[0])


def test_a_failed_save_leaves_the_earlier_file(post, tmp_path, monkeypatch):
    roadmap = build(post, vertices=5)
    roadmap.save(tmp_path / "a.npz")
    before = (tmp_path / "a.npz").read_bytes()

    def full(*arguments, **arrays):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(FormatError, match="a.npz: cannot be written: No space"):
        roadmap.save(tmp_path / "a.npz")
    assert [item.name for item in tmp_path.iterdir() if item.suffix == ".npz"] == ["a.npz"]
    assert (tmp_path / "a.npz").read_bytes() == before


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.99])
def test_a_file_cut_short_is_refused(post, tmp_path, share):
    content = build(post, vertices=20).save(tmp_path / "a.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(content[: int(share * len(content))])
    with pytest.raises(FormatError, match="cut.npz: is damaged or no roadmap"):
        Roadmap.load(tmp_path / "cut.npz")


def test_other_files_are_refused(post, tmp_path):
    good = dict(np.load(build(post, vertices=20).save(tmp_path / "a.npz")))
    header = json.loads(str(good["header"]))
    moved = good["rows"].copy()
    moved[3] += 0.1
    for changes, message in (
        ({"rows": moved}, "its content is not what was written"),
        ({"edges": good["edges"][1:]}, "its content is not what was written"),
        ({"header": np.array(json.dumps({**header, "step_m": 1.0}))}, "its content is not what was written"),
        (
            {"header": np.array(json.dumps({**header, "format": "tdcr-roadmap/9"}))},
            "format: is a tdcr-roadmap/9 file, expected tdcr-roadmap/1",
        ),
        ({"header": np.array("[]")}, "header: expected a JSON object"),
        ({"header": np.array("{")}, "header: is not valid JSON"),
    ):
        np.savez(tmp_path / "b.npz", **{**good, **changes})
        with pytest.raises(FormatError, match=message):
            Roadmap.load(tmp_path / "b.npz")
    np.savez(tmp_path / "b.npz", rows=good["rows"])
    np.save(tmp_path / "c.npy", good["rows"])
    for name in ("b.npz", "c.npy"):
        with pytest.raises(FormatError, match="is damaged or no roadmap"):
            Roadmap.load(tmp_path / name)
    with pytest.raises(FormatError, match="no such file"):
        Roadmap.load(tmp_path / "none.npz")


def test_more_clearance_and_a_finer_step_serve_less_and_coarser(post):
    made = conditions_of(post.scenario, post.model)
    for changes, problem in (
        ({}, ""),
        ({"clearance_m": 0.0005}, ""),
        ({"step_m": 0.005}, ""),
        ({"clearance_m": 0.0011}, "clearance_m: 0.001, less than 0.0011"),
        ({"step_m": 0.0039}, "step_m: 0.004, more than 0.0039"),
        ({"model": {**made.model, "sha256": "f" * 64}}, "model.sha256: None, not ffffffffffff"),
        ({"model": {**made.model, "name": "reference"}}, "model.name: constant_curvature, not reference"),
    ):
        assert made.unfit_for(dataclasses.replace(made, **changes)) == problem


def test_what_a_roadmap_was_made_for_is_told_from_what_is_asked(post):
    roadmap = build(post, vertices=5)
    text = post.scenario.path.read_text(encoding="utf-8")
    asked = post.scenario.path.with_name("asked.toml")
    format_line = 'format = "tdcr-scenario/1"'
    for old, new, problem in (
        ("robots/paper.toml", "robots/inspection.toml", "robot.mechanics: "),
        ('unit = "mm"', 'unit = "in"', r"meshes\[1\].unit: mm, not in"),
        (format_line, f"{format_line}\nbase = {{insertion_m = [0.0, 0.1]}}", "base.insertion_m: None, not "),
        (format_line, f"{format_line}\nbase = {{position_m = [0.0, 0.0, 0.1]}}", "base.position_m: "),
        (format_line, f"{format_line}\ngravity_m_s2 = [0.0, 0.0, 1.0]", "gravity_m_s2: "),
        (format_line, f"{format_line}\ntip_force_n = [0.0, 0.0, 0.1]", "tip_force_n: "),
    ):
        assert old in text
        asked.write_text(text.replace(old, new))
        scenario = load_scenario(asked)
        with pytest.raises(InputError, match=f"expected a roadmap that serves the scenario .*one made for {problem}"):
            roadmap.check_fit(conditions_of(scenario, type(post.model)(scenario.robot)))


def test_lengths_and_parts_are_those_of_the_edges(post):
    roadmap = build(post)
    parent = list(range(len(roadmap.rows)))

    def root(vertex):
        while parent[vertex] != vertex:
            vertex = parent[vertex]
        return vertex

    for first, second in roadmap.edges.tolist():
        parent[root(first)] = root(second)
    for first, second in itertools.combinations(range(0, len(parent), 7), 2):
        assert (root(first) == root(second)) == (roadmap.components[first] == roadmap.components[second])
    first, second = roadmap.edges[5]
    length = np.linalg.norm((roadmap.rows[first] - roadmap.rows[second]) * post.checker.motion_scale)
    np.testing.assert_allclose(roadmap.graph[[first, second], [second, first]], length, rtol=1e-12)
