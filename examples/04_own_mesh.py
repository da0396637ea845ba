"""From one's own mesh in millimetres to a verified path: here the mesh is a plate with a hole, made on the spot.

Run: python examples/04_own_mesh.py --out out/examples
"""

from __future__ import annotations

import argparse
from pathlib import Path

import trimesh

from tdcr_planner import load_scenario, plan
from tdcr_planner.report.results import write_result

ROOT = Path(__file__).resolve().parents[1]

SCENARIO = """\
format = "tdcr-scenario/1"
title = "through a hole in a plate, then look down"
robot = "{root}/models/robots/inspection.toml"
shape_model = "{root}/models/shape/inspection/model.pt"
gravity_m_s2 = [0.0, 0.0, -9.81]

[[meshes]]
file = "plate.stl"
unit = "mm"
role = "obstacle"

[base]                                        # the base frame's z axis points along world x, its x axis down
position_m = [-0.22, 0.0, 0.0]
quaternion_wxyz = [0.7071067811865476, 0.0, 0.7071067811865476, 0.0]
insertion_m = [0.0, 0.2]

[start]
bending_n = [[-0.4, 0.0]]                     # held up against gravity

[goal]
tip_position_m = [0.12, 0.0, -0.08]
tip_tolerance_m = 0.003

[planner]
time_limit_s = 20.0
"""


def main(out: Path) -> None:
    folder = out / "own_mesh"
    folder.mkdir(parents=True, exist_ok=True)
    plate = trimesh.creation.annulus(r_min=40.0, r_max=120.0, height=10.0)
    plate.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
    plate.export(folder / "plate.stl")
    (folder / "scenario.toml").write_text(SCENARIO.format(root=ROOT.as_posix()))
    result = plan(load_scenario(folder / "scenario.toml"))
    print(f"{result.status.value}: {result.message}")
    print(f"wrote {write_result(result, folder)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/examples"))
    main(parser.parse_args().out)
