"""The equations that the published network is trained on: the unloaded rod with v = e3 (Bensch et al. 2024)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.paper_network import PaperNetwork

# The authors keep the cosine of (20) this far from one, where acos has no slope.
_COSINE_LIMIT = 0.99999


class RodResiduals(NamedTuple):
    """What is left of the rod's differential equations at n cross-sections; all zero on a solution.

    Attributes:
        position: p' - R e3, shape (n, 3).
        rotation: R' - R [u]x, shape (n, 3, 3), 1/m.
        curvature: u' less its value by the equations, shape (n, 3), 1/m^2.
        strain: v' = 0 less its value by the equations, shape (n, 3), 1/m. Zero only without tension: with v held at e3
            the tendons' transverse force has nothing to balance it.
    """

    position: Tensor
    rotation: Tensor
    curvature: Tensor
    strain: Tensor


class RodEquations(nn.Module):
    """The robot's constants, and the residuals of its equations at the outputs of a network."""

    offsets: Tensor
    bending: Tensor
    stiffness: Tensor

    def __init__(self, robot: RobotSpec, network: PaperNetwork) -> None:
        """Takes the two tendons that the network's inputs pull."""
        super().__init__()
        order = np.argsort(np.mod(robot.tendon_angles, 2.0 * np.pi))
        bending = torch.tensor(robot.backbone.stiffness_bending_torsion)
        shear = torch.tensor(robot.backbone.stiffness_shear_extension)
        self.network = network
        self.register_buffer("offsets", torch.as_tensor(robot.tendon_offsets[order[:2]]).float())
        self.register_buffer("bending", bending)
        self.register_buffer("stiffness", torch.diag(torch.cat([shear, bending])))

    def residuals(self, rows: Tensor) -> RodResiduals:
        """Returns the residuals at collocation points.

        Args:
            rows: s (m), tau_1, tau_2 (N), shape (n, 3).
        """
        along = torch.zeros_like(rows)
        along[:, 0] = 1.0

        def evaluate(inputs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
            out = self.network.cross_sections(inputs)
            return out[:, 0:3], self.network.rotation(out[:, 3:6]), out[:, 6:9]

        values, slopes = torch.func.jvp(evaluate, (rows,), (along,))[:2]
        (_, rotation, u), (p_slope, rotation_slope, u_slope) = values, slopes
        turn = torch.matmul(rotation, _skew(u))
        v_slope, balanced = self._strain_slopes(u, rows[:, 1:])
        return RodResiduals(p_slope - rotation[:, :, 2], rotation_slope - turn, u_slope - balanced, -v_slope)

    def _strain_slopes(self, u: Tensor, tensions: Tensor) -> tuple[Tensor, Tensor]:
        """Returns v' and u' of the unloaded rod with v = e3: [Kse + A, G; B, Kbt + H] [v'; u'] = [d; c].

        Rucker and Webster 2011, eq. 17.
        """
        v = torch.zeros_like(u)
        v[:, 2] = 1.0
        u_hat = _skew(u)
        matrix = self.stiffness.to(u.dtype).expand(len(u), 6, 6)
        forces, moments = torch.zeros_like(u), torch.zeros_like(u)
        for index in range(2):
            offset = self.offsets[index].to(u.dtype).expand_as(u)
            tangent = torch.linalg.cross(u, offset, dim=1) + v
            tangent_hat, offset_hat = _skew(tangent), _skew(offset)
            size = torch.linalg.vector_norm(tangent, dim=1).reshape(-1, 1, 1)
            A = -tensions[:, index].reshape(-1, 1, 1) * torch.matmul(tangent_hat, tangent_hat) / size**3
            B = torch.matmul(offset_hat, A)
            upper = torch.cat([A, -torch.matmul(A, offset_hat)], dim=2)
            lower = torch.cat([B, -torch.matmul(B, offset_hat)], dim=2)
            matrix = matrix + torch.cat([upper, lower], dim=1)
            a = torch.matmul(A, torch.matmul(u_hat, tangent.unsqueeze(2))).squeeze(2)
            forces = forces - a
            moments = moments - torch.linalg.cross(offset, a, dim=1)
        moments = moments - torch.linalg.cross(u, self.bending.to(u.dtype) * u, dim=1)
        solved: Tensor = torch.linalg.solve(matrix, torch.cat([forces, moments], dim=1))
        return solved[:, :3], solved[:, 3:]

    def moment_of_tendons(self, rotation: Tensor, tensions: Tensor) -> Tensor:
        """Returns R sum r_i x (-tau_i e3), the moment with which the tendons end at the tip.

        Args:
            rotation: At the tip, shape (n, 3, 3).
            tensions: Shape (n, 2), N.

        Returns:
            Shape (n, 3), N m, base frame.
        """
        pull = torch.zeros_like(rotation[:, 0])
        for index in range(2):
            force = torch.zeros_like(pull)
            force[:, 2] = -tensions[:, index]
            offset = self.offsets[index].to(pull.dtype).expand_as(pull)
            pull = pull + torch.linalg.cross(offset, force, dim=1)
        return torch.matmul(rotation, pull.unsqueeze(2)).squeeze(2)

    def bending_moment(self, rotation: Tensor, u: Tensor) -> Tensor:
        """Returns R Kbt u, shape (n, 3), N m, base frame, of rotations (n, 3, 3) and curvatures (n, 3)."""
        return torch.matmul(rotation, (self.bending.to(u.dtype) * u).unsqueeze(2)).squeeze(2)


def rotation_distance_loss(a: Tensor, b: Tensor) -> Tensor:
    """Mean angle between rotations (n, 3, 3), (20), by the clamped arc cosine of the trace as the authors have it."""
    trace = torch.einsum("nij,nij->n", a, b)
    return torch.acos(((trace - 1.0) / 2.0).clamp(-_COSINE_LIMIT, _COSINE_LIMIT)).mean()


def _skew(vector: Tensor) -> Tensor:
    zero = torch.zeros_like(vector[:, 0])
    x, y, z = vector[:, 0], vector[:, 1], vector[:, 2]
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
