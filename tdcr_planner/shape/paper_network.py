"""The published network (Bensch et al. 2024): arc length and two tensions to position, rotation and curvature."""

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec

SECTOR = np.pi / 3.0


class PaperNetwork(nn.Module):
    """Inputs s, tau_1, tau_2; outputs p, theta and u there. One row a cross-section.

    Three tendons 120 degrees apart make the unloaded robot symmetric: every actuation is turned and mirrored into the
    sector of 60 degrees between the first tendon and half-way to the second, and the answer back. The module can be
    scripted.
    """

    directions: Tensor
    stops: Tensor

    def __init__(self, robot: RobotSpec, hidden: tuple[int, ...]) -> None:
        """Builds the network for a robot of one segment with three tendons 120 degrees apart.

        Raises:
            InputError: The robot is another kind.
        """
        super().__init__()
        angles = np.sort(np.mod(robot.tendon_angles, 2.0 * np.pi))
        even = robot.tendon_count == 3 and np.allclose(np.diff(angles), 2.0 * np.pi / 3.0, atol=1e-6)
        if robot.segment_count != 1 or not even or any(robot.backbone.rest_curvature_1_m):
            raise InputError(
                "network",
                "for `paper` a straight robot of one segment with three tendons 120 degrees apart",
                f"robot {robot.name!r} with {robot.segment_count} segment(s) and tendons at "
                f"{np.rad2deg(robot.tendon_angles).tolist()} degrees",
            )
        self.length = float(robot.length)
        self.largest = float(robot.max_tensions[0])
        # Between two tendons a force of that size takes up to 1 / cos(30 degrees) of it in one of them.
        self.largest_input = self.largest * 2.0 / 3.0**0.5
        self.first_angle = float(angles[0])
        directions = np.stack([np.cos(robot.tendon_angles), np.sin(robot.tendon_angles)], axis=1)
        self.register_buffer("directions", torch.as_tensor(directions))
        self.register_buffer("stops", torch.as_tensor(robot.arc_lengths[1:]).float())
        widths = [3, *hidden]
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.head = nn.Linear(widths[-1], 9)

    def forward(self, tensions: Tensor, gravity: Tensor, tip_force: Tensor) -> tuple[Tensor, Tensor]:  # noqa: ARG002
        """Returns the poses of all disks, base included; loads are not part of this network's domain.

        Args:
            tensions: Shape (n, 3), N.
            gravity: Shape (n, 3); ignored.
            tip_force: Shape (n, 3); ignored.

        Returns:
            Positions, shape (n, d, 3), m, and rotations, shape (n, d, 3, 3), base frame, in the dtype of `tensions`.
        """
        bending = torch.matmul(tensions.double(), self.directions)
        angle = torch.remainder(torch.atan2(bending[:, 1], bending[:, 0]) - self.first_angle, 2.0 * torch.pi)
        third = 2.0 * torch.pi / 3.0
        turns = torch.floor(angle / third)
        folded = angle - third * turns
        mirrored = folded > 0.5 * third
        folded = torch.where(mirrored, third - folded, folded)
        size = torch.linalg.vector_norm(bending, dim=1)
        pair = self.tensions_in_sector(folded, size)
        count, stops = pair.shape[0], self.stops.shape[0]
        rows = torch.cat(
            [
                self.stops.reshape(1, stops, 1).expand(count, stops, 1),
                pair.float().reshape(count, 1, 2).expand(count, stops, 2),
            ],
            dim=2,
        ).reshape(-1, 3)
        out = self.cross_sections(rows)
        position = out[:, 0:3].reshape(count, stops, 3)
        rotation = self.rotation(out[:, 3:6]).reshape(count, stops, 3, 3)
        # Undo the mirroring at the plane half-way between the first two tendons, then the turns by 120 degrees.
        plane = 2.0 * (self.first_angle + 0.5 * third)
        mirror = self._in_plane(
            torch.full_like(size, torch.cos(torch.tensor(plane)).item()),
            torch.full_like(size, torch.sin(torch.tensor(plane)).item()),
            -1.0,
        )
        identity = torch.eye(3, dtype=mirror.dtype, device=mirror.device).expand(count, 3, 3)
        mirror = torch.where(mirrored.reshape(-1, 1, 1), mirror, identity)
        turn = self._in_plane(torch.cos(third * turns), torch.sin(third * turns), 1.0)
        back = torch.matmul(turn, mirror).float().unsqueeze(1)
        position = torch.matmul(back, position.unsqueeze(3)).squeeze(3)
        rotation = torch.matmul(torch.matmul(back, rotation), back.transpose(2, 3))
        first = torch.zeros_like(position[:, :1])
        upright = torch.eye(3, dtype=rotation.dtype, device=rotation.device).expand(count, 1, 3, 3)
        positions, rotations = torch.cat([first, position], dim=1), torch.cat([upright, rotation], dim=1)
        return positions.to(tensions.dtype), rotations.to(tensions.dtype)

    @torch.jit.export
    def tensions_in_sector(self, angle: Tensor, size: Tensor) -> Tensor:
        """Returns the two tensions of a bending vector in the sector, shape (n, 2), N.

        Args:
            angle: From the first tendon, shape (n,), rad, 0 to 60 degrees.
            size: Length of the bending vector, shape (n,), N.
        """
        sine = 0.5 * 3.0**0.5
        second = size * torch.sin(angle) / sine
        first = size * (torch.cos(angle) + 0.5 * torch.sin(angle) / sine)
        return torch.stack([first, second], dim=1)

    @torch.jit.export
    def cross_sections(self, rows: Tensor) -> Tensor:
        """Returns p (m), theta (rad) and u (1/m), shape (n, 9), of rows s (m), tau_1, tau_2 (N), shape (n, 3)."""
        scale = torch.tensor(
            [self.length, self.largest_input, self.largest_input], dtype=rows.dtype, device=rows.device
        )
        y = rows / scale
        first = True
        for layer in self.layers:
            y = torch.nn.functional.silu(layer(y)) if first else torch.tanh(layer(y))
            first = False
        return self.head(y)

    @torch.jit.export
    def rotation(self, vector: Tensor) -> Tensor:
        """Returns exp([theta]x), shape (n, 3, 3), of rotation vectors (n, 3), smooth at zero."""
        square = (vector * vector).sum(dim=1).clamp(min=1e-12)
        angle = torch.sqrt(square)
        first = torch.sin(angle) / angle
        second = (1.0 - torch.cos(angle)) / square
        zero = torch.zeros_like(square)
        x, y, z = vector[:, 0], vector[:, 1], vector[:, 2]
        skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
        identity = torch.eye(3, dtype=vector.dtype, device=vector.device)
        return identity + first.reshape(-1, 1, 1) * skew + second.reshape(-1, 1, 1) * torch.matmul(skew, skew)

    def _in_plane(self, cosine: Tensor, sine: Tensor, sign: float) -> Tensor:
        """Matrices [[c, -sign s, 0], [s, sign c, 0], [0, 0, 1]]: turns about z (+1), mirrors through z (-1)."""
        zero, one = torch.zeros_like(cosine), torch.ones_like(cosine)
        rows = [cosine, -sign * sine, zero, sine, sign * cosine, zero, zero, zero, one]
        return torch.stack(rows, dim=1).reshape(-1, 3, 3)
