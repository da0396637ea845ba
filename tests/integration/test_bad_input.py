"""Every fault a user can make on the way from files to a path: a message that names it, and nothing lost."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from tdcr_planner.cli.main import run

ROOT = Path(__file__).resolve().parents[2]

SCENARIO = {
    "format": '"tdcr-scenario/1"',
    "robot": '"robot.toml"',
    "shape_model": '"model.pt"',
    "gravity_m_s2": "[0.0, 0.0, -9.81]",
    "meshes": '[{ file = "box.stl", unit = "mm", role = "obstacle" }]',
    "start": "{ bending_n = [[0.0, 0.0]] }",
    "goal": "{ bending_n = [[1.0, 0.0]] }",
    "planner": "{ time_limit_s = 5.0 }",
}


class Workplace:
    """A folder with a good scenario of the inspection robot, beside a box that it does not touch."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.out = folder / "out"
        self.model = (ROOT / "models/shape/inspection/model.pt").read_bytes()
        box = trimesh.creation.box((100.0, 100.0, 100.0))
        box.apply_translation((300.0, 0.0, 0.0))
        box.export(folder / "box.stl")
        (folder / "model.pt").write_bytes(self.model)
        self.robot = (ROOT / "models/robots/inspection.toml").read_text(encoding="utf-8")
        self.write()

    def write(self, **changes: str | None) -> None:
        """Writes robot and scenario, the latter with some keys replaced or, for None, left out."""
        table = {**SCENARIO, **changes}
        lines = [f"{key} = {value}" for key, value in table.items() if value is not None]
        (self.folder / "scenario.toml").write_text("\n".join(lines))
        (self.folder / "robot.toml").write_text(self.robot)

    def plan(self) -> int:
        return run(["plan", str(self.folder / "scenario.toml"), "--out", str(self.out)])


@pytest.fixture
def workplace(tmp_path: Path) -> Workplace:
    return Workplace(tmp_path)


def change_robot(old: str, new: str) -> Callable[[Workplace], None]:
    def change(place: Workplace) -> None:
        assert old in place.robot
        place.robot = place.robot.replace(old, new)
        place.write()

    return change


def write_scenario(**changes: str | None) -> Callable[[Workplace], None]:
    return lambda place: place.write(**changes)


def write_mesh(content: bytes) -> Callable[[Workplace], None]:
    return lambda place: (place.folder / "box.stl").write_bytes(content) and None


def mesh(**keys: str) -> str:
    entries = {"file": '"box.stl"', "unit": '"mm"', "role": '"obstacle"', **keys}
    return "[{ " + ", ".join(f"{key} = {value}" for key, value in entries.items() if value) + " }]"


def other_model(place: Workplace) -> None:
    (place.folder / "model.pt").write_bytes((ROOT / "models/shape/paper/model.pt").read_bytes())


def truncated_model(place: Workplace) -> None:
    (place.folder / "model.pt").write_bytes(place.model[: len(place.model) // 2])


def no_model(place: Workplace) -> None:
    (place.folder / "model.pt").write_text("not a model")


FAULTS: dict[str, tuple[Callable[[Workplace], None], list[str]]] = {
    "mesh missing": (write_scenario(meshes=mesh(file='"none.stl"')), ["scenario.toml", "meshes[1].file", "none.stl"]),
    "mesh unreadable": (write_mesh(b"\x00\x01garbage"), ["box.stl"]),
    "mesh empty": (write_mesh(b""), ["box.stl"]),
    "mesh without unit": (write_scenario(meshes=mesh(unit="")), ["meshes[1].unit", "missing"]),
    "wrong role": (write_scenario(meshes=mesh(role='"wall"')), ["meshes[1].role", "'cavity' or 'obstacle'", "'wall'"]),
    "unknown key": (write_scenario(gravty="[0, 0, 0]"), ["gravty", "did you mean 'gravity_m_s2'"]),
    "unknown planner": (write_scenario(planner='{ name = "RTT" }'), ["'RTT'", "RRTConnect"]),
    "planner not offered": (write_scenario(planner='{ name = "PRM" }'), ["'PRM'"]),
    "not a number": (write_scenario(gravity_m_s2="[0.0, nan, 0.0]"), ["gravity_m_s2", "finite"]),
    "rows of bending": (
        write_scenario(start="{ bending_n = [[0.0, 0.0], [0.0, 0.0]] }"),
        ["start.bending_n", "1 rows"],
    ),
    "gravity outside the domain": (
        write_scenario(gravity_m_s2="[0.0, 0.0, -25.0]"),
        ["scenario gravity_m_s2: expected at most 10 m/s^2", "got 25 m/s^2; for more, raise [domain] gravity_m_s2"],
    ),
    "tip force outside the domain": (
        write_scenario(tip_force_n="[0.0, 0.3, 0.0]"),
        ["scenario tip_force_n", "0.05", "0.3 N; for"],
    ),
    "model of another robot": (other_model, ["model.pt", "'paper'", "'inspection'"]),
    "truncated model": (truncated_model, ["model.pt", "truncated"]),
    "no model": (no_model, ["model.pt", "no shape model"]),
    "zero-length segment": (
        change_robot("length_m = 0.2", "length_m = 0.0"),
        ["segments[1].length_m", "greater than 0"],
    ),
    "two tendons": (
        change_robot("[90.0, -30.0, 210.0]", "[90.0, -30.0]"),
        ["tendon_angles_deg", "three or more", "got 2"],
    ),
    "zero stiffness": (change_robot("60e9", "0.0"), ["backbone.youngs_modulus_pa", "greater than 0"]),
    "broken TOML": (change_robot("[backbone]", "[backbone"), ["robot.toml", "not valid TOML"]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_and_the_earlier_result_stays(
    fault: str, workplace: Workplace, capsys: pytest.CaptureFixture[str]
) -> None:
    workplace.out.mkdir()
    (workplace.out / "result.json").write_text("the earlier result")
    make, named = FAULTS[fault]
    make(workplace)
    assert workplace.plan() == 2
    error = capsys.readouterr().err
    assert error.count("error: ") == 1
    assert "Traceback" not in error
    for part in named:
        assert part in error, error
    assert [item.name for item in workplace.out.iterdir()] == ["result.json"]
    assert (workplace.out / "result.json").read_text(encoding="utf-8") == "the earlier result"


STATUSES = {
    "goal out of reach": (
        {"goal": "{ tip_position_m = [0.0, 0.0, 0.5] }"},
        "invalid_goal",
        ["nearest"],
    ),
    "goal over the tension limit": (
        {"goal": "{ bending_n = [[4.0, 0.0]] }"},
        "invalid_goal",
        ["tension_limit", "3.5"],
    ),
    "start over the tension limit": (
        {"start": "{ bending_n = [[0.0, 5.0]] }"},
        "invalid_start",
        ["tension_limit", "3.5"],
    ),
    "start in collision": (
        {"meshes": mesh(), "base": "{ position_m = [0.3, 0.0, -0.1] }"},
        "invalid_start",
        ["disk", "box.stl"],
    ),
}


@pytest.mark.parametrize("case", STATUSES)
def test_what_cannot_be_had_is_a_status_in_a_complete_result(
    case: str, workplace: Workplace, capsys: pytest.CaptureFixture[str]
) -> None:
    changes, status, named = STATUSES[case]
    workplace.write(**changes)
    assert workplace.plan() == 1
    content = json.loads((workplace.out / "result.json").read_text(encoding="utf-8"))
    assert content["status"] == status
    assert content["path"] is None
    for part in named:
        assert part in content["message"], content["message"]
    assert f"status:    {status}" in capsys.readouterr().out
    assert len(list(workplace.out.iterdir())) == 5


def test_the_good_scenario_is_good(workplace: Workplace) -> None:
    assert workplace.plan() == 0
