"""The table of subcommands: name to function."""

from __future__ import annotations

from collections.abc import Callable

from tdcr_planner.cli.adopt import adopt
from tdcr_planner.cli.calibrate import calibrate
from tdcr_planner.cli.compare import compare
from tdcr_planner.cli.design import design
from tdcr_planner.cli.evaluate import evaluate
from tdcr_planner.cli.info import info
from tdcr_planner.cli.inspect import inspect
from tdcr_planner.cli.plan import plan
from tdcr_planner.cli.reach import reach
from tdcr_planner.cli.roadmap import roadmap
from tdcr_planner.cli.robustness import robustness
from tdcr_planner.cli.scene import scene
from tdcr_planner.cli.solve import solve
from tdcr_planner.cli.sweep import sweep
from tdcr_planner.cli.train import train
from tdcr_planner.cli.verify import verify
from tdcr_planner.cli.view import view

COMMANDS: dict[str, Callable[..., int]] = {
    "plan": plan,
    "inspect": inspect,
    "reach": reach,
    "design": design,
    "verify": verify,
    "roadmap": roadmap,
    "robustness": robustness,
    "view": view,
    "scene": scene,
    "compare": compare,
    "sweep": sweep,
    "solve": solve,
    "train": train,
    "adopt": adopt,
    "evaluate": evaluate,
    "calibrate": calibrate,
    "info": info,
}
