"""The shipped shape models: what they promise, what they refuse, and that both of their forms agree."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.errors import DomainError, FormatError, InputError, RobotMismatchError
from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.learned import LearnedShape, load_shape_model
from tdcr_planner.statics.solver import solve_statics

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("paper", "inspection", "two_segment")


@pytest.fixture(scope="module", params=NAMES)
def model(request) -> LearnedShape:
    return load_shape_model(ROOT / f"models/shape/{request.param}/model.pt")


@pytest.fixture(scope="module", params=(*NAMES, "borescope"))
def shipped(request) -> LearnedShape:
    return load_shape_model(ROOT / f"models/shape/{request.param}/model.pt")


@pytest.fixture(scope="module")
def inspection() -> LearnedShape:
    return load_shape_model(ROOT / "models/shape/inspection/model.pt")


def uniform_cases(model: LearnedShape, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    domain = model.card.domain

    def ball(largest: float) -> np.ndarray:
        vectors = random.normal(size=(count, 3))
        return largest * random.uniform(size=(count, 1)) * vectors / np.linalg.norm(vectors, axis=1)[:, None]

    tensions = random.uniform(0.0, 1.0, (count, model.robot.tendon_count)) * domain.max_tension_n
    return tensions, ball(domain.gravity_m_s2), ball(domain.tip_force_n)


def test_is_a_shape_model(model):
    assert isinstance(model, ShapeModel)
    assert model.name == "learned"
    assert model.error_bound.shape == (model.robot.disk_count,)
    assert len(model.sha256) == 64


def test_keeps_its_promises_on_unseen_cases(shipped):
    model = shipped
    tensions, gravity, tip_force = uniform_cases(model, 1500, 77)
    poses = model.disk_poses(tensions, gravity=gravity, tip_force=tip_force)
    reference = solve_statics(model.robot, tensions, gravity=gravity, tip_force=tip_force)
    ok = reference.converged & reference.stable
    assert ok.mean() > 0.99
    distance = np.linalg.norm(poses.positions - reference.positions, axis=2)[ok]
    angle = rotation_distance(poses.rotations[ok], reference.rotations[ok])
    # Three times what the card states, disk by disk: other cases than the card's, and fewer of them.
    stated = next(accuracy for accuracy in model.card.accuracy if accuracy.sample == "uniform")
    assert (1e3 * np.median(distance, axis=0) <= 3.0 * np.array(stated.position_median_mm)).all()
    assert (1e3 * np.quantile(distance, 0.99, axis=0) <= 3.0 * np.array(stated.position_p99_mm)).all()
    assert (np.degrees(np.median(angle, axis=0)) <= 3.0 * np.array(stated.rotation_median_deg) + 1e-6).all()
    body = distance + model.robot.disk_radii * 2.0 * np.sin(0.5 * angle)
    outside = (body > model.error_bound).any(axis=1).sum()
    # alpha = 0.001: 1.5 cases are expected, more than 8 have a probability below 1e-4 (binomial).
    assert outside <= 8
    assert poses.solved.all()


def test_torchscript_and_compiled_path_agree(shipped):
    import torch

    model = shipped
    cases = uniform_cases(model, 33, 3)
    fast = model.disk_poses(cases[0], gravity=cases[1], tip_force=cases[2])
    with torch.inference_mode():
        positions, rotations = model.torch_module(*(torch.as_tensor(array) for array in cases))
    # Single precision in the network; the Newton step shrinks what it rounds away.
    np.testing.assert_allclose(fast.positions, positions.numpy(), rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(fast.rotations, rotations.numpy(), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("count", [2, 8, 13])
def test_one_shape_is_that_of_a_batch(model, count):
    cases = uniform_cases(model, count, 6)
    together = model.disk_poses_unchecked(*cases)
    alone = [model.disk_poses_unchecked(*(array[row : row + 1] for array in cases)) for row in range(count)]
    # Single precision in the network; its error shrinks some fifty times in the Newton step.
    np.testing.assert_allclose(together.positions, np.concatenate([one.positions for one in alone]), atol=1e-7)
    np.testing.assert_allclose(together.rotations, np.concatenate([one.rotations for one in alone]), atol=1e-6)


def test_boundary_conditions_and_rotations_hold_by_construction(model):
    tensions, gravity, tip_force = uniform_cases(model, 50, 4)
    poses = model.disk_poses(tensions, gravity=gravity, tip_force=tip_force)
    assert (poses.positions[:, 0] == 0.0).all()
    assert (poses.rotations[:, 0] == np.eye(3)).all()
    product = np.swapaxes(poses.rotations, -1, -2) @ poses.rotations
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-12)


def test_shape_at_any_arc_length(model):
    tensions, gravity, tip_force = uniform_cases(model, 5, 5)
    disks = model.disk_poses(tensions, gravity=gravity, tip_force=tip_force)
    fine = np.linspace(0.0, model.robot.length, 1001)
    anywhere = model.poses_at(fine, tensions, gravity=gravity, tip_force=tip_force)
    at_disks = np.searchsorted(fine, model.robot.arc_lengths - 1e-12)
    # Finer stops are finer steps of a fourth-order integrator.
    np.testing.assert_allclose(anywhere.positions[:, at_disks], disks.positions, atol=2e-5)
    speed = np.linalg.norm(np.diff(anywhere.positions, axis=1), axis=2) / np.diff(fine)
    # |p'| = |v|: one, but for the strain of the axis, at most sum of tensions / EA = 27 N / 47 kN.
    np.testing.assert_allclose(speed, 1.0, atol=6e-4)
    tangent = np.diff(anywhere.positions, axis=1) / np.diff(fine)[:, None]
    between = 0.5 * (anywhere.rotations[:, 1:, :, 2] + anywhere.rotations[:, :-1, :, 2])
    np.testing.assert_allclose(tangent, between, atol=1e-3)


def test_single_load_vectors_serve_all_rows(inspection):
    tensions = np.array([[1.0, 0.5, 0.0], [0.0, 2.0, 1.0]])
    once = inspection.disk_poses(tensions, gravity=[0.0, 0.0, -9.81])
    rows = inspection.disk_poses(tensions, gravity=[[0.0, 0.0, -9.81]] * 2, tip_force=np.zeros((2, 3)))
    np.testing.assert_array_equal(once.positions, rows.positions)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"tensions": [[0.0, 0.0, 0.0], [1.0, 3.6, 0.0]]}, ["3.5 N", "3.6 N", "row 1", "tendon 1"]),
        ({"tensions": [[0.0, 0.0, 0.0]], "gravity": [0.0, 10.0, 1.0]}, ["gravity", "10 m/s^2", "10.0"]),
        ({"tensions": [[0.0, 0.0, 0.0]], "tip_force": [0.06, 0.0, 0.0]}, ["tip_force", "0.05 N", "0.06 N"]),
    ],
)
def test_out_of_domain_is_refused(inspection, arguments, words):
    with pytest.raises(DomainError) as caught:
        inspection.disk_poses(**arguments)
    for word in words:
        assert word in str(caught.value)


def test_limits_belong_to_the_domain(inspection):
    limit = np.full((1, 3), 3.5)
    turned = np.array([10.0 * np.sqrt(1.0 / 3.0)] * 3)
    assert inspection.in_domain(limit, turned[None], np.zeros((1, 3))).all()
    assert inspection.disk_poses(limit, gravity=turned).solved.all()


@pytest.mark.parametrize("tensions", [[[1.0, 2.0]], [[1.0, 2.0, -0.1]], [[1.0, 2.0, np.nan]], [1.0, 2.0, 3.0]])
def test_bad_tensions_are_refused(inspection, tensions):
    with pytest.raises(InputError):
        inspection.disk_poses(tensions)


@pytest.mark.parametrize("stops", [[], [0.1, 0.05], [-0.01], [0.3]])
def test_bad_arc_lengths_are_refused(inspection, stops):
    with pytest.raises(InputError, match="arc_lengths"):
        inspection.poses_at(stops, [[1.0, 1.0, 1.0]])


def test_a_shape_that_is_none_is_not_called_solved(inspection):
    far = inspection.disk_poses_unchecked(np.array([[3.5, 0.0, 0.0]]), np.array([[0.0, 0.0, -900.0]]), np.zeros((1, 3)))
    assert not far.solved.any()


def test_residual_is_small_where_the_model_is_sure(inspection):
    cases = uniform_cases(inspection, 200, 8)
    residual = inspection.residual(cases[0], gravity=cases[1], tip_force=cases[2])
    # The moment scale of these loads is 1e-2 N m.
    assert np.median(residual) < 1e-5


def test_another_robot_is_refused(inspection):
    robot = load_robot(ROOT / "models/robots/two_segment.toml")
    with pytest.raises(RobotMismatchError, match=r"made for robot 'inspection'.*not for 'two_segment'"):
        load_shape_model(inspection.path, robot)


def test_limits_and_body_may_change(inspection):
    content = inspection.robot.model_dump()
    segment = content["segments"][0] | {"max_tension_n": 9.0, "disk_radius_m": 0.02}
    robot = RobotSpec.model_validate(content | {"segments": [segment]})
    model = load_shape_model(inspection.path, robot)
    assert model.robot is robot
    np.testing.assert_allclose(model.error_bound, 2.0 * inspection.error_bound)
    with pytest.raises(DomainError, match=r"at most 3.5 N"):
        model.disk_poses([[5.0, 0.0, 0.0]])


def test_broken_files_are_refused(inspection, tmp_path):
    whole = inspection.path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 3] ^= 0xFF
    for name, content in {
        "empty": b"",
        "half": whole[: len(whole) // 2],
        "short": whole[:-40],
        "text": b"no model at all\n" * 100,
        "flipped": bytes(flipped),
    }.items():
        path = tmp_path / f"{name}.pt"
        path.write_bytes(content)
        with pytest.raises(FormatError, match=name):
            load_shape_model(path)
    with pytest.raises(FormatError, match="no such file"):
        load_shape_model(tmp_path / "missing.pt")
    with pytest.raises(FormatError, match="folder"):
        load_shape_model(tmp_path)


def test_an_archive_without_card_is_refused(inspection, tmp_path):
    path = tmp_path / "other.pt"
    with zipfile.ZipFile(inspection.path) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            if "/extra/card.json" not in name:
                target.writestr(name, source.read(name))
    with pytest.raises(FormatError, match="no card"):
        load_shape_model(path)


def test_a_card_of_another_format_is_refused(inspection, tmp_path):
    path = tmp_path / "other.pt"
    with zipfile.ZipFile(inspection.path) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            target.writestr(name, source.read(name).replace(b"tdcr-shape-model/1", b"tdcr-shape-model/9"))
    with pytest.raises(FormatError, match="format"):
        load_shape_model(path)


def test_plain_torch_runs_the_file_without_this_package(inspection):
    code = f"""
        import sys, warnings
        class Blocked:
            def find_spec(self, name, path=None, target=None):
                if name.split(".")[0] == "tdcr_planner":
                    raise ImportError("blocked")
        sys.meta_path.insert(0, Blocked())
        import torch
        warnings.simplefilter("ignore")
        files = {{"card.json": ""}}
        module = torch.jit.load({str(inspection.path)!r}, _extra_files=files)
        inputs = torch.tensor([[1.0, 0.5, 0.0]]), torch.tensor([[0.0, 0.0, -9.81]]), torch.zeros(1, 3)
        positions, rotations = module(*inputs)
        assert b"tdcr-shape-model/1" in bytes(files["card.json"])
        assert "tdcr_planner" not in sys.modules
        print(*positions[0, -1].tolist())
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=False, cwd="/"
    )
    assert run.returncode == 0, run.stderr
    tip = [float(number) for number in run.stdout.split()]
    expected = inspection.disk_poses([[1.0, 0.5, 0.0]], gravity=[0.0, 0.0, -9.81]).positions[0, -1]
    np.testing.assert_allclose(tip, expected, atol=1e-5)


def test_the_planner_needs_no_torch(inspection):
    code = (
        "import sys; from tdcr_planner.shape.learned import load_shape_model; "
        f"load_shape_model({str(inspection.path)!r}).disk_poses([[1.0, 0.5, 0.0]]); assert 'torch' not in sys.modules"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_torchscript_has_gradients_by_its_inputs(inspection):
    import torch

    tensions = torch.tensor([[1.0, 0.5, 0.2]], dtype=torch.float64, requires_grad=True)
    gravity = torch.tensor([[0.0, 0.0, -9.81]], dtype=torch.float64)
    positions, _ = inspection.torch_module(tensions, gravity, torch.zeros(1, 3, dtype=torch.float64))
    positions[0, -1, 0].backward()
    assert tensions.grad is not None
    step = np.array([[1e-4, 0.0, 0.0]])
    ahead = inspection.disk_poses(np.array([[1.0, 0.5, 0.2]]) + step, gravity=[0.0, 0.0, -9.81]).positions[0, -1, 0]
    behind = inspection.disk_poses(np.array([[1.0, 0.5, 0.2]]) - step, gravity=[0.0, 0.0, -9.81]).positions[0, -1, 0]
    # Single-precision weights leave about 1e-7 m in each difference of 2e-4 N.
    np.testing.assert_allclose(tensions.grad[0, 0].item(), (ahead - behind) / 2e-4, rtol=2e-2)


def test_loads_for_all_rows_are_answered_without_a_warning_of_torch():
    published = load_shape_model(ROOT / "models/shape/paper/published.pt")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        one = published.disk_poses([[1.0, 0.5, 0.0]], gravity=[0.0, 0.0, 0.0]).positions
        two = published.disk_poses([[1.0, 0.5, 0.0]] * 2, gravity=np.zeros(3), tip_force=np.zeros(3)).positions
    np.testing.assert_allclose(two, np.repeat(one, 2, axis=0), rtol=0.0, atol=1e-7)


def test_a_module_that_has_answered_still_has_gradients():
    import torch

    published = load_shape_model(ROOT / "models/shape/paper/published.pt")
    published.disk_poses([[1.0, 0.5, 0.0]])
    tensions = torch.tensor([[1.0, 0.5, 0.0]], dtype=torch.float64, requires_grad=True)
    loads = torch.zeros(1, 3, dtype=torch.float64)
    positions, _ = published.torch_module(tensions, loads, loads)
    positions[0, -1, 0].backward()
    assert tensions.grad is not None
    assert tensions.grad.abs().max() > 0.0


@pytest.mark.parametrize("name", NAMES)
def test_shipped_files_belong_together(name):
    folder = ROOT / "models/shape" / name
    model = load_shape_model(folder / "model.pt", load_robot(ROOT / f"models/robots/{name}.toml"))
    from tdcr_planner.learning.settings import TrainSettings, load_train_settings

    # Settings that a card does not name, as it was made before they existed, are at their defaults.
    stated = TrainSettings.model_validate(model.card.training)
    assert stated.model_dump() == load_train_settings(folder / "train.toml").model_dump()
    assert (folder / "model.pt").stat().st_size < 5_000_000
    command = f"tdcr train models/robots/{name}.toml --config models/shape/{name}/train.toml"
    assert command in (folder / "README.md").read_text(encoding="utf-8")


def test_card_describes_itself(model):
    text = model.card.describe()
    for words in ("domain", "gravity to 10 m/s^2", "error bound", "torch", model.card.robot.name):
        assert words in text


@pytest.mark.parametrize("name", ["inspection", "two_segment"])
def test_both_engines_of_an_own_model_answer_the_same(name: str, root: Path) -> None:
    model = load_shape_model(root / f"models/shape/{name}/model.pt")
    assert model.engine == "compiled"
    generator = np.random.default_rng(4)
    tensions = generator.uniform(0.0, model.card.domain.max_tension_n, (20, model.robot.tendon_count))
    gravity = np.tile([0.0, 5.0, -8.0], (20, 1))
    first = model.answer(tensions, gravity, np.zeros((20, 3)))
    model.use(engine="torchscript")
    second = model.answer(tensions, gravity, np.zeros((20, 3)))
    # docs/learning.md: compiled code and TorchScript agree within 1e-7 m.
    np.testing.assert_allclose(second.positions, first.positions, atol=1e-7)
    np.testing.assert_allclose(second.rotations, first.rotations, atol=1e-5)
    np.testing.assert_allclose(second.residual, first.residual, atol=1e-7)


def test_engines_and_devices_that_are_not_there_are_refused(root: Path) -> None:
    path = root / "models/shape/paper/model.pt"
    with pytest.raises(InputError, match="compiled, torchscript"):
        load_shape_model(path, engine="onnx")
    with pytest.raises(InputError, match="torchscript"):
        load_shape_model(path, device="cuda")
    import torch

    if not torch.cuda.is_available():
        with pytest.raises(InputError, match="no GPU"):
            load_shape_model(path, engine="torchscript", device="cuda")


def test_the_published_network_states_a_bound_by_state_or_the_same_everywhere(root: Path) -> None:
    path = root / "models/shape/paper/published.pt"
    by_state, uniform = load_shape_model(path), load_shape_model(path, bound="uniform")
    tensions = np.random.default_rng(6).uniform(0.0, 2.0, (30, 3))
    none = np.zeros((30, 3))
    poses, bounds = by_state.poses_and_bounds(tensions, none, none)
    assert bounds.shape == (30, 21)
    assert (bounds <= by_state.error_bound).all()
    assert np.median(bounds[:, -1]) < 0.5 * uniform.error_bound[-1]
    np.testing.assert_array_equal(by_state.error_bound_at(tensions, none, none), bounds)
    np.testing.assert_array_equal(uniform.error_bound_at(tensions, none, none), uniform.error_bound)
    # Without loads the scale is the error itself, and the bound covers it.
    exact = solve_statics(by_state.robot, tensions).positions
    assert (np.linalg.norm(poses.positions - exact, axis=2) <= bounds).all()


def test_gravity_is_no_part_of_the_domain_of_a_weightless_robot(root: Path) -> None:
    model = load_shape_model(root / "models/shape/paper/published.pt")
    assert model.card.domain.gravity_m_s2 == 0.0
    assert model.in_domain(np.ones((1, 3)), np.array([[0.0, 0.0, -9.81]]), np.zeros((1, 3))).all()
    assert not model.in_domain(np.ones((1, 3)), np.zeros((1, 3)), np.array([[0.1, 0.0, 0.0]])).any()
