"""Where the published network is trained: collocation points and reference shapes (Bensch et al. 2024, Table I)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from tdcr_planner.learning.settings import PaperSettings
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.paper_network import SECTOR, PaperNetwork
from tdcr_planner.statics.solver import solve_statics

# The authors' grids leave out forces below this part of the largest.
_SMALLEST_FORCE = 0.1


@dataclass(frozen=True)
class ReferencePoints:
    """Cross-sections with the reference's answer.

    Attributes:
        rows: s (m), tau_1, tau_2 (N), shape (n, 3).
        positions: Shape (n, 3), m.
        rotations: Shape (n, 3, 3).
        curvatures: Shape (n, 3), 1/m.
        actuation: Number of the actuation that each belongs to, shape (n,).
    """

    rows: Tensor
    positions: Tensor
    rotations: Tensor
    curvatures: Tensor
    actuation: Tensor

    def take(self, chosen: Tensor) -> ReferencePoints:
        """Returns the points at some indices."""
        return ReferencePoints(*(part[chosen] for part in self._parts()))

    def to(self, device: torch.device) -> ReferencePoints:
        """Returns the points on a device."""
        return ReferencePoints(*(part.to(device) for part in self._parts()))

    def __len__(self) -> int:
        return len(self.rows)

    def _parts(self) -> tuple[Tensor, ...]:
        return self.rows, self.positions, self.rotations, self.curvatures, self.actuation


class PaperPoints:
    """The points of one training: the collocation grid, five sets of reference points and those for validation."""

    def __init__(
        self,
        robot: RobotSpec,
        network: PaperNetwork,
        settings: PaperSettings,
        largest_force: float,
        generator: np.random.Generator,
    ) -> None:
        """Solves the reference's shapes and divides their disks into training and validation.

        Args:
            robot: The robot.
            network: Its network, for the sector's tensions.
            settings: Sizes of the grids.
            largest_force: Largest length of the bending vector, N.
            generator: Decides the division.
        """
        self._network, self._settings, self._largest_force = network, settings, largest_force
        self._robot = robot
        self.grid = self._collocation_grid()
        last = robot.disk_count - 1
        inside = self._solve(self._actuations(*settings.reference_grid), 0)
        disk = torch.arange(len(inside)) % (last + 1)
        edge = self._solve(self._actuations(settings.edge_actuations, 1), int(inside.actuation[-1]) + 1)
        whole = {
            "at_base": inside.take(disk == 0),
            "between": inside.take((disk > 0) & (disk < last)),
            "at_tip": inside.take(disk == last),
            "largest_force": edge,
        }
        self.training: dict[str, ReferencePoints] = {}
        kept = []
        for name, points in whole.items():
            order = torch.from_numpy(generator.permutation(len(points)))
            count = max(1, round(settings.training_share * len(points)))
            self.training[name] = points.take(order[:count])
            kept.append(points.take(order[count:]))
        self.training["no_force"] = self._solve(torch.zeros(1, 2), 0)
        self.validation = ReferencePoints(
            *(torch.cat(parts) for parts in zip(*(p._parts() for p in kept), strict=True))
        )

    def resample(self, errors: Tensor, generator: np.random.Generator) -> Tensor:
        """Returns as many collocation points as the grid has, drawn around the actuations of largest error.

        Of the actuations with the largest position error on the validation points the worst are taken; in each, the
        arc lengths of its worst points, filled up with uniform ones. Every such centre gets the same number of draws
        from a normal distribution, cut off at the borders of the inputs.

        Args:
            errors: Position error at each validation point, shape (n,), m.
            generator: Decides the draws.
        """
        settings, actuation = self._settings, self.validation.actuation
        worst_of = torch.zeros(int(actuation.max()) + 1).scatter_reduce(0, actuation, errors, "amax")
        worst = torch.topk(worst_of, min(settings.worst_actuations, len(worst_of))).indices
        centres = []
        for index in worst.tolist():
            own = torch.nonzero(actuation == index).reshape(-1)
            rows = self.validation.rows[own[torch.argsort(errors[own], descending=True)]]
            rows = rows[: settings.worst_arc_lengths]
            filled = rows[:1].repeat(settings.worst_arc_lengths - len(rows), 1)
            filled[:, 0] = torch.from_numpy(generator.uniform(0.0, self._robot.length, len(filled)))
            centres.append(torch.cat([rows, filled]))
        whole = torch.cat(centres)
        around = whole[torch.arange(len(self.grid)) % len(whole)]
        spread = torch.tensor([settings.spread_arc_length_m, settings.spread_tension_n, settings.spread_tension_n])
        drawn = around + spread * torch.from_numpy(generator.normal(size=around.shape)).float()
        largest = self._network.largest_input
        upper = torch.tensor([self._robot.length, largest, largest])
        return torch.minimum(drawn.clamp(min=0.0), upper)

    def _actuations(self, directions: int, sizes: int) -> Tensor:
        """Returns the tensions of a grid in the sector, shape (directions * sizes, 2), N."""
        largest = self._largest_force
        angle = torch.linspace(0.0, SECTOR, directions)
        size = torch.linspace(_SMALLEST_FORCE * largest, largest, sizes) if sizes > 1 else torch.tensor([largest])
        angles, lengths = torch.meshgrid(angle, size, indexing="ij")
        return self._network.tensions_in_sector(angles.reshape(-1), lengths.reshape(-1)).float()

    def _collocation_grid(self) -> Tensor:
        stops, directions, sizes = self._settings.grid
        tensions = self._actuations(directions, sizes)
        s = torch.linspace(0.0, self._robot.length, stops)
        return torch.cat([s.repeat(len(tensions)).reshape(-1, 1), tensions.repeat_interleave(stops, dim=0)], dim=1)

    def _solve(self, pairs: Tensor, first: int) -> ReferencePoints:
        """Returns all disks of the reference's shapes under tensions (n, 2); the actuations count from `first`."""
        order = np.argsort(np.mod(self._robot.tendon_angles, 2.0 * np.pi))
        tensions = np.zeros((len(pairs), 3))
        tensions[:, order[:2]] = pairs.numpy()
        solution = solve_statics(self._robot, np.maximum(tensions, 0.0))
        relative = np.swapaxes(solution.rotations[:, :-1], -1, -2) @ solution.rotations[:, 1:]
        vectors = Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_rotvec().reshape(len(pairs), -1, 3)
        curvature = vectors / np.diff(solution.arc_lengths)[:, None]
        # The unloaded rod's curvature does not change along it: that of the gap before is that of the disk.
        curvature = np.concatenate([curvature[:, :1], curvature], axis=1)
        stops = torch.as_tensor(solution.arc_lengths).float()
        disks = len(stops)
        rows = [stops.repeat(len(pairs)).reshape(-1, 1), pairs.float().repeat_interleave(disks, dim=0)]
        return ReferencePoints(
            rows=torch.cat(rows, dim=1),
            positions=torch.as_tensor(solution.positions.reshape(-1, 3)).float(),
            rotations=torch.as_tensor(solution.rotations.reshape(-1, 3, 3)).float(),
            curvatures=torch.as_tensor(curvature.reshape(-1, 3)).float(),
            actuation=first + torch.arange(len(pairs)).repeat_interleave(disks),
        )
