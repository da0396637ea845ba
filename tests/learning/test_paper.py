"""The published method: its symmetry, its equations on the exact arc, its training."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tdcr_planner.errors import InputError
from tdcr_planner.learning.dataset import Cases, solve_cases
from tdcr_planner.learning.paper import PaperTraining, train_paper_network
from tdcr_planner.learning.paper_physics import RodEquations, rotation_distance_loss
from tdcr_planner.learning.train import train_model
from tdcr_planner.se3 import rotation_about_z, rotation_from_vector
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.shape.paper_network import PaperNetwork
from tdcr_planner.shape.torch_module import script_module

NO_LOADS = {"gravity_m_s2": 0.0, "tip_force_n": 0.0}


def paper_settings(small_settings, **changes):
    tables = {
        "epochs": 6,
        "cycle_epochs": 5,
        "plateau_from_epoch": 4,
        "warm_up": 0.3,
        "grid": (8, 5, 5),
        "batch_size": 50,
        "learning_rate": 3e-3,
        "hidden": (24, 24),
        "reference_grid": (3, 3),
        "edge_actuations": 4,
        "arc_points": 21,
        "arc_actuations": 4,
        "resampling_probability": 0.5,
    }
    return small_settings(network="paper", domain=NO_LOADS, paper=tables | changes)


class ExactArc(PaperNetwork):
    """The closed form of the unloaded robot in the place of the network's layers."""

    def prepare(self, robot):
        order = np.argsort(np.mod(robot.tendon_angles, 2.0 * np.pi))
        self.offsets = torch.as_tensor(robot.tendon_offsets[order[:2], :2])
        self.stiffness = robot.backbone.stiffness_bending_torsion[0]
        return self

    def cross_sections(self, rows):
        s, tensions = rows[:, :1], rows[:, 1:]
        moment = torch.stack([-tensions @ self.offsets[:, 1], tensions @ self.offsets[:, 0]], dim=1)
        u = torch.cat([moment / self.stiffness, torch.zeros_like(s)], dim=1)
        curvature = torch.linalg.vector_norm(u, dim=1, keepdim=True)
        direction = torch.stack([u[:, 1], -u[:, 0]], dim=1) / curvature
        angle = curvature * s
        p = torch.cat([direction * (1.0 - torch.cos(angle)) / curvature, torch.sin(angle) / curvature], dim=1)
        return torch.cat([p, u * s, u], dim=1)


def test_equations_hold_on_the_exact_arc(paper_robot, random):
    network = ExactArc(paper_robot, (4,)).prepare(paper_robot)
    equations = RodEquations(paper_robot, network)
    equations.offsets = torch.cat([network.offsets, torch.zeros(2, 1)], dim=1)
    rows = torch.as_tensor(random.uniform(0.05, 1.0, (30, 3)) * [0.2, 3.5, 3.5])
    position, rotation, curvature, strain = equations.residuals(rows)
    assert position.abs().max() < 1e-9
    assert rotation.abs().max() < 1e-8
    # v = e3 leaves out the compression of the axis, sum of tensions / EA = 1.5e-4, here of u / l = 45 / m^2.
    assert curvature.abs().max() < 1.5e-4 * 45.0
    # What v = e3 leaves out of v': the tendons' transverse force tau u over the shear stiffness.
    u = torch.linalg.vector_norm(network.cross_sections(rows)[:, 6:9], dim=1)
    transverse = rows[:, 1:].sum(dim=1) * u / float(equations.stiffness[0, 0])
    torch.testing.assert_close(torch.linalg.vector_norm(strain, dim=1), transverse, rtol=0.1, atol=0.0)
    out = network.cross_sections(torch.cat([torch.full_like(rows[:, :1], 0.2), rows[:, 1:]], dim=1))
    turned = network.rotation(out[:, 3:6])
    carried, pulled = equations.bending_moment(turned, out[:, 6:9]), equations.moment_of_tendons(turned, rows[:, 1:])
    # Stiffness is kept in single precision: 1e-7 of 0.02 N m.
    assert (carried - pulled).abs().max() < 2e-9
    network.stiffness *= 1.1
    out = network.cross_sections(rows)
    assert (equations.bending_moment(turned, out[:, 6:9]) - pulled).abs().max() > 1e-4


def test_answers_turn_and_mirror_with_the_tendons(paper_robot, random):
    network = PaperNetwork(paper_robot, (16, 16))
    tensions = random.uniform(0.0, 3.5, (20, 3))
    zero = torch.zeros(20, 3)
    positions, rotations = (x.detach().numpy() for x in network(torch.as_tensor(tensions), zero, zero))
    # Tendons stand at 90, -30 and 210 degrees: column i goes to i + 1 under a turn by -120 degrees.
    turn = rotation_about_z(np.array(-2.0 * np.pi / 3.0))
    turned = network(torch.as_tensor(np.roll(tensions, 1, axis=1)), zero, zero)
    np.testing.assert_allclose(turned[0].detach().numpy(), positions @ turn.T, atol=1e-6)
    np.testing.assert_allclose(turned[1].detach().numpy(), turn @ rotations @ turn.T, atol=1e-5)
    mirror = np.diag([-1.0, 1.0, 1.0])
    mirrored = network(torch.as_tensor(tensions[:, [0, 2, 1]]), zero, zero)
    np.testing.assert_allclose(mirrored[0].detach().numpy(), positions @ mirror, atol=1e-6)
    np.testing.assert_allclose(mirrored[1].detach().numpy(), mirror @ rotations @ mirror, atol=1e-5)


def test_the_sector_gives_the_right_shape_all_around(paper_robot, random):
    network = ExactArc(paper_robot, (4,)).prepare(paper_robot)
    network.offsets = network.offsets.float()
    bending = 2.0 * np.stack([np.cos(np.linspace(0.01, 6.2, 40)), np.sin(np.linspace(0.01, 6.2, 40))], axis=1)
    tensions = paper_robot.tensions_from_bending(bending[:, None, :])
    zero = np.zeros((40, 3))
    solved = solve_cases(paper_robot, Cases(tensions, zero, zero))
    positions, rotations = network(torch.as_tensor(tensions), torch.as_tensor(zero), torch.as_tensor(zero))
    # The network's arc knows no compression of the axis (1.4e-5 m here) and is in single precision.
    np.testing.assert_allclose(positions.detach().numpy(), solved.positions, atol=3e-5)
    np.testing.assert_allclose(rotations.detach().numpy(), solved.rotations, atol=1e-5)


def test_rotation_distance_is_the_angle(random):
    vectors = random.normal(size=(20, 3)) * 0.4
    rotations = torch.as_tensor(rotation_from_vector(vectors))
    identity = torch.eye(3, dtype=torch.float64).expand(20, 3, 3)
    loss = rotation_distance_loss(rotations, identity)
    assert float(loss) == pytest.approx(np.linalg.norm(vectors, axis=1).mean(), abs=1e-6)
    # The clamp keeps acos differentiable and leaves acos(0.99999) = 0.0045 rad at zero.
    assert float(rotation_distance_loss(identity, identity)) == pytest.approx(np.arccos(0.99999))


def test_the_sets_of_points_are_those_of_the_published_program(paper_robot, small_settings):
    training = PaperTraining(paper_robot, small_settings(network="paper", domain=NO_LOADS))
    # 9 x 9 and 96 actuations with 21 disks, of which 70 % are trained on; the straight robot whole.
    sizes = {name: len(points) for name, points in training.training.items()}
    assert sizes == {"at_base": 57, "between": 1077, "at_tip": 57, "largest_force": 1411, "no_force": 21}
    assert len(training.validation) == 81 * 21 + 96 * 21 - 57 - 1077 - 57 - 1411
    grid = training.points.grid
    assert grid.shape == (32**3, 3)
    assert training.steps == 32
    # The second tendon never pulls harder than the first: that is the sector.
    assert (grid[:, 1] >= grid[:, 2] - 1e-5).all()
    bending = paper_robot.bending_from_tensions(torch.nn.functional.pad(grid[:, 1:], (0, 1)).double().numpy())
    force = np.linalg.norm(bending[:, 0], axis=1)
    assert force.min() == pytest.approx(0.1 * force.max(), rel=1e-5)


def test_draws_lie_around_the_worst_actuations(paper_robot, small_settings):
    changes = {"worst_actuations": 2, "worst_arc_lengths": 3, "spread_arc_length_m": 1e-4, "spread_tension_n": 1e-4}
    training = PaperTraining(paper_robot, paper_settings(small_settings, **changes))
    rows, actuation = training.validation.rows, training.validation.actuation
    errors = torch.rand(len(rows))
    worst = [int(actuation[40]), int(actuation[-1])]
    for index in worst:
        errors[torch.nonzero(actuation == index)[0]] += 10.0
    drawn = training.points.resample(errors, np.random.default_rng(3))
    assert drawn.shape == training.points.grid.shape
    pairs = torch.stack([rows[actuation == index][0, 1:] for index in worst])
    nearest = torch.cdist(drawn[:, 1:].double(), pairs.double()).min(dim=1)
    assert nearest.values.max() < 1e-3
    assert torch.bincount(nearest.indices).min() >= len(drawn) // 2 - 3
    peaks = torch.stack([rows[torch.nonzero(actuation == index)[0], 0] for index in worst]).reshape(-1)
    # A third of the draws of each lies at the arc length of its largest error.
    at_peak = (drawn[:, 0] - peaks[nearest.indices]).abs() < 1e-3
    assert at_peak.float().mean() > 0.3


def test_the_rate_rises_falls_and_waits_for_plateaus(paper_robot, small_settings):
    changes = {"cycle_epochs": 10, "plateau_from_epoch": 3, "plateau_patience": 1, "plateau_cooldown": 0}
    changes |= {"learning_rate": 1e-3, "warm_up": 0.2, "resampling_probability": 0.0}
    training = PaperTraining(paper_robot, paper_settings(small_settings, **changes))
    assert training.optimiser.param_groups[0]["lr"] == pytest.approx(1e-4)
    rates = []
    for _ in range(4):
        training.train_epoch()
        rates.append(training.optimiser.param_groups[0]["lr"])
    # The peak lies between two epochs.
    assert rates[1] == pytest.approx(1e-3, rel=1e-2)
    assert rates[1] > rates[2] == rates[3]
    for _ in range(3):
        training.plateau.step(1e9)
    assert training.optimiser.param_groups[0]["lr"] == pytest.approx(0.9 * rates[3])


def test_trains_exports_and_resumes(paper_robot, small_settings, tmp_path):
    settings = paper_settings(small_settings)
    told = []
    whole = train_paper_network(paper_robot, settings, tmp_path / "a.pt", progress=lambda *news: told.append(news))
    losses = [float(news[3].split()[1].rstrip(",")) for news in told]
    assert losses[-1] < 0.3 * losses[0]

    def stop(stage, done, total, remark):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_paper_network(paper_robot, settings, tmp_path / "b.pt", progress=stop)
    resumed = train_paper_network(paper_robot, settings, tmp_path / "b.pt")
    for mine, other in zip(whole.state_dict().values(), resumed.state_dict().values(), strict=True):
        assert torch.equal(mine, other)
    card = train_model(paper_robot, settings, tmp_path / "b.pt")
    assert card.network == "paper"
    model = load_shape_model(tmp_path / "b.pt", paper_robot)
    tensions = np.array([[1.0, 0.4, 0.0], [0.0, 0.0, 0.0], [0.5, 0.5, 2.0]])
    poses = model.disk_poses(tensions)
    expected = whole(torch.as_tensor(tensions), torch.zeros(3, 3), torch.zeros(3, 3))
    np.testing.assert_allclose(poses.positions, expected[0].detach().numpy(), atol=1e-6)
    with pytest.raises(InputError, match="corrects its shapes by mechanics"):
        model.residual(tensions)


def test_scripted_network_is_the_same(paper_robot, random):
    network = PaperNetwork(paper_robot, (8, 8))
    inputs = torch.as_tensor(random.uniform(0.0, 3.5, (7, 3))), torch.zeros(7, 3), torch.zeros(7, 3)
    for eager, scripted in zip(network(*inputs), script_module(network)(*inputs), strict=True):
        torch.testing.assert_close(eager, scripted)


def test_other_robots_and_loads_are_refused(two_segment_robot, paper_robot, small_settings, tmp_path):
    with pytest.raises(InputError, match="one segment with three tendons"):
        train_paper_network(two_segment_robot, paper_settings(small_settings), tmp_path / "a.pt")
    loaded = small_settings(network="paper")
    with pytest.raises(InputError, match="knows no loads"):
        train_paper_network(paper_robot, loaded, tmp_path / "a.pt")
