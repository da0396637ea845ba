"""The `shooting` network: from tensions and loads to the rod's base moment, from there by mechanics to the shape."""

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.rod_kernel import SETTLING, rod_constants
from tdcr_planner.shape.shooting import Float32Array, ShootingWeights


class ShootingNetwork(nn.Module):
    """A small network predicts what the shooting method searches; the shape then follows from mechanics.

    Shapes of the cut form have three unknowns, the base moment M(0). The network gives it as B l, with l the scaled
    gravity and tip force and B a function of all inputs, so that it vanishes without loads as it must. It also gives
    C, an estimate of the inverse of dM(l)/dM(0). One integration to the tip measures the moment r that is left over
    there, M(0) - C r corrects the base moment (a Newton step whose Jacobian is learned), and a last integration gives
    the poses. So p(0) = 0, R(0) = I, R'R = I and |p'| = |v| hold by construction, and the residual of the cut form is
    known for every answer.

    The module can be scripted: everything that `forward` needs is in its buffers.
    """

    features: Tensor
    load_scale: Tensor
    gaps: Tensor
    offset_x: Tensor
    offset_y: Tensor
    offset_square: Tensor
    first_sums: Tensor
    second_sums: Tensor
    present: Tensor

    def __init__(
        self, robot: RobotSpec, hidden: tuple[int, ...], corrections: int, gravity_max: float, tip_force_max: float
    ) -> None:
        """Builds the network for a robot.

        Args:
            robot: The robot.
            hidden: Width of each hidden layer.
            corrections: Number of learned Newton steps.
            gravity_max: Largest gravity of the domain, m/s^2.
            tip_force_max: Largest tip force of the domain, N.
        """
        super().__init__()
        constants = rod_constants(robot)
        self.corrections = corrections
        self.settling = SETTLING
        features, load_scale = _feature_matrix(robot, constants.base_mass, gravity_max, tip_force_max)
        self.register_buffer("features", features)
        self.register_buffer("load_scale", load_scale)
        self.register_buffer("gaps", torch.as_tensor(constants.gaps))
        count = constants.tendon_count
        offsets = torch.as_tensor(constants.offsets[:count])
        squares = (offsets**2).sum(dim=1)
        self.register_buffer("offset_x", offsets[:, 0].clone())
        self.register_buffer("offset_y", offsets[:, 1].clone())
        self.register_buffer("offset_square", squares)
        self.register_buffer(
            "first_sums", torch.stack([offsets[:, 0], offsets[:, 1], torch.ones(count).double()], dim=1)
        )
        self.register_buffer("second_sums", torch.stack([squares, offsets[:, 0], offsets[:, 1]], dim=1))
        first = torch.as_tensor(constants.first_tendon)
        self.register_buffer("present", (torch.arange(count)[None, :] >= first[:, None]).double())
        self.base_mass = constants.base_mass
        widths = [features.shape[0], *hidden]
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.head = nn.Linear(widths[-1], 27)
        # The first guess is the unloaded rod: no base moment, and a tip moment that follows it one to one.
        nn.init.zeros_(self.head.weight)
        nn.init.zeros_(self.head.bias)

    def forward(self, tensions: Tensor, gravity: Tensor, tip_force: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the poses of all disks, base included, in the dtype of `tensions`.

        Args:
            tensions: Shape (n, t), N.
            gravity: Shape (n, 3), m/s^2, base frame.
            tip_force: Shape (n, 3), N, base frame.

        Returns:
            Positions, shape (n, d, 3), m, and rotations, shape (n, d, 3, 3), base frame.
        """
        tension, g, f = tensions.double(), gravity.double(), tip_force.double()
        moment, inverse = self.base_moment(tension, g, f)
        for _ in range(self.corrections):
            residual, _positions, _rotations = self.shoot(tension, g, f, moment)
            moment = moment - torch.matmul(inverse, residual.unsqueeze(2)).squeeze(2)
        _residual, positions, rotations = self.shoot(tension, g, f, moment)
        return positions.to(tensions.dtype), rotations.to(tensions.dtype)

    @torch.jit.export
    def base_moment(self, tensions: Tensor, gravity: Tensor, tip_force: Tensor) -> tuple[Tensor, Tensor]:
        """Returns M(0), shape (n, 3), N m, base frame, and C, shape (n, 3, 3), both float64; inputs as in `forward`."""
        inputs = torch.cat([tensions, gravity, tip_force], dim=1).to(self.features.dtype)
        # A fixed offset centres the features, whose range is 0 to 1 for the sums of tensions.
        x = torch.matmul(inputs, self.features[:, :-1].t()) + self.features[:, -1]
        loads = x[:, -6:] * self.load_scale
        y = x
        for layer in self.layers:
            z = layer(y)
            y = z * torch.rsqrt(1.0 + z * z)
        out = self.head(y)
        moment = torch.matmul(out[:, :18].reshape(-1, 3, 6), loads.unsqueeze(2)).squeeze(2)
        inverse = out[:, 18:].reshape(-1, 3, 3) + torch.eye(3, dtype=out.dtype, device=out.device)
        return moment.double(), inverse.double()

    @torch.jit.export
    def shoot(
        self, tensions: Tensor, gravity: Tensor, tip_force: Tensor, base_moment: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Integrates the cut form from the base to the tip; the compiled twin is `shape.rod_kernel.shoot`.

        Args:
            tensions: Shape (n, t), N, float64.
            gravity: Shape (n, 3), m/s^2, base frame.
            tip_force: Shape (n, 3), N, base frame.
            base_moment: Shape (n, 3), N m, base frame.

        Returns:
            The moment left over at the tip, shape (n, 3), N m, tip frame; positions, shape (n, d, 3), m; rotations,
            shape (n, d, 3, 3).
        """
        state = torch.stack([base_moment, tip_force + self.base_mass * gravity, gravity], dim=1)
        count = tensions.shape[0]
        position = torch.zeros_like(gravity)
        rotation = torch.eye(3, dtype=gravity.dtype, device=gravity.device).expand(count, 3, 3)
        positions, rotations = [position], [rotation]
        u, v = torch.zeros_like(gravity), torch.zeros_like(gravity)
        sums = torch.zeros_like(gravity)
        for k in range(self.gaps.shape[0]):
            gap = self.gaps[k]
            h = gap[0]
            tension = tensions * self.present[k]
            if k == 0 or bool((self.present[k] != self.present[k - 1]).any()):
                for _ in range(self.settling):
                    u, v, sums = self._strains(state, tension, gap, u, v, sums)
            u, v, sums = self._strains(state, tension, gap, u, v, sums)
            u0, v0 = u, v
            first = self._slope(state, u, v, gap)
            stage = state + 0.5 * h * first
            u, v, sums = self._strains(stage, tension, gap, u, v, sums)
            u1, v1 = u, v
            second = self._slope(stage, u, v, gap)
            stage = state + 0.5 * h * second
            u, v, sums = self._strains(stage, tension, gap, u, v, sums)
            u1, v1 = 0.5 * (u1 + u), 0.5 * (v1 + v)
            third = self._slope(stage, u, v, gap)
            stage = state + h * third
            u, v, sums = self._strains(stage, tension, gap, u, v, sums)
            fourth = self._slope(stage, u, v, gap)
            state = state + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
            state = torch.stack([state[:, 0], state[:, 1] - gap[11] * state[:, 2], state[:, 2]], dim=1)
            position, rotation = self._advance_pose(position, rotation, u0, v0, u1, v1, u, v, h)
            positions.append(position)
            rotations.append(rotation)
        return state[:, 0], torch.stack(positions, dim=1), torch.stack(rotations, dim=1)

    def _strains(
        self, state: Tensor, tension: Tensor, gap: Tensor, u: Tensor, v: Tensor, sums: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Curvature and linear strain at a cut; `sums` of tension times x, y, 1 and tangent z are carried along."""
        m, n = state[:, 0], state[:, 1]
        ux = gap[7] + (m[:, 0] - sums[:, 1]) / gap[1]
        uy = gap[8] + (m[:, 1] + sums[:, 0]) / gap[1]
        vz = 1.0 + (n[:, 2] - sums[:, 2]) / gap[6]
        uz = u[:, 2]
        along = vz.unsqueeze(1) + ux.unsqueeze(1) * self.offset_y - uy.unsqueeze(1) * self.offset_x
        share = tension * torch.rsqrt(along * along + (uz * uz).unsqueeze(1) * self.offset_square)
        sums = torch.matmul(share * along, self.first_sums)
        more = torch.matmul(share, self.second_sums)
        twist = m[:, 2] + gap[3] * gap[9] - v[:, 1] * more[:, 1] + v[:, 0] * more[:, 2]
        uz = twist / (gap[3] + more[:, 0])
        ux = gap[7] + (m[:, 0] - sums[:, 1]) / gap[1]
        uy = gap[8] + (m[:, 1] + sums[:, 0]) / gap[1]
        shear = gap[4] + sums[:, 2]
        vx = (n[:, 0] + uz * more[:, 2]) / shear
        vy = (n[:, 1] - uz * more[:, 1]) / shear
        vz = 1.0 + (n[:, 2] - sums[:, 2]) / gap[6]
        return torch.stack([ux, uy, uz], dim=1), torch.stack([vx, vy, vz], dim=1), sums

    def _slope(self, state: Tensor, u: Tensor, v: Tensor, gap: Tensor) -> Tensor:
        """The cut form, m' = m x u + n x v, n' = n x u - rho A g, g' = g x u, stacked as the state is, (n, 3, 3)."""
        turn = torch.cross(state, u.unsqueeze(1).expand(-1, 3, -1), dim=2)
        push = torch.cross(state[:, 1], v, dim=1)
        return turn + torch.stack([push, -gap[10] * state[:, 2], torch.zeros_like(push)], dim=1)

    def _advance_pose(
        self,
        position: Tensor,
        rotation: Tensor,
        u0: Tensor,
        v0: Tensor,
        u1: Tensor,
        v1: Tensor,
        u2: Tensor,
        v2: Tensor,
        h: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """One fourth-order Magnus step on SE(3); see `shape.rod_kernel`."""
        w = h / 6.0 * (u0 + 4.0 * u1 + u2) + h * h / 12.0 * torch.cross(u0, u2, dim=1)
        chord = h / 6.0 * (v0 + 4.0 * v1 + v2) + h * h / 12.0 * (
            torch.cross(u0, v2, dim=1) + torch.cross(v0, u2, dim=1)
        )
        t = (w * w).sum(dim=1, keepdim=True)
        s1 = 1.0 - t / 6.0 * (1.0 - t / 20.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0))))
        s2 = 0.5 - t / 24.0 * (1.0 - t / 30.0 * (1.0 - t / 56.0 * (1.0 - t / 90.0 * (1.0 - t / 132.0))))
        s3 = 1.0 / 6.0 - t / 120.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0 * (1.0 - t / 156.0))))
        once = torch.cross(w, chord, dim=1)
        chord = chord + s2 * once + s3 * torch.cross(w, once, dim=1)
        zero = torch.zeros_like(t)
        x, y, z = w[:, 0:1], w[:, 1:2], w[:, 2:3]
        skew = torch.cat([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
        identity = torch.eye(3, dtype=w.dtype, device=w.device)
        turn = identity + s1.unsqueeze(2) * skew + s2.unsqueeze(2) * torch.matmul(skew, skew)
        moved = position + torch.matmul(rotation, chord.unsqueeze(2)).squeeze(2)
        return moved, torch.matmul(rotation, turn)


def learned_weights(network: ShootingNetwork) -> ShootingWeights:
    """Returns what a network has learned, for the compiled path."""
    layers = [layer for layer in (*network.layers, network.head) if isinstance(layer, nn.Linear)]
    return ShootingWeights(
        features=_numbers(network.features),
        load_scale=_numbers(network.load_scale),
        matrices=tuple(_numbers(layer.weight) for layer in layers),
        biases=tuple(_numbers(layer.bias) for layer in layers),
        corrections=network.corrections,
    )


def _numbers(tensor: Tensor) -> Float32Array:
    return np.array(tensor.detach().cpu().numpy(), dtype=np.float32)


def _feature_matrix(
    robot: RobotSpec, base_mass: float, gravity_max: float, tip_force_max: float
) -> tuple[Tensor, Tensor]:
    """The affine map from inputs to features, shape (k, t + 7), and the moment that each of the six loads can exert.

    Features are the bending vector and the sum of tensions of each segment, and the loads, each of size about one: by
    these the tendons act, but for the second order of their twist about the backbone.
    """
    count = robot.tendon_count
    rows = []
    for index, (columns, _) in enumerate(robot.segment_circles):
        for kind in range(3):
            row = torch.zeros(count + 7, dtype=torch.float64)
            for tendon in range(count):
                if robot.tendon_segments[tendon] == index:
                    angle = torch.tensor(robot.tendon_angles[tendon])
                    factor = (torch.cos(angle), torch.sin(angle), torch.tensor(2.0 / len(columns)))
                    row[tendon] = factor[kind] / float(robot.max_tensions[tendon])
            if kind == 2:
                row[-1] = -1.0
            rows.append(row)
    for axis in range(6):
        largest = gravity_max if axis < 3 else tip_force_max
        row = torch.zeros(count + 7, dtype=torch.float64)
        row[count + axis] = 1.0 / largest if largest > 0.0 else 0.0
        rows.append(row)
    half = 0.5 * robot.length
    scale = torch.tensor([base_mass * gravity_max * half] * 3 + [tip_force_max * half] * 3)
    return torch.stack(rows).float(), scale.float()
