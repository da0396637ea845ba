"""Networks as other people write them, in many kinds and conventions, for the robot `paper` without loads.

Each kind adds a small output of its own to the arc that the unloaded robot is, so that it plans without a training.
"""

# ruff: noqa: D101, D102
from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Dict, List, NamedTuple, Tuple  # noqa: UP035  (TorchScript reads these)

import torch
from torch import Tensor, nn

from tdcr_planner.robot import RobotSpec


class Arc(nn.Module):
    """The arc of a straight robot of one segment: positions (n, d, 3) and rotations (n, d, 3, 3) of tensions (n, t)."""

    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        backbone = robot.segment_backbones[0]
        self.stiffness = float(backbone.stiffness_bending_torsion[0])
        self.axial = float(backbone.stiffness_shear_extension[2])
        self.register_buffer("offsets", torch.as_tensor(robot.tendon_offsets[:, :2].copy()))
        self.register_buffer("stops", torch.as_tensor(robot.arc_lengths.copy()))

    def forward(self, tensions: Tensor) -> Tuple[Tensor, Tensor]:  # noqa: UP006
        tension = tensions.to(self.offsets.dtype)
        pull = torch.matmul(tension, self.offsets) / self.stiffness
        stretch = 1.0 - tension.sum(dim=1, keepdim=True) / self.axial
        size = torch.sqrt((pull * pull).sum(dim=1, keepdim=True)).clamp(min=1e-6)
        way = pull / size
        angle = size * self.stops
        sine, cosine = torch.sin(angle), torch.cos(angle)
        out = stretch * (1.0 - cosine) / size
        positions = torch.stack([out * way[:, :1], out * way[:, 1:], stretch * sine / size], dim=2)
        x, y = way[:, :1].expand_as(sine), way[:, 1:].expand_as(sine)
        rows = [
            1.0 + (cosine - 1.0) * x * x, (cosine - 1.0) * x * y, sine * x,
            (cosine - 1.0) * x * y, 1.0 + (cosine - 1.0) * y * y, sine * y,
            -sine * x, -sine * y, cosine,
        ]  # fmt: skip
        return positions, torch.stack(rows, dim=2).reshape(-1, self.stops.shape[0], 3, 3)


class Kind(nn.Module):
    """Arc and small output of one architecture; `forward` as this project has it."""

    def __init__(self, robot: RobotSpec, net: nn.Module) -> None:
        super().__init__()
        self.arc = Arc(robot)
        self.net = net
        self.disks = robot.disk_count

    def forward(self, tensions: Tensor, gravity: Tensor, tip_force: Tensor) -> Tuple[Tensor, Tensor]:  # noqa: UP006
        positions, rotations = self.arc(tensions)
        x = torch.cat([tensions, gravity, tip_force], dim=1).float()
        change = torch.tanh(self.net(x)).reshape(-1, self.disks, 3)
        return positions + 1e-6 * change, rotations


class Residual(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.first = nn.Linear(9, 16)
        self.blocks = nn.ModuleList(nn.Sequential(nn.LayerNorm(16), nn.GELU(), nn.Linear(16, 16)) for _ in range(3))
        self.head = nn.Linear(16, out)

    def forward(self, x: Tensor) -> Tensor:
        y = self.first(x)
        for block in self.blocks:
            y = y + block(y)
        return self.head(y)


class Fourier(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.register_buffer("frequencies", torch.randn(9, 12))
        self.head = nn.Sequential(nn.Linear(24, 16), nn.SiLU(), nn.Linear(16, out))

    def forward(self, x: Tensor) -> Tensor:
        z = 6.2831853 * x @ self.frequencies
        return self.head(torch.cat([z.sin(), z.cos()], dim=-1))


class Attention(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.disks = out // 3
        self.embed = nn.Linear(9, 16)
        self.place = nn.Parameter(torch.randn(self.disks, 16))
        self.attention = nn.MultiheadAttention(16, 2, batch_first=True)
        self.head = nn.Linear(16, 3)

    def forward(self, x: Tensor) -> Tensor:
        tokens = self.embed(x).unsqueeze(1) + self.place
        mixed, _ = self.attention(tokens, tokens, tokens, need_weights=False)
        return self.head(tokens + mixed).flatten(1)


class Transformer(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.disks = out // 3
        self.embed = nn.Linear(9, 16)
        self.place = nn.Embedding(self.disks, 16)
        self.first = nn.LayerNorm(16)
        self.query, self.key, self.value = nn.Linear(16, 16), nn.Linear(16, 16), nn.Linear(16, 16)
        self.head = nn.Linear(16, 3)

    def forward(self, x: Tensor) -> Tensor:
        tokens = self.first(self.embed(x).unsqueeze(1) + self.place(torch.arange(self.disks, device=x.device)))
        weights = torch.softmax(self.query(tokens) @ self.key(tokens).transpose(1, 2) / 4.0, dim=-1)
        return self.head(tokens + weights @ self.value(tokens)).flatten(1)


class Recurrent(nn.Module):
    """Walks along the backbone, a step a disk."""

    def __init__(self, out: int, cell: str) -> None:
        super().__init__()
        self.disks = out // 3
        self.body = nn.GRU(9, 12, batch_first=True) if cell == "gru" else nn.LSTM(9, 12, batch_first=True)
        self.head = nn.Linear(12, 3)

    def forward(self, x: Tensor) -> Tensor:
        y, _ = self.body(x.unsqueeze(1).repeat(1, self.disks, 1))
        return self.head(y).flatten(1)


class Cell(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.disks = out // 3
        self.cell = nn.GRUCell(9, 12)
        self.head = nn.Linear(12, 3)

    def forward(self, x: Tensor) -> Tensor:
        h = torch.zeros(x.shape[0], 12, dtype=x.dtype, device=x.device)
        found: List[Tensor] = []  # noqa: UP006
        for _ in range(self.disks):
            h = self.cell(x, h)
            found.append(self.head(h))
        return torch.stack(found, dim=1).flatten(1)


class NeuralOde(nn.Module):
    """A field in arc length, integrated by Runge-Kutta steps of a fixed number."""

    def __init__(self, out: int) -> None:
        super().__init__()
        self.disks = out // 3
        self.field = nn.Sequential(nn.Linear(12, 16), nn.Tanh(), nn.Linear(16, 3))

    def slope(self, y: Tensor, x: Tensor) -> Tensor:
        return self.field(torch.cat([y, x], dim=1))

    def forward(self, x: Tensor) -> Tensor:
        y = torch.zeros_like(x[:, :3])
        found: List[Tensor] = []  # noqa: UP006
        h = 1.0 / self.disks
        for _ in range(self.disks):
            first = self.slope(y, x)
            second = self.slope(y + 0.5 * h * first, x)
            third = self.slope(y + 0.5 * h * second, x)
            fourth = self.slope(y + h * third, x)
            y = y + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
            found.append(y)
        return torch.cat(found, dim=1)


class Ensemble(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.members = nn.ModuleList(plain(out) for _ in range(4))

    def forward(self, x: Tensor) -> Tensor:
        found: List[Tensor] = []  # noqa: UP006
        for member in self.members:
            found.append(member(x))
        return torch.stack(found).mean(dim=0)


class Experts(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.gate = nn.Linear(9, 3)
        self.weights = nn.Parameter(torch.randn(3, 9, out))

    def forward(self, x: Tensor) -> Tensor:
        return torch.einsum("ne,ni,eio->no", torch.softmax(self.gate(x), dim=1), x, self.weights)


class Sine(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.first, self.second, self.head = nn.Linear(9, 16), nn.Linear(16, 16), nn.Linear(16, out)

    def forward(self, x: Tensor) -> Tensor:
        return self.head(torch.sin(30.0 * self.second(torch.sin(30.0 * self.first(x)))))


class Splines(nn.Module):
    """Radial functions on a grid in each input, as in Kolmogorov-Arnold networks."""

    def __init__(self, out: int) -> None:
        super().__init__()
        self.register_buffer("grid", torch.linspace(-1.0, 4.0, 6))
        self.weights = nn.Parameter(torch.randn(9 * 6, out))

    def forward(self, x: Tensor) -> Tensor:
        return torch.exp(-((x.unsqueeze(-1) - self.grid) ** 2)).flatten(1) @ self.weights


class Convolution(nn.Module):
    def __init__(self, out: int) -> None:
        super().__init__()
        self.disks = out // 3
        self.spread = nn.Linear(9, 4 * self.disks)
        self.layers = nn.Sequential(
            nn.Conv1d(4, 8, 3, padding=1), nn.BatchNorm1d(8), nn.ReLU(), nn.Conv1d(8, 3, 3, padding=1)
        )

    def forward(self, x: Tensor) -> Tensor:
        return self.layers(self.spread(x).reshape(-1, 4, self.disks)).transpose(1, 2).flatten(1)


class Modes(nn.Module):
    """Coefficients of shape functions in arc length."""

    def __init__(self, out: int) -> None:
        super().__init__()
        self.disks = out // 3
        self.head = nn.Sequential(nn.Linear(9, 16), nn.Softplus(), nn.Linear(16, 12))

    def forward(self, x: Tensor) -> Tensor:
        s = torch.linspace(0.0, 1.0, self.disks, device=x.device)
        basis = torch.stack([s, s**2, s**3, s**4], dim=0)
        return torch.matmul(self.head(x).reshape(-1, 3, 4), basis).transpose(1, 2).flatten(1)


class Branching(nn.Module):
    """Control flow that depends on the data and on attributes, with a message for a wrong input."""

    def __init__(self, out: int) -> None:
        super().__init__()
        self.net = plain(out)
        self.scale = 2.0

    def forward(self, x: Tensor) -> Tensor:
        assert x.dim() == 2, f"expected a batch, got {x.dim()} axes"
        if x.shape[1] != 9:
            raise ValueError("expected nine inputs")
        y = self.net(x)
        return torch.where(y > 0.0, self.scale * y, y)


def plain(out: int) -> nn.Sequential:
    """Returns two hidden layers."""
    return nn.Sequential(nn.Linear(9, 16), nn.Tanh(), nn.Linear(16, 16), nn.LeakyReLU(), nn.Linear(16, out))


ARCHITECTURES: dict[str, Callable[[int], nn.Module]] = {
    "plain": plain,
    "dropout": lambda out: nn.Sequential(nn.Linear(9, 16), nn.ELU(), nn.Dropout(0.2), nn.Linear(16, out)),
    "batch norm": lambda out: nn.Sequential(nn.Linear(9, 16), nn.BatchNorm1d(16), nn.Mish(), nn.Linear(16, out)),
    "weight norm": lambda out: nn.Sequential(nn.Linear(9, 16), nn.Hardswish(), nn.GroupNorm(2, 16), nn.Linear(16, out)),
    "residual": Residual,
    "fourier": Fourier,
    "attention": Attention,
    "transformer": Transformer,
    "gru": lambda out: Recurrent(out, "gru"),
    "lstm": lambda out: Recurrent(out, "lstm"),
    "recurrent cell": Cell,
    "neural ode": NeuralOde,
    "ensemble": Ensemble,
    "experts": Experts,
    "sine": Sine,
    "splines": Splines,
    "convolution": Convolution,
    "modes": Modes,
    "branching": Branching,
}


class Posed(NamedTuple):
    """Outputs by name."""

    positions: Tensor
    rotations: Tensor


class NamedOutputs(nn.Module):
    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        self.arc = Arc(robot)

    def forward(self, tensions: Tensor) -> Posed:
        positions, rotations = self.arc(tensions)
        return Posed(positions, rotations)


class TableOutputs(nn.Module):
    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        self.arc = Arc(robot)

    def forward(self, tensions: Tensor) -> Dict[str, Tensor]:  # noqa: UP006
        positions, rotations = self.arc(tensions)
        return {"rotations": rotations, "positions": positions}


class Converted(nn.Module):
    """The arc in another convention."""

    def __init__(
        self,
        robot: RobotSpec,
        *,
        scale: float = 1.0,
        order: Tuple[int, ...] = (0, 1, 2),  # noqa: UP006
        turn_deg: float = 0.0,
        transposed: bool = False,
        reverse: bool = False,
    ) -> None:
        super().__init__()
        self.arc = Arc(robot)
        self.scale, self.transposed, self.reverse = scale, transposed, reverse
        self.register_buffer("order", torch.tensor(order))
        angle = torch.deg2rad(torch.tensor(turn_deg, dtype=torch.float64))
        c, s = torch.cos(angle).item(), torch.sin(angle).item()
        turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
        self.register_buffer("turn", turn)

    def forward(self, tensions: Tensor) -> Tuple[Tensor, Tensor]:  # noqa: UP006
        positions, rotations = self.arc(tensions[:, self.order])
        positions = self.scale * torch.matmul(positions, self.turn.t())
        rotations = torch.matmul(torch.matmul(self.turn, rotations), self.turn.t())
        if self.transposed:
            rotations = rotations.transpose(2, 3)
        if self.reverse:
            positions, rotations = positions.flip(1), rotations.flip(1)
        return positions, rotations


class Quaternions(nn.Module):
    """Positions and quaternions side by side, without the base; `x` says nothing of what it takes."""

    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        self.arc = Arc(robot)

    def forward(self, x: Tensor) -> Tensor:
        positions, rotations = self.arc(x)
        half = 0.5 * torch.acos(rotations[:, :, 2, 2].clamp(-1.0, 1.0))
        axis = torch.stack([-rotations[:, :, 1, 2], rotations[:, :, 0, 2]], dim=2)
        axis = axis / (torch.linalg.vector_norm(axis, dim=2, keepdim=True) + 1e-300)
        sine = torch.sin(half).unsqueeze(2)
        quaternions = torch.cat([torch.cos(half).unsqueeze(2), sine * axis, torch.zeros_like(sine)], dim=2)
        return torch.cat([positions, quaternions], dim=2)[:, 1:]


class PositionsAlone(nn.Module):
    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        self.arc = Arc(robot)

    def forward(self, tensions: Tensor) -> Tensor:
        return self.arc(tensions)[0]


class RowPerPoint(nn.Module):
    """Arc length and tensions of one cross-section a row; positions, rotation vectors and what else it knows."""

    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        self.arc = Arc(robot)

    def forward(self, rows: Tensor) -> Tensor:
        pull = torch.matmul(rows[:, 1:], self.arc.offsets) / self.arc.stiffness
        stretch = 1.0 - rows[:, 1:].sum(dim=1, keepdim=True) / self.arc.axial
        size = torch.sqrt((pull * pull).sum(dim=1, keepdim=True)).clamp(min=1e-6)
        angle = size * rows[:, :1]
        side = stretch * (1.0 - torch.cos(angle)) / size * pull / size
        ahead = stretch * torch.sin(angle) / size
        turn = torch.cat([-pull[:, 1:], pull[:, :1], torch.zeros_like(size)], dim=1) / size * angle
        return torch.cat([side, ahead, turn, torch.zeros_like(turn)], dim=1)


class Faulty(nn.Module):
    """The arc with one fault."""

    def __init__(self, robot: RobotSpec, fault: str) -> None:
        super().__init__()
        self.arc = Arc(robot)
        self.fault = fault

    def forward(self, tensions: Tensor) -> Tuple[Tensor, Tensor]:  # noqa: UP006
        positions, rotations = self.arc(tensions)
        if self.fault == "nan":
            positions = positions + 0.0 * torch.log(4.0 - tensions.sum(dim=1)).reshape(-1, 1, 1)
        elif self.fault == "batch":
            positions = positions - 0.1 * positions.mean(dim=0, keepdim=True)
        elif self.fault == "random":
            positions = torch.dropout(positions, 0.5, True)
        elif self.fault == "shape":
            positions, rotations = positions[:, :7], rotations[:, :7]
        elif self.fault == "half":
            positions, rotations = positions.half(), rotations.half()
        elif self.fault == "gpu":
            positions = positions.to(torch.device("cuda:0"))
        elif self.fault == "memory":
            positions = positions.repeat(1, 200 * 200 * tensions.shape[1], 3000)[:, :21, :3]
        return positions, rotations


def make(name: str, robot: RobotSpec) -> nn.Module:
    """Returns a network of an architecture, with the same weights each time."""
    torch.manual_seed(7)
    return Kind(robot, ARCHITECTURES[name](3 * robot.disk_count)).eval()


def example(count: int = 3) -> tuple[Tensor, Tensor, Tensor]:
    """Returns inputs of a few states."""
    generator = torch.Generator().manual_seed(3)
    tensions = 3.0 * torch.rand(count, 3, generator=generator, dtype=torch.float64)
    return tensions, torch.zeros(count, 3, dtype=torch.float64), torch.zeros(count, 3, dtype=torch.float64)


def script(network: nn.Module) -> torch.jit.ScriptModule:
    """Returns a network as TorchScript."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return torch.jit.script(network)


def to_bytes(module: torch.jit.ScriptModule) -> bytes:
    """Returns what `torch.jit.save` writes."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.jit.save(module, buffer)
    return buffer.getvalue()


def scripted(name: str, robot: RobotSpec) -> bytes:
    """Returns an architecture as a scripted module."""
    return to_bytes(script(make(name, robot)))


def traced(name: str, robot: RobotSpec, *, freeze: bool = False) -> bytes:
    """Returns an architecture as a traced module, with its weights as constants where frozen."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        module = torch.jit.trace(make(name, robot), example(), check_trace=False)
        return to_bytes(torch.jit.freeze(module) if freeze else module)


def frozen(name: str, robot: RobotSpec) -> bytes:
    """Returns an architecture as a scripted module with its weights as constants."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return to_bytes(torch.jit.freeze(script(make(name, robot))))


def exported(name: str, robot: RobotSpec, path: Path) -> Path:
    """Writes an architecture as an ONNX file, by `torch.export`."""
    batch = torch.export.Dim("batch", min=1, max=100_000)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            make(name, robot),
            example(),
            path,
            input_names=["tensions", "gravity", "tip_force"],
            output_names=["positions", "rotations"],
            dynamic_shapes={key: {0: batch} for key in ("tensions", "gravity", "tip_force")},
            dynamo=True,
            external_data=False,
            verbose=False,
        )
    return path


def honest_modules(robot: RobotSpec) -> dict[str, Callable[[], bytes]]:
    """Returns all honest TorchScript modules by name, each made when it is called."""
    found: dict[str, Callable[[], bytes]] = {
        name: lambda name=name: scripted(name, robot)  # type: ignore[misc]
        for name in ARCHITECTURES
    }
    for name in ("plain", "residual", "fourier", "attention", "gru", "convolution"):
        found[f"{name}, traced"] = lambda name=name: traced(name, robot)  # type: ignore[misc]
    for name in ("plain", "neural ode", "attention"):
        found[f"{name}, frozen"] = lambda name=name: frozen(name, robot)  # type: ignore[misc]
    found["ensemble, traced and frozen"] = lambda: traced("ensemble", robot, freeze=True)
    found["single precision"] = lambda: to_bytes(script(make("plain", robot).float()))
    found["named outputs"] = lambda: to_bytes(script(NamedOutputs(robot).eval()))
    found["outputs in a table"] = lambda: to_bytes(script(TableOutputs(robot).eval()))
    return found
