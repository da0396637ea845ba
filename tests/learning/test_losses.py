"""The parts of the loss vanish where they must and have the gradients they claim."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tdcr_planner.learning.dataset import draw_cases, solve_cases
from tdcr_planner.learning.losses import TipResidual, inverse_loss, physics_loss, reference_loss
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.shape.rod_kernel import rod_constants, tip_residual_jacobian


@pytest.fixture(scope="module")
def solved(small_robot):
    domain = DomainSettings().for_robot(small_robot)
    return solve_cases(small_robot, draw_cases(small_robot, domain, "uniform", 12, np.random.default_rng(2)))


def test_gradient_of_the_residual_is_that_of_finite_differences(small_robot, solved):
    constants = rod_constants(small_robot)
    moment = torch.as_tensor(solved.base_moment + 1e-3).requires_grad_()
    # The kernel's Jacobian is a forward difference with six digits.
    assert torch.autograd.gradcheck(
        lambda value: TipResidual.apply(value, constants, solved.cases)[0], (moment,), eps=1e-6, atol=1e-3, rtol=1e-3
    )


def test_physics_loss_vanishes_at_the_equilibrium_alone(small_robot, solved):
    constants = rod_constants(small_robot)
    cases = solved.cases
    _, jacobian = tip_residual_jacobian(constants, cases.tensions, cases.gravity, cases.tip_force, solved.base_moment)
    inverse = torch.linalg.inv(torch.as_tensor(jacobian))
    moment = torch.as_tensor(solved.base_moment)
    assert float(physics_loss(moment, inverse, constants, cases, 0.01, 1.0)) < 1e-6
    assert float(physics_loss(moment + 1e-3, inverse, constants, cases, 0.01, 1.0)) > 1e-3
    assert float(physics_loss(moment, 0.9 * inverse, constants, cases, 0.01, 1.0)) > 1e-2


def test_reference_loss_is_the_mean_squared_distance():
    label = torch.zeros(4, 3, dtype=torch.float64)
    moment = torch.full((4, 3), 0.02, dtype=torch.float64)
    identity = torch.eye(3, dtype=torch.float64).expand(4, 3, 3)
    loss = reference_loss(moment, identity, label, identity, 0.01, 1.0)
    assert float(loss) == pytest.approx(3 * 2.0**2)


def test_inverse_loss_measures_what_a_newton_step_leaves(random):
    jacobian = torch.as_tensor(random.normal(size=(5, 3, 3)) + 3.0 * np.eye(3))
    inverse = torch.linalg.inv(jacobian)
    assert float(inverse_loss(inverse, jacobian)) < 1e-25
    # C = 0.9 / J leaves a tenth in each of three directions.
    assert float(inverse_loss(0.9 * inverse, jacobian)) == pytest.approx(3 * 0.01)
