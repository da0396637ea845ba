from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import PlanningSession

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def session(make_scenario: Callable[..., Scenario]) -> PlanningSession:
    return PlanningSession(make_scenario())


def move(scenario: Scenario, folder: Path, **changes: str) -> Path:
    """Copies a scenario and its mesh into another folder, some text of the scenario replaced."""
    folder.mkdir(parents=True)
    text = scenario.path.read_text(encoding="utf-8")
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "scenario.toml").write_text(text)
    shutil.copy(scenario.path.parent / "box.stl", folder)
    return folder / "scenario.toml"


def test_a_scenario_elsewhere_with_the_same_files_is_of_the_same_scene(
    session: PlanningSession, tmp_path: Path
) -> None:
    there = load_scenario(move(session.scenario, tmp_path / "elsewhere"))
    assert session.plan(there).status is PlanStatus.VERIFIED


def test_a_mesh_named_by_another_route_is_the_same_mesh(session: PlanningSession, tmp_path: Path) -> None:
    file = move(session.scenario, tmp_path / "elsewhere", **{"box.stl": "../box.stl"})
    (file.parent / "box.stl").unlink()  # what is left is the session's own file
    assert session.plan(load_scenario(file)).status is PlanStatus.VERIFIED


def test_equal_names_in_another_folder_with_other_content_are_another_scene(
    session: PlanningSession, tmp_path: Path
) -> None:
    file = move(session.scenario, tmp_path / "elsewhere")
    trimesh.creation.box((100.0, 100.0, 300.0)).export(file.parent / "box.stl")
    with pytest.raises(InputError, match=r"expected one in the session's scene, got .*: meshes\[1\]\.sha256: "):
        session.plan(load_scenario(file))


FORMAT = 'format = "tdcr-scenario/1"'


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('unit = "mm"', 'unit = "cm"', r"meshes\[1\]\.unit: mm, not cm"),
        ('role = "obstacle"', 'role = "cavity"', r"meshes\[1\]\.role: obstacle, not cavity"),
        ("robots/paper.toml", "robots/inspection.toml", r"robot\.mechanics: "),
        (FORMAT, f"{FORMAT}\ngravity_m_s2 = [0.0, 0.0, -1.0]", "gravity_m_s2: "),
        (FORMAT, f"{FORMAT}\ntip_force_n = [0.0, 0.0, -0.1]", "tip_force_n: "),
        (FORMAT, f"{FORMAT}\nbase = {{roll_deg = [-90, 90]}}", r"base\.roll_deg: None, not "),
        (FORMAT, f'{FORMAT}\nshape_model = "box.stl"', "shape_model: None, not "),
    ],
    ids=["unit", "role", "robot", "gravity", "tip force", "roll", "shape model"],
)
def test_what_makes_another_scene_is_named(session: PlanningSession, old: str, new: str, place: str) -> None:
    text = session.scenario.path.read_text(encoding="utf-8")
    assert old in text
    other = session.scenario.path.with_name("other.toml")
    other.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=place):
        session.plan(load_scenario(other))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("bending_n = [[1.0, 0.0]]", "bending_n = [[0.0, 1.0]]"),
        ('validity = "constant_curvature"', 'validity = "constant_curvature", clearance_m = 0.002, seed = 7'),
        (FORMAT, f"{FORMAT}\nlimits = {{tension_rate_n_s = 0.1}}"),
        (FORMAT, f"{FORMAT}\ntitle = 'Another'"),
    ],
    ids=["goal", "planner", "rates", "title"],
)
def test_what_does_not_make_another_scene(session: PlanningSession, old: str, new: str) -> None:
    text = session.scenario.path.read_text(encoding="utf-8")
    assert old in text
    other = session.scenario.path.with_name("other.toml")
    other.write_text(text.replace(old, new))
    assert session.plan(load_scenario(other)).status is PlanStatus.VERIFIED


PLATE = """
format = "tdcr-scenario/1"
robot = "{root}/models/robots/inspection.toml"
gravity_m_s2 = [0.0, 0.0, -9.81]
meshes = [{{ file = "plate.stl", unit = "mm", role = "obstacle" }}]
start = {{ bending_n = [[0.0, 0.0]] }}
goal = {{ bending_n = [[0.0, 0.0]], insertion_m = 0.1 }}
planner = {{ time_limit_s = 60.0, validity = "constant_curvature" }}

[base]
position_m = [-0.22, 0.0, 0.0]
quaternion_wxyz = [0.7071067811865476, 0.0, 0.7071067811865476, 0.0]
insertion_m = [0.0, 0.1]
"""


def test_a_repair_whose_search_finds_nothing_is_said_in_the_message(tmp_path: Path) -> None:
    # A plate 25 mm below the axis: without gravity the straight robot of 10 mm radius stays 15 mm above it, in truth
    # its tip hangs more than 30 mm below the axis. In the end the margins that
    # repairs add leave the straight start no room.
    plate = trimesh.creation.box((400.0, 400.0, 10.0))
    plate.apply_translation((0.0, 0.0, -30.0))
    plate.export(tmp_path / "plate.stl")
    (tmp_path / "scenario.toml").write_text(PLATE.format(root=ROOT.as_posix()))
    session = PlanningSession(load_scenario(tmp_path / "scenario.toml"))
    result = session.plan()
    assert result.status is PlanStatus.UNVERIFIED
    assert result.repairs > 1
    assert result.path is not None
    assert result.verification is not None
    assert result.message.startswith(
        "a path was found, but the reference does not confirm it: " + result.verification.message
    )
    empty = "and the last one's search came back empty: the start is not valid: obstacle: "
    said = f"; {result.repairs} repairs were tried, {empty}"
    assert said in result.message


def test_a_roadmap_answers_queries_in_its_scene(session: PlanningSession, tmp_path: Path) -> None:
    roadmap = session.build_roadmap(vertices=40, time_limit_s=120.0, seed=2)
    start = session.scenario.file.start
    row = session.space.row_of(start)
    np.testing.assert_array_equal(roadmap.rows[0], row)
    session.use_roadmap(roadmap.save(tmp_path / "roadmap.npz"))
    result = session.plan()
    assert result.status is PlanStatus.VERIFIED
    assert result.planner["iterations"] == 0
    assert result.planner["roadmap"] == {"vertices": 40, "edges": len(roadmap.edges), "answered": True}
    careful = session.plan(session.scenario.with_planner(clearance_m=0.001))
    assert careful.status is PlanStatus.VERIFIED
    assert careful.planner["answered_by"] != "roadmap"
    assert careful.planner["roadmap"] == {
        "vertices": 40,
        "edges": len(roadmap.edges),
        "answered": False,
        "unfit": "clearance_m: 0.0005, less than 0.001",
    }
    session.use_roadmap(None)
    assert "roadmap" not in session.plan().planner


def test_a_roadmap_for_less_than_the_session_asks_is_refused(session: PlanningSession) -> None:
    roadmap = session.build_roadmap(vertices=5, time_limit_s=120.0)
    for changes in ({"clearance_m": 0.001}, {"step_m": 0.001}, {"validity": "reference"}):
        other = PlanningSession(session.scenario.with_planner(**changes))
        with pytest.raises(InputError, match="roadmap: expected a roadmap that serves the scenario"):
            other.use_roadmap(roadmap)
        assert other.roadmap is None


def test_one_short_build_serves_the_scenarios_of_the_duct() -> None:
    # One robot in one scene, four starts and goals: in through the mouth, round the bend, through the narrowing, out.
    folder = ROOT / "scenes/duct"
    session = PlanningSession(load_scenario(folder / "scenario_weight.toml"))
    session.use_roadmap(session.build_roadmap(vertices=600, time_limit_s=300.0))
    for name in ("weight", "mouth", "sag", "withdraw"):
        result = session.plan(load_scenario(folder / f"scenario_{name}.toml"))
        assert result.status is PlanStatus.VERIFIED, name
        assert result.planner["roadmap"]["answered"], name


def test_a_query_chooses_the_engine_and_the_bound_of_the_model_file(make_scenario, root):
    model_file = str(root / "models/shape/paper/published.pt")
    scenario = make_scenario(shape_model=model_file, planner={"validity": "learned", "error_bound": "uniform"})
    session = PlanningSession(scenario)
    model = session.model("learned")
    assert not model.bound_follows_state
    by_state = session.checker(scenario.with_planner(error_bound="state"))
    assert model.bound_follows_state
    # What the uniform bound of 3.05 mm keeps, states keep by themselves: their own bound, and less.
    shapes = by_state.shapes(np.zeros((1, session.space.dimension)))
    assert by_state.scene_for(shapes).body.margins[-1] < session.checker().scene.body.margins[-1]
    with pytest.raises(InputError, match="torchscript"):
        session.checker(scenario.with_planner(shape_engine="onnx"))
