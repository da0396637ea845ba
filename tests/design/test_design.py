from __future__ import annotations

import csv
import json
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import pytest
import trimesh

from tdcr_planner.cli.main import run
from tdcr_planner.design.search import STORAGE, run_study
from tdcr_planner.design.study import Parameter, load_study
from tdcr_planner.design.trial import TrialJob, run_trial
from tdcr_planner.design.variants import apply, base_tables
from tdcr_planner.errors import FormatError
from tdcr_planner.workers import Outcome

ROBOTS = Path(__file__).resolve().parents[2] / "models/robots"
SCENARIO = f"""format = "tdcr-scenario/1"
robot = "{ROBOTS / "inspection_camera.toml"}"
meshes = [{{file = "plate.stl", unit = "m", role = "obstacle"}}]
[base]
insertion_m = [0.0, 0.05]
[start]
bending_n = [[0.0, 0.0]]
[planner]
validity = "constant_curvature"
[inspect]
surfaces = ["plate.stl"]
spacing_m = 0.02
"""
LENGTH = '[[parameters]]\nkeys = ["segments[1].length_m"]\nlow = 0.15\nhigh = 0.25\n'
STUDY = 'format = "tdcr-study/1"\nscenario = "scenario.toml"\ntrials = 4\nsearch_s = 0.2\nconfirm = 0\n'


@pytest.fixture
def write_study(tmp_path: Path) -> Callable[[str], Path]:
    """Returns a function that writes a study of the robot before a plate and gives its path."""
    plate = trimesh.creation.box(extents=(0.2, 0.2, 0.01))
    plate.apply_translation((0.0, 0.0, 0.29))
    plate.export(tmp_path / "plate.stl")
    (tmp_path / "scenario.toml").write_text(SCENARIO)

    def write(text: str = STUDY + LENGTH) -> Path:
        file = tmp_path / "study.toml"
        file.write_text(text)
        return file

    return write


def here(
    function: Callable[[Any], Any], jobs: Sequence[Any], *, groups: Any = None, time_limit_s: float | None = None
) -> Generator[Outcome, None, None]:
    """A backend that runs jobs in this process."""
    for index, job in enumerate(jobs):
        yield Outcome(index, function(job))


def parameter(**keys: Any) -> Parameter:
    return Parameter(**{"low": 0.0, "high": 1.0, **keys})


def test_numbers_go_where_their_keys_say(write_study: Callable[..., Path]) -> None:
    tables = base_tables(write_study().with_name("scenario.toml"))
    parameters = [
        parameter(keys=("segments[1].length_m",), name="length"),
        parameter(keys=("tendons[*].radius_m", "body.tendon_radius_m"), name="radius"),
        parameter(keys=("camera.tilt_deg",), name="tilt"),
        parameter(keys=("scenario.base.insertion_m[2]",), name="travel"),
    ]
    values = {"length": 0.21, "radius": 0.005, "tilt": 90.0, "travel": 0.08}
    robot, scenario = apply(tables, values, parameters)
    assert robot["segments"][0]["length_m"] == 0.21
    assert [tendon["radius_m"] for tendon in robot["tendons"]] == [0.005] * 3
    assert robot["body"]["tendon_radius_m"] == 0.005
    assert robot["camera"]["direction"] == pytest.approx([1.0, 0.0, 0.0])
    assert scenario["base"]["insertion_m"] == [0.0, 0.08]
    assert tables[0]["segments"][0]["length_m"] == 0.2


def test_segments_are_repeated_with_their_tendons(write_study: Callable[..., Path]) -> None:
    tables = base_tables(write_study().with_name("scenario.toml"))
    number = parameter(keys=("segment_count",), low=1, high=3, whole=True)
    robot, _ = apply(tables, {"segment_count": 2}, [number])
    assert len(robot["segments"]) == 2
    assert [tendon["segment"] for tendon in robot["tendons"]] == [1, 1, 1, 2, 2, 2]


def test_a_study_goes_on_where_it_was_ended(write_study: Callable[..., Path], tmp_path: Path) -> None:
    study = load_study(write_study())
    calls: list[int] = []

    def stops(function: Any, jobs: Sequence[Any], **_: Any) -> Generator[Outcome, None, None]:
        for index, job in enumerate(jobs):
            calls.append(job.number)
            if len(calls) == 3:
                raise KeyboardInterrupt
            yield Outcome(index, {"values": {"coverage": 0.1 * job.number}})

    first = run_study(study, tmp_path / "out", stops)
    assert first.interrupted == "interrupted"
    assert len(first.designs) == 2
    second = run_study(study, tmp_path / "out", stops)
    assert (second.resumed, len(second.designs), second.complete) == (2, 4, True)
    assert second.best == (max(design.number for design in second.designs),)
    assert (tmp_path / "out" / STORAGE).exists()


def test_an_invalid_design_is_a_failed_trial_with_its_reason(write_study: Callable[..., Path], tmp_path: Path) -> None:
    wide = '[[parameters]]\nkeys = ["tendons[*].radius_m"]\nname = "circle"\nlow = 0.005\nhigh = 0.02\n'
    file = write_study(STUDY + wide)
    record = run_trial(TrialJob(str(file), 1, {"circle": 0.018}, str(tmp_path / "design")))
    assert "disk_radius_m" in record["reason"]
    good = run_trial(TrialJob(str(file), 2, {"circle": 0.008}, str(tmp_path / "design")))
    assert 0.0 < good["values"]["coverage"] <= 1.0


def test_a_design_beyond_a_limit_is_a_failed_trial(write_study: Callable[..., Path], tmp_path: Path) -> None:
    file = write_study(STUDY + LENGTH + '[[limits]]\nof = "length_m"\nmost = 0.2\n')
    record = run_trial(TrialJob(str(file), 1, {"segments[1].length_m": 0.24}, str(tmp_path / "design")))
    assert record["reason"] == "length_m of 0.24 is above the limit 0.2"


def test_the_outcome_is_told_in_files(write_study: Callable[..., Path], tmp_path: Path) -> None:
    from tdcr_planner.report.design_results import draw_design, write_design_data

    study = load_study(write_study())
    outcome = run_study(study, tmp_path / "out", here)
    write_design_data(outcome, tmp_path / "out", {})
    assert draw_design(outcome, tmp_path / "out") == ["design.png"]
    content = json.loads((tmp_path / "out/design.json").read_text(encoding="utf-8"))
    assert content["trials"] == 4
    with (tmp_path / "out/design.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4
    best = max(rows, key=lambda row: float(row["coverage"] or 0.0))
    assert best["best"] == "yes"
    assert (tmp_path / "out/best_1/robot.toml").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (STUDY, r"one or more \[\[parameters\]\]"),
        (STUDY + "parameters = []\n", r"one or more \[\[parameters\]\]"),
        (STUDY + LENGTH.replace("length_m", "lenght_m"), "did you mean 'length_m'"),
        (STUDY + LENGTH.replace("[1]", "[3]"), "from 1 to 1"),
        (STUDY + LENGTH.replace("high = 0.25", "high = 0.1"), "low below high"),
        (STUDY + 'measures = ["success"]\n' + LENGTH, "scenarios"),
        (STUDY.replace("scenario.toml", "none.toml") + LENGTH, "no such file"),
        (STUDY + LENGTH + '[[limits]]\nof = "size"\n', "no measure"),
    ],
)
def test_bad_studies_are_refused(
    write_study: Callable[..., Path], text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_study(text)
    with pytest.raises(FormatError, match=words):
        load_study(file)
    assert run(["design", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "study.toml" in capsys.readouterr().err


def test_a_folder_of_another_study_is_refused(write_study: Callable[..., Path], tmp_path: Path) -> None:
    run_study(load_study(write_study()), tmp_path / "out", here)
    with pytest.raises(FormatError, match="holds another study"):
        run_study(load_study(write_study(STUDY + LENGTH + "# other\n")), tmp_path / "out", here)
