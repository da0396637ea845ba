"""The entry point of the tdcr command: subcommands in, exit code out, no traceback for a user's mistake."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence

import tyro

from tdcr_planner.cli.compare import compare
from tdcr_planner.cli.evaluate import evaluate
from tdcr_planner.cli.fault import EXIT_FAULT, describe_memory_fault, is_memory_fault, report_fault
from tdcr_planner.cli.info import info
from tdcr_planner.cli.plan import plan
from tdcr_planner.cli.roadmap import roadmap
from tdcr_planner.cli.robustness import robustness
from tdcr_planner.cli.solve import solve
from tdcr_planner.cli.sweep import sweep
from tdcr_planner.cli.train import train
from tdcr_planner.cli.verify import verify
from tdcr_planner.cli.view import view
from tdcr_planner.errors import TdcrError
from tdcr_planner.workers import WorkersError

DESCRIPTION = """Plan, verify and look at tendon trajectories of continuum robots in triangle meshes.

Exit codes: 0 done (for plan: a verified path), 1 tried and not reached, 2 bad input, 70 a fault of the program.
"""
COMMANDS: dict[str, Callable[..., int]] = {
    "plan": plan,
    "verify": verify,
    "roadmap": roadmap,
    "robustness": robustness,
    "view": view,
    "compare": compare,
    "sweep": sweep,
    "solve": solve,
    "train": train,
    "evaluate": evaluate,
    "info": info,
}
EXIT_NOT_REACHED = 1
EXIT_BAD_INPUT = 2


def run(arguments: Sequence[str] | None = None) -> int:
    """Runs one subcommand and returns its exit code.

    Args:
        arguments: The command line without the program's name; None for the process's own.
    """
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s", force=True)
    try:
        return tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="tdcr", description=DESCRIPTION, args=arguments)
    except WorkersError as error:
        print(f"not done: {error}; earlier files are as they were", file=sys.stderr)
        return EXIT_NOT_REACHED
    except TdcrError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("interrupted: nothing was written by this run; earlier files are as they were", file=sys.stderr)
        return EXIT_NOT_REACHED
    except BrokenPipeError:
        raise
    except Exception as error:
        if is_memory_fault(error):
            print(describe_memory_fault(), file=sys.stderr)
            return EXIT_NOT_REACHED
        print(report_fault(error, arguments), file=sys.stderr)
        return EXIT_FAULT


def main() -> None:
    """Runs the tdcr command of this process."""
    try:
        code = run()
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever reads the output, `head` for example, has seen enough. Python would complain once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_NOT_REACHED
    sys.exit(code)
