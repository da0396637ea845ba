"""Your own network: a plain PyTorch network, trained, exported, adopted and planned with, verified by the reference.

Run: python examples/07_own_network.py --out out/own_network
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tdcr_planner import load_robot, load_scenario, plan, solve_statics
from tdcr_planner.cli.main import run

ROOT = Path(__file__).resolve().parents[1]
ROBOT = ROOT / "models/robots/paper.toml"


class Plain(nn.Module):
    """Tensions (n, 3) in N to disk centres (n, 20, 3) in mm and rotation vectors, side by side; no base."""

    def __init__(self, disks: int) -> None:
        """Makes three hidden layers."""
        super().__init__()
        self.disks = disks
        self.layers = nn.Sequential(
            nn.Linear(3, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()
        )
        self.head = nn.Linear(64, 6 * disks)
        self.register_buffer("scale", torch.tensor([100.0, 100.0, 100.0, 1.5, 1.5, 1.5]))  # mm and rad

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Returns shape (n, disks, 6)."""
        return self.head(self.layers(x / 1.75 - 1.0)).reshape(-1, self.disks, 6) * self.scale


def shapes(count: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns tensions and what the network shall say of them, by the reference: two of three tendons pull."""
    robot = load_robot(ROBOT)
    generator = np.random.default_rng(seed)
    tensions = generator.uniform(0.0, robot.max_tensions, (count, 3))
    tensions[np.arange(count), generator.integers(0, 4, count) % 3] *= generator.uniform(size=count) < 0.3
    solution = solve_statics(robot, tensions)
    turn = solution.rotations[:, 1:]
    angle = np.arccos(np.clip((np.trace(turn, axis1=2, axis2=3) - 1.0) / 2.0, -1.0, 1.0))
    axis = np.stack(
        [turn[..., 2, 1] - turn[..., 1, 2], turn[..., 0, 2] - turn[..., 2, 0], turn[..., 1, 0] - turn[..., 0, 1]], -1
    )
    vectors = axis * (angle / np.maximum(2.0 * np.sin(angle), 1e-12))[..., None]
    labels = np.concatenate([1e3 * solution.positions[:, 1:], vectors], axis=2)
    return torch.tensor(tensions).float(), torch.tensor(labels).float()


def main(out: Path) -> None:
    torch.manual_seed(1)
    out.mkdir(parents=True, exist_ok=True)
    x, y = shapes(20_000, seed=1)
    network = Plain(y.shape[1])
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    steps = 3000
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for _ in range(steps):
        rows = torch.randint(len(x), (512,))
        loss = ((network(x[rows]) - y[rows]) / network.scale).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    print(f"trained: {100.0 * loss.item() ** 0.5:.2f} mm root mean square")
    torch.jit.script(network.eval()).save(out / "mine.pt")

    options = ["--outputs", "positions,rotation_vectors", "--length-unit", "mm", "--no-progress"]
    run(["adopt", str(out / "mine.pt"), "--robot", str(ROBOT), "--out", str(out / "model.pt"), *options])

    text = (ROOT / "scenes/duct/scenario_narrowing.toml").read_text(encoding="utf-8")
    text = text.replace("../../models/shape/paper/model.pt", str((out / "model.pt").resolve()))
    text = text.replace("../../models", str(ROOT / "models")).replace('file = "', f'file = "{ROOT}/scenes/duct/')
    (out / "scenario.toml").write_text(text, encoding="utf-8")
    result = plan(load_scenario(out / "scenario.toml"))
    worst = result.verification.worst if result.verification else {}
    off = 1e3 * worst.get("deviation_m", np.nan)
    print(f"{result.status.value}: the network was off by {off:.2f} mm at most on the path")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("out/own_network"))
    main(parser.parse_args().out)
