"""What `fuzz.py` damages: the whole files, the commands that read each kind, and the options."""

from __future__ import annotations

import contextlib
import csv
import json
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import tyro
from fuzz_inputs import (
    ANY,
    REFUSED,
    Change,
    Random,
    change_arrays,
    change_table,
    change_text,
    damage,
    lying_npz,
    npz_bytes,
    replace_records,
    write_json,
    write_toml,
)

from tdcr_planner.cli.commands import COMMANDS
from tdcr_planner.cli.main import run
from tdcr_planner.learning.checkpoint import load_checkpoint, save_checkpoint
from tdcr_planner.learning.dataset import draw_cases
from tdcr_planner.learning.measured import read_measured_shapes
from tdcr_planner.learning.settings import TrainSettings, load_train_settings
from tdcr_planner.learning.train import TrainingData, _Run
from tdcr_planner.planning import roadmap as roadmap_file
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.planning.scene import load_scene_meshes
from tdcr_planner.robot import load_robot
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.shape.shooting_network import ShootingNetwork
from tdcr_planner.sweep.journal import JOURNAL_NAME, open_journal
from tdcr_planner.sweep.suite import load_suite

ROOT = Path(__file__).resolve().parents[1]
MESHES = ("stl", "obj", "ply", "off", "glb")

SCENARIO = {
    "format": "tdcr-scenario/1",
    "robot": "robot.toml",
    "shape_model": "model.pt",
    "title": "a box",
    "gravity_m_s2": [0.0, 0.0, -9.0],
    "meshes": [{"file": "box.stl", "unit": "mm", "role": "obstacle"}],
    "base": {"position_m": [0.0, 0.0, 0.0], "insertion_m": [0.0, 0.05]},
    "start": {"bending_n": [[0.0, 0.0]], "insertion_m": 0.0},
    "goal": {"bending_n": [[0.4, 0.0]], "insertion_m": 0.01},
    "planner": {"name": "RRTConnect", "time_limit_s": 5.0, "seed": 1, "step_m": 0.004, "validity": "learned"},
    "limits": {"tension_rate_n_s": 1.0},
}
SUITE = {
    "format": "tdcr-suite/1",
    "scenarios": [{"file": "scenario.toml", "difficulty": "easy"}],
    "planners": ["RRTConnect", "RRT"],
    "models": ["learned"],
    "seeds": [1, 2, 3],
    "time_limit_s": 2.0,
}
TRAIN = {
    "format": "tdcr-train/1",
    "network": "shooting",
    "seed": 1,
    "domain": {"gravity_m_s2": 9.81, "tip_force_n": 0.05},
    "dataset": {"cases": 200, "validation_cases": 20, "planner_share": 0.5, "threads": 1},
    "shooting": {"hidden": [8, 8], "corrections": 1},
    "optimiser": {"epochs": 2, "batch_size": 64, "learning_rate": 0.004},
    "loss": {"physics": 0.1, "reference": 1.0},
    "bound": {"alpha": 0.1, "cases": 100},
}


def read_train(file: tyro.conf.Positional[Path]) -> int:
    """Reads settings of a training."""
    print(load_train_settings(file))
    return 0


def read_measured(file: tyro.conf.Positional[Path]) -> int:
    """Reads measured shapes."""
    print(read_measured_shapes(file, load_robot("robot.toml")))
    return 0


def read_journal(file: tyro.conf.Positional[Path]) -> int:
    """Reads a sweep's journal."""
    with open_journal(file.parent, load_suite("suite.toml")) as journal:
        print(journal.records)
    return 0


def read_checkpoint(file: tyro.conf.Positional[Path]) -> int:
    """Reads a training's checkpoint."""
    print(load_checkpoint(file, "robot", "settings", _training().state_like()))
    return 0


def read_mesh(file: tyro.conf.Positional[Path]) -> int:
    """Reads the mesh of a scenario."""
    for mesh in load_scene_meshes(load_scenario(file)):
        print(len(mesh.faces), mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))
    return 0


def read_model(file: tyro.conf.Positional[Path]) -> int:
    """Prints shapes of a model."""
    model = load_shape_model(file)
    tensions = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.0, 1.5, 0.2]])
    print(model.disk_poses(tensions).positions.tolist(), model.error_bound.tolist())
    return 0


for reader in (read_train, read_measured, read_journal, read_checkpoint, read_mesh, read_model):
    COMMANDS[reader.__name__.replace("_", "-")] = reader


def prepare(base: Path) -> int:
    """Writes the whole files into a folder."""
    shutil.copy(ROOT / "models/robots/inspection.toml", base / "robot.toml")
    shutil.copy(ROOT / "models/robots/bench.toml", base / "bench.toml")
    shutil.copy(ROOT / "models/robots/helical.toml", base / "helical.toml")
    shutil.copy(ROOT / "models/shape/inspection/model.pt", base / "model.pt")
    shutil.copy(ROOT / "models/shape/paper/published.pt", base / "published.pt")
    box = trimesh.creation.box((100.0, 100.0, 100.0))
    box.apply_translation((300.0, 0.0, 0.0))
    for ending in MESHES:
        box.export(base / f"box.{ending}")
        meshes = [{**SCENARIO["meshes"][0], "file": f"box.{ending}"}]
        (base / f"scenario_{ending}.toml").write_text(write_toml({**SCENARIO, "meshes": meshes}))
    (base / "scenario.toml").write_text(write_toml(SCENARIO))
    (base / "suite.toml").write_text(write_toml(SUITE))
    (base / "train.toml").write_text(write_toml(TRAIN))
    robot = load_robot(base / "robot.toml")
    with (base / "measured.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        tip = robot.disk_count - 1
        writer.writerow([f"tension_{i}_n" for i in range(3)] + [f"disk_{tip}_{axis}_m" for axis in "xyz"])
        writer.writerows([[0.1 * i, 0.2, 0.0, 0.0, 0.0, round(robot.length, 3)] for i in range(5)])
    (base / "sweep").mkdir()
    record = {"status": "verified", "result": {"repairs": 0}, "timing": {"plan_s": 0.5, "message": "", "worker": "a:1"}}
    with open_journal(base / "sweep", load_suite(base / "suite.toml")) as journal:
        journal.add(0, record)
        journal.add(3, record)
    training = _training()
    training.train_epoch()
    save_checkpoint(base / "model.pt.checkpoint", "robot", "settings", training.state())
    done = run(["plan", "scenario.toml", "--out", "result", "--no-progress"])
    return done or run(["roadmap", "scenario.toml", "--out", "roadmap.npz", "--vertices", "40", "--no-progress"])


def _training() -> _Run:
    settings = TrainSettings.model_validate({**TRAIN, "loss": {"physics": 0.1, "reference": 0.0}})
    robot = load_robot("robot.toml")
    cases = draw_cases(robot, settings.domain.for_robot(robot), "uniform", 64, np.random.default_rng(0))
    network = ShootingNetwork(robot, (8, 8), 1, 9.81, 0.05)
    return _Run(robot, settings, network, TrainingData(cases, np.empty((0, 3)), np.empty((0, 3, 3)), cases))


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    Attributes:
        name: Its name.
        file: The file that is damaged.
        commands: Commands that read it, of which one is run.
        change: Returns the damaged file, given the folder of the whole ones.
        option: For options: returns the command and what is absurd in it.
    """

    name: str
    file: str = ""
    commands: tuple[tuple[str, ...], ...] = ()
    change: Callable[[Path, Random], Change] = lambda *_: (b"", ANY, "")
    option: Callable[[Random], tuple[tuple[str, ...], str]] | None = None


def _toml(file: str) -> Callable[[Path, Random], Change]:
    def change(base: Path, random: Random) -> Change:
        text = (base / file).read_text()
        if random.random() < 0.4:
            return change_text(text.encode(), random)
        return change_table(tomllib.loads(text), random, write_toml, ())

    return change


def _result(base: Path, random: Random) -> Change:
    content = (base / "result/result.json").read_bytes()
    if random.random() < 0.3:
        return change_text(content, random)
    free = ("goal_states", "seed_of", "planner_extra", "parameters")
    return change_table(json.loads(content), random, write_json, free)


def _binary(file: str) -> Callable[[Path, Random], Change]:
    return lambda base, random: damage((base / file).read_bytes(), random)


def _text(file: str) -> Callable[[Path, Random], Change]:
    return lambda base, random: change_text((base / file).read_bytes(), random)


def _roadmap_arrays(base: Path, random: Random) -> Change:
    """Changes arrays and hashes them anew, as a program that writes other roadmaps would."""
    with np.load(base / "roadmap.npz") as content:
        arrays = dict(content)
    if random.random() < 0.2:
        return lying_npz(arrays, random), REFUSED, "a header that promises more"
    header = json.loads(str(arrays.pop("header")))
    del header["sha256"]
    if random.random() < 0.2:
        arrays["edges"] = arrays["edges"] + (10_000 if random.random() < 0.5 else -10_000)
        what = "edges to nowhere"
    else:
        arrays, what = change_arrays(arrays, random)
    with contextlib.suppress(TypeError, ValueError, KeyError):
        header["sha256"] = roadmap_file._digest(header, arrays)
    return npz_bytes({"header": np.array(json.dumps(header)), **arrays}), REFUSED, what


def _model_parts(base: Path, random: Random) -> Change:
    """Changes the card or the weights, with right checksums."""
    whole = (base / "model.pt").read_bytes()
    model = load_shape_model(base / "model.pt")
    if random.random() < 0.5:
        card = json.loads(model.card.model_dump_json())
        content, expected, what = change_table(card, random, write_json, ("training",))
        return replace_records(whole, {"extra/card.json": content}), expected, f"card: {what}"
    import io
    import zipfile

    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        weights = archive.read(next(name for name in archive.namelist() if name.endswith("weights.npz")))
    with np.load(io.BytesIO(weights)) as content:
        arrays, what = change_arrays(dict(content), random)
    return replace_records(whole, {"extra/weights.npz": npz_bytes(arrays)}), REFUSED, f"weights: {what}"


_WHOLE = ("-1", "1000000000000", "99999999999999999999", "9" * 5000, "nan", "inf", "1.5", "true", "", "[1]")
_TIMES = ("-1", "0", "nan", "inf", "1e308", "1e12", "abc", "9" * 5000, "")
_SPREADS = ("-1", "nan", "inf", "1e308", "abc", "")
_VECTORS = ("", "1", "1,2,3,4,5", "nan,0", "inf,0", "1e308,0", "a,b", "9" * 5000 + ",0", "1,,2", "1e12,0,0,0")
_PLAN = ("plan", "scenario.toml", "--out", "out")
_COMPARE = ("compare", "scenario.toml", "--out", "out")
_ROBUST = ("robustness", "result/result.json")
_OPTIONS: tuple[tuple[tuple[str, ...], str, tuple[str, ...]], ...] = (
    (("verify", "result/result.json"), "--refine", (*_WHOLE, "0", "1000000000")),
    (_PLAN, "--seed", (*_WHOLE, "0")),
    (_PLAN, "--time-limit-s", _TIMES),
    (_PLAN, "--planner", ("", "RRT;", "../RRT", "9" * 5000, "os:system")),
    (_PLAN, "--validity", ("", "best", "9" * 5000)),
    (_PLAN, "--roadmap", ("none.npz", "model.pt", "scenario.toml", "result", "x" * 5000)),
    (("roadmap", "scenario.toml", "--out", "a.npz"), "--seconds", _TIMES),
    (("roadmap", "scenario.toml", "--out", "a.npz"), "--vertices", (*_WHOLE, "0")),
    (("roadmap", "scenario.toml", "--out", "a.npz"), "--seed", (*_WHOLE, "0")),
    (("evaluate", "model.pt"), "--samples", (*_WHOLE, "0", "5")),
    (("evaluate", "model.pt"), "--seed", _WHOLE[:1] + _WHOLE[2:]),
    (_COMPARE, "--samples", (*_WHOLE, "0")),
    (_COMPARE, "--paths", _WHOLE),
    (_COMPARE, "--jobs", (*_WHOLE, "0")),
    (_COMPARE, "--seed", _WHOLE[:1] + _WHOLE[2:]),
    (_ROBUST, "--samples", (*_WHOLE, "0")),
    (_ROBUST, "--youngs-modulus", (*_SPREADS, "5")),
    (_ROBUST, "--tension", (*_SPREADS, "5")),
    (_ROBUST, "--base-angle-deg", _SPREADS[:3]),
    (_ROBUST, "--seed", _WHOLE[:1] + _WHOLE[2:]),
    (("sweep", "suite.toml", "--out", "out"), "--jobs", (*_WHOLE, "0")),
    (("train", "robot.toml", "--config", "train.toml", "--out", "m.pt"), "--jobs", (*_WHOLE, "0")),
    (("view", "scenario.toml", "--no-open-browser", "--live"), "--port", (*_WHOLE, "0", "65536", "70000")),
    (("solve", "robot.toml"), "--bending-n", _VECTORS),
    (("solve", "robot.toml", "--bending-n", "0,0"), "--gravity", _VECTORS),
    (("solve", "robot.toml", "--bending-n", "0,0"), "--tip-force", _VECTORS),
)


def _option(random: Random) -> tuple[tuple[str, ...], str]:
    command, option, values = _OPTIONS[random.integers(len(_OPTIONS))]
    value = values[random.integers(len(values))]
    return (*command, f"{option}={value}"), f"{option}={value[:20]}"


_JOURNAL, _CHECKPOINT = f"sweep/{JOURNAL_NAME}", "model.pt.checkpoint"

KINDS = [
    Kind("robot", "robot.toml", (("info", "robot.toml"),), _toml("robot.toml")),
    Kind("robot, driven by displacement", "bench.toml", (("info", "bench.toml"),), _toml("bench.toml")),
    Kind("robot, helical", "helical.toml", (("info", "helical.toml"),), _toml("helical.toml")),
    Kind("robot, solved", "robot.toml", (("solve", "robot.toml", "--bending-n", "0.2,0"),), _toml("robot.toml")),
    Kind("scenario", "scenario.toml", (("info", "scenario.toml"),), _toml("scenario.toml")),
    Kind("suite", "suite.toml", (("info", "suite.toml"),), _toml("suite.toml")),
    Kind("train", "train.toml", (("read-train", "train.toml"),), _toml("train.toml")),
    *(
        Kind(f"mesh {ending}", f"box.{ending}", (("read-mesh", f"scenario_{ending}.toml"),), _text(f"box.{ending}"))
        for ending in MESHES
    ),
    Kind("model", "model.pt", (("info", "model.pt"), ("read-model", "model.pt")), _binary("model.pt")),
    Kind("model parts", "model.pt", (("info", "model.pt"),), _model_parts),
    Kind("published", "published.pt", (("read-model", "published.pt"),), _binary("published.pt")),
    Kind("roadmap", "roadmap.npz", (("info", "roadmap.npz"),), _binary("roadmap.npz")),
    Kind("roadmap arrays", "roadmap.npz", (("info", "roadmap.npz"),), _roadmap_arrays),
    Kind("result", "result/result.json", (("info", "result/result.json"),), _result),
    Kind("shapes", "result/shapes.npz", (("info", "result/result.json"),), _binary("result/shapes.npz")),
    Kind("journal", _JOURNAL, (("read-journal", _JOURNAL),), _text(_JOURNAL)),
    Kind("checkpoint", _CHECKPOINT, (("read-checkpoint", _CHECKPOINT),), _binary(_CHECKPOINT)),
    Kind("measured", "measured.csv", (("read-measured", "measured.csv"),), _text("measured.csv")),
    Kind("options", option=_option),
]
