"""The parts of the loss of the `shooting` network: physics without labels, and the reference's base moments."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tdcr_planner.learning.dataset import Cases
from tdcr_planner.shape.rod_kernel import RodConstants, tip_residual_jacobian


class TipResidual(torch.autograd.Function):
    """The moment left over at the tip as a function of the base moment, with the derivative that mechanics gives.

    The rod is integrated by the compiled kernel, its Jacobian is passed back: no graph through the integration.
    """

    @staticmethod
    def forward(ctx: Any, base_moment: Tensor, constants: RodConstants, cases: Cases) -> tuple[Tensor, Tensor]:
        """Returns the residual (n, 3), N m, and its Jacobian (n, 3, 3)."""
        residual, jacobian = tip_residual_jacobian(
            constants,
            cases.tensions,
            cases.gravity,
            cases.tip_force,
            base_moment.detach().double().cpu().numpy(),
        )
        saved = torch.as_tensor(jacobian, dtype=base_moment.dtype, device=base_moment.device)
        ctx.save_for_backward(saved)
        ctx.mark_non_differentiable(saved)
        return torch.as_tensor(residual, dtype=base_moment.dtype, device=base_moment.device), saved

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        """Returns the gradient by the base moment."""
        (jacobian,) = ctx.saved_tensors
        return torch.matmul(jacobian.transpose(1, 2), gradients[0].unsqueeze(2)).squeeze(2), None, None


def physics_loss(
    base_moment: Tensor, inverse: Tensor, constants: RodConstants, cases: Cases, scale: float, inverse_weight: float
) -> Tensor:
    """Mean squared residual of the cut form, plus that of the learned inverse Jacobian; needs no labels.

    Args:
        base_moment: Predicted M(0), shape (n, 3), N m.
        inverse: Predicted inverse of dM(l)/dM(0), shape (n, 3, 3).
        constants: The robot.
        cases: The inputs, n of them.
        scale: Moment by which residuals are divided, N m.
        inverse_weight: Weight of the inverse.
    """
    residual, jacobian = TipResidual.apply(base_moment, constants, cases)
    return (residual / scale).square().sum(dim=1).mean() + inverse_weight * inverse_loss(inverse, jacobian)


def reference_loss(
    base_moment: Tensor, inverse: Tensor, label: Tensor, jacobian: Tensor, scale: float, inverse_weight: float
) -> Tensor:
    """Mean squared distance from the reference's base moment, plus that of the inverse from its Jacobian's.

    Args:
        base_moment: Predicted M(0), shape (n, 3), N m.
        inverse: Predicted inverse of dM(l)/dM(0), shape (n, 3, 3).
        label: The reference's M(0), shape (n, 3), N m.
        jacobian: dM(l)/dM(0) at the reference's shape, shape (n, 3, 3).
        scale: Moment by which distances are divided, N m.
        inverse_weight: Weight of the inverse.
    """
    distance = ((base_moment - label) / scale).square().sum(dim=1).mean()
    return distance + inverse_weight * inverse_loss(inverse, jacobian)


def inverse_loss(inverse: Tensor, jacobian: Tensor) -> Tensor:
    """Mean of |C J - I|^2: what is left of an error after a Newton step with C in the place of J's inverse."""
    identity = torch.eye(3, dtype=inverse.dtype, device=inverse.device)
    return (torch.matmul(inverse, jacobian) - identity).square().sum(dim=(1, 2)).mean()
