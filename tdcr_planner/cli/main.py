"""The entry point of the tdcr command: subcommands in, exit code out, no traceback for a user's mistake."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence

from tdcr_planner.cli.fault import EXIT_FAULT, describe_memory_fault, is_memory_fault, report_fault
from tdcr_planner.cli.signals import ending_signals, was_interrupted
from tdcr_planner.cli.streams import discard_output, one_line, prepare_streams
from tdcr_planner.errors import TdcrError, WorkersError

DESCRIPTION = """Plan, verify and look at tendon trajectories of continuum robots in triangle meshes.

Exit codes: 0 done (for plan: a verified path), 1 tried and not reached, 2 bad input, 70 a fault of the program.
"""
EXIT_NOT_REACHED = 1
EXIT_BAD_INPUT = 2


def run(arguments: Sequence[str] | None = None) -> int:
    """Runs one subcommand and returns its exit code.

    Args:
        arguments: The command line without the program's name; None for the process's own.
    """
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s", force=True)
    try:
        # Imported here, where an interrupt during the imports is answered like a later one.
        import tyro

        from tdcr_planner.cli.commands import COMMANDS

        return tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="tdcr", description=DESCRIPTION, args=arguments)
    except WorkersError as error:
        print(f"not done: {one_line(str(error))}; earlier files are as they were", file=sys.stderr)
        return EXIT_NOT_REACHED
    except TdcrError as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        return _say_interrupted()
    except Exception as error:
        # Compiled code and imports may turn an interrupt into an error of their own.
        if was_interrupted():
            return _say_interrupted()
        if is_memory_fault(error):
            print(describe_memory_fault(), file=sys.stderr)
            return EXIT_NOT_REACHED
        if isinstance(error, OSError) and error.filename is None:
            raise  # of standard output: the caller says so
        print(report_fault(error, arguments), file=sys.stderr)
        return EXIT_FAULT


def main() -> None:
    """Runs the tdcr command of this process."""
    with ending_signals():
        code = EXIT_NOT_REACHED
        try:
            prepare_streams()
            code = run()
            sys.stdout.flush()
        except KeyboardInterrupt:
            # One more interrupt, while the first was being answered, or one after the end.
            pass
        except OSError as error:
            if error.filename is not None:
                raise
            print(f"error: the output cannot be written: {error.strerror}", file=sys.stderr)
            discard_output(sys.stdout)
            code = EXIT_NOT_REACHED
    sys.exit(code)


def _say_interrupted() -> int:
    print("interrupted: no file is left half-written, and what was finished before is kept", file=sys.stderr)
    return EXIT_NOT_REACHED
