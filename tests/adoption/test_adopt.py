"""Adopting a network, from its file to a model that plans."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdcr_planner.adoption.adopt import AdoptSettings, adopt
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.learning.dataset import draw_cases, solve_cases
from tdcr_planner.learning.judge import body_errors
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.learned import load_shape_model

# alpha = 0.1 takes 90 cases of each sample.
QUICK = {"alpha": 0.1, "cases": 120, "judged": 60}
UNLOADED = DomainSettings(gravity_m_s2=0.0, tip_force_n=0.0)


@pytest.fixture(scope="module")
def module(networks: Any, paper_robot: RobotSpec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mine") / "mine.pt"
    path.write_bytes(networks.scripted("plain", paper_robot))
    return path


@pytest.fixture(scope="module")
def adopted(module: Path, paper_robot: RobotSpec) -> Path:
    out = module.with_name("model.pt")
    adopt(module, paper_robot, out, AdoptSettings(domain=UNLOADED, **QUICK))
    return out


def test_an_adopted_network_is_a_shape_model(adopted: Path, paper_robot: RobotSpec) -> None:
    model = load_shape_model(adopted, paper_robot)
    card = model.card
    assert (card.network, card.adoption.kind, model.engine) == ("adopted", "torchscript", "torchscript")
    assert card.adoption.source == "mine.pt"
    assert {"adopted torchscript network of mine.pt, as it is"} <= set(card.describe().splitlines())
    cases = draw_cases(paper_robot, card.domain, "planner", 30, np.random.default_rng(9))
    solved = solve_cases(paper_robot, cases)
    poses = model.disk_poses(solved.cases.tensions)
    # The network adds up to 1e-6 m in each direction to the arc.
    assert body_errors(paper_robot, poses.positions, poses.rotations, solved).max() < 3e-6
    bounds = model.error_bound_at(solved.cases.tensions, solved.cases.gravity, solved.cases.tip_force)
    assert bounds.shape == (len(solved.cases), paper_robot.disk_count)
    assert (bounds <= model.error_bound).all()


def test_the_same_network_gives_the_same_file(module: Path, adopted: Path, paper_robot: RobotSpec) -> None:
    again = module.with_name("again.pt")
    adopt(module, paper_robot, again, AdoptSettings(domain=UNLOADED, **QUICK))
    first, second = (load_shape_model(path).card for path in (adopted, again))
    assert first.error_bound == second.error_bound
    assert first.state_margin == second.state_margin


def test_a_correction_makes_a_loaded_shape_of_an_unloaded_network(
    networks: Any, inspection_robot: RobotSpec, tmp_path: Path
) -> None:
    path, errors = tmp_path / "mine.pt", []
    path.write_bytes(networks.scripted("plain", inspection_robot))
    for correct in (False, True):
        settings = AdoptSettings(domain=DomainSettings(gravity_m_s2=9.81, tip_force_n=0.0), correct=correct, **QUICK)
        found = adopt(path, inspection_robot, tmp_path / "model.pt", settings)
        errors.append(float(np.median(found.errors)))
        assert found.card.adoption.correct is correct
    assert errors[1] < 0.05 * errors[0]
    model = load_shape_model(tmp_path / "model.pt")
    assert model.has_residual
    gravity = np.array([[9.81, 0.0, 0.0]])
    assert model.residual(inspection_robot.pretensions[None], gravity=gravity)[0] < 1e-3


def test_a_network_that_changed_in_the_model_file_is_refused(adopted: Path, tmp_path: Path) -> None:
    changed = tmp_path / "changed.pt"
    with zipfile.ZipFile(adopted) as old, zipfile.ZipFile(changed, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, content + b"\1" if name.endswith("module.pt") else content)
    with pytest.raises(FormatError, match="another network than the one that was adopted"):
        load_shape_model(changed)


def test_a_network_that_was_put_into_a_model_file_is_checked(adopted: Path, attacks: Any, tmp_path: Path) -> None:
    import hashlib

    written = tmp_path / "written"
    content = attacks.archive(attacks.code("forward", f'torch.save(x, "{written}")'))
    changed = tmp_path / "changed.pt"
    with zipfile.ZipFile(adopted) as old, zipfile.ZipFile(changed, "w") as new:
        card = json.loads(old.read("model/extra/card.json"))
        card["adoption"]["module_sha256"] = hashlib.sha256(content).hexdigest()
        new.writestr("model/extra/card.json", json.dumps(card))
        new.writestr("model/extra/module.pt", content)
    with pytest.raises(FormatError, match="does not run"):
        load_shape_model(changed)
    assert not written.exists()


def test_a_file_that_changes_meanwhile_is_refused_and_nothing_is_written(
    module: Path, paper_robot: RobotSpec, tmp_path: Path
) -> None:
    copy = tmp_path / "mine.pt"
    copy.write_bytes(module.read_bytes())

    def change(stage: str, done: int, total: int, remark: str) -> None:
        copy.write_bytes(module.read_bytes() + b"\0")

    with pytest.raises(FormatError, match="changed while"):
        adopt(copy, paper_robot, tmp_path / "model.pt", AdoptSettings(domain=UNLOADED, **QUICK), progress=change)
    assert not (tmp_path / "model.pt").exists()


def test_a_mistake_is_named_and_nothing_is_written(networks: Any, paper_robot: RobotSpec, tmp_path: Path) -> None:
    path = tmp_path / "mine.pt"
    path.write_bytes(networks.to_bytes(networks.script(networks.Converted(paper_robot, scale=1e3).eval())))
    with pytest.raises(InputError, match="--length-unit mm"):
        adopt(path, paper_robot, tmp_path / "model.pt", AdoptSettings(domain=UNLOADED, **QUICK))
    assert not (tmp_path / "model.pt").exists()


def test_an_onnx_file_is_adopted(networks: Any, paper_robot: RobotSpec, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    path = networks.exported("residual", paper_robot, tmp_path / "mine.onnx")
    adopt(path, paper_robot, tmp_path / "model.pt", AdoptSettings(domain=UNLOADED, **QUICK))
    model = load_shape_model(tmp_path / "model.pt")
    assert model.engine == "onnx"
    import torch

    ours = networks.make("residual", paper_robot)(*networks.example())[0]
    tensions = networks.example()[0].numpy()
    np.testing.assert_allclose(model.disk_poses(tensions).positions, ours.detach().numpy(), atol=1e-9)
    assert isinstance(ours, torch.Tensor)
    with pytest.raises(InputError, match="onnx"):
        load_shape_model(tmp_path / "model.pt", engine="compiled")


@pytest.mark.parametrize(("changes", "words"), [({"alpha": 0.0}, "alpha"), ({"cases": 10}, "at least")])
def test_settings_are_checked(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        AdoptSettings(**(QUICK | changes))
