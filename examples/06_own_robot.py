"""Describe a robot of one's own, train a small shape model for it, and ask it for a shape.

The training here is a short one, for seconds rather than minutes; `tdcr train my_robot.toml --out my_model.pt` does it
in full.

Run: python examples/06_own_robot.py --out out/examples
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tdcr_planner import load_robot, load_shape_model, solve_statics
from tdcr_planner.learning.settings import load_train_settings
from tdcr_planner.learning.train import train_model

ROBOT = """\
format = "tdcr-robot/1"
name = "thin"

[backbone]
youngs_modulus_pa = 60e9
poisson_ratio = 0.3
radius_m = 0.0004
density_kg_m3 = 6450.0

[[segments]]
length_m = 0.12
disks = 12
disk_radius_m = 0.005
disk_thickness_m = 0.001
disk_mass_kg = 0.0001
tendon_circle_radius_m = 0.004
tendon_angles_deg = [0.0, 90.0, 180.0, 270.0]
max_tension_n = 3.0
"""

SHORT_TRAINING = """\
format = "tdcr-train/1"
dataset = { cases = 8000, validation_cases = 1000 }
optimiser = { epochs = 10, batch_size = 256 }
bound = { alpha = 0.01, cases = 2000 }
"""


def main(out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    (out / "thin.toml").write_text(ROBOT)
    (out / "train.toml").write_text(SHORT_TRAINING)
    robot = load_robot(out / "thin.toml")
    card = train_model(robot, load_train_settings(out / "train.toml"), out / "thin.pt")
    print(card.describe())

    model = load_shape_model(out / "thin.pt", robot)
    tensions = robot.tensions_from_bending([[[1.0, 0.5]]])
    gravity = np.array([0.0, -9.81, 0.0])
    learned = model.disk_poses(tensions, gravity=gravity).positions[0, -1]
    reference = solve_statics(robot, tensions, gravity=gravity).positions[0, -1]
    print(f"tip by the model (mm):     {np.round(1e3 * learned, 3)}")
    print(f"tip by the reference (mm): {np.round(1e3 * reference, 3)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/examples"))
    main(parser.parse_args().out)
