"""Damaged and absurd inputs to every command, file and option: none may end in a traceback, a hang or a wrong answer.

Run `python benchmarks/fuzz.py --inputs 2000 --seed 1`; `--kinds model roadmap` takes some kinds alone. Each input is
given to the command line in a process of its own, forked from one that has imported it; the process has a minute of
processor time and 8 GB. Prints a table and every input that failed; exit code 1 where one did.

- fault: exit code 70, a traceback, or a process that died;
- hang: more than that minute, or than three on the clock;
- accepted: exit code 0 or 1 though the schema forbids the input;
- changed: a damaged binary file that is read as another one than the whole.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from fuzz_inputs import REFUSED, SAME
from fuzz_kinds import KINDS, Kind, prepare

from tdcr_planner.cli.main import run

LIMIT_S = 60.0
MEMORY_BYTES = 8 * 2**30


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        code: Exit code, or minus the signal.
        out: Standard output.
        err: Standard error.
        hung: Whether it was stopped after a minute.
        seconds: How long it took.
    """

    code: int
    out: str
    err: str
    hung: bool
    seconds: float


@dataclass
class Tally:
    """What came of the inputs of a kind."""

    inputs: int = 0
    codes: Counter[int] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)


def in_child(folder: Path, function: Callable[[], int], limit_s: float = LIMIT_S) -> Ended:
    """Returns how a function ended in a forked process whose working folder is `folder`."""
    begin = time.monotonic()
    out, err = folder / ".out", folder / ".err"
    child = os.fork()
    if child == 0:
        code = 99
        try:
            os.setpgid(0, 0)
            os.chdir(folder)
            for file, stream in ((out, 1), (err, 2)):
                os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s), int(limit_s)))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
            code = function()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            with contextlib.suppress(BaseException):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)
    status = None
    while status is None and time.monotonic() - begin < 3.0 * limit_s:
        done, state = os.waitpid(child, os.WNOHANG)
        if done:
            status = os.waitstatus_to_exitcode(state)
        else:
            time.sleep(0.005)
    hung = status is None or status == -signal.SIGXCPU
    if status is None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    texts = [file.read_text("utf-8", "replace") if file.exists() else "" for file in (out, err)]
    return Ended(int(status or 0), texts[0], texts[1], hung, time.monotonic() - begin)


def judge(ended: Ended, expected: str, whole: str) -> str:
    """Returns in what an input failed; empty for nothing.

    Args:
        ended: How the command ended.
        expected: What must come of it.
        whole: What the command prints for the whole file.
    """
    if ended.hung:
        return "hang"
    if ended.code not in (0, 1, 2) or "Traceback" in ended.err or "Traceback" in ended.out:
        return "fault"
    if expected == REFUSED and ended.code != 2:
        return "accepted"
    if expected == SAME and ended.code != 2 and ended.out != whole:
        return "changed"
    return ""


def fuzz(inputs: int, seed: int, kinds: list[Kind], folder: Path, told: Callable[[str], None]) -> dict[str, Tally]:
    """Gives inputs to the kinds in turn; returns what came of them by kind.

    Args:
        inputs: How many.
        seed: Decides them.
        kinds: What to damage.
        folder: An empty folder to work in.
        told: Called with a line for each input that failed, and now and then for how many there were.
    """
    base = folder / "base"
    base.mkdir()
    # The first run on a machine compiles.
    # A fork leaves torch's threads behind, and what waits for them waits for ever.
    torch.set_num_threads(1)
    made = in_child(base, lambda: prepare(base), limit_s=10.0 * LIMIT_S)
    if made.code != 0:
        raise SystemExit(f"the whole files could not be made: {made.err}")
    wholes: dict[tuple[str, ...], str] = {}
    for command in sorted({command for kind in kinds for command in kind.commands}):
        # Here first, so that the processes to come find compiled code and libraries loaded.
        with (
            contextlib.chdir(base),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
        ):
            run(list(command))
        whole = in_child(base, lambda command=command: run(list(command)))
        if whole.code != 0:
            raise SystemExit(f"tdcr {' '.join(command)} does not read the whole file: {whole.err}")
        wholes[command] = whole.out
    tallies = {kind.name: Tally() for kind in kinds}
    for number in range(inputs):
        kind = kinds[number % len(kinds)]
        random = np.random.default_rng([seed, number])
        commands = kind.commands
        command = commands[random.integers(len(commands))] if commands else ()
        case = folder / "case"
        shutil.copytree(base, case)
        what = ""
        expected = REFUSED
        if kind.option is not None:
            command, what = kind.option(random)
        else:
            content, expected, what = kind.change(base, random)
            (case / kind.file).write_bytes(content)
        ended = in_child(case, lambda command=command: run(list(command)))
        tally = tallies[kind.name]
        tally.inputs += 1
        tally.codes[ended.code] += 1
        failed = judge(ended, expected, wholes.get(command, ""))
        if failed:
            tally.failures[failed] += 1
            last = ended.err.strip().splitlines()[-1:] or [""]
            place = f"{failed}: input {number}, {kind.name}, {what}"
            told(f"{place}: tdcr {' '.join(command)[:150]}: exit {ended.code}: {last[0][:300]}")
        shutil.rmtree(case)
        if (number + 1) % 200 == 0:
            told(f"{number + 1} inputs")
    return tallies


def main() -> int:
    """Prints the table; returns 1 where an input failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", default=[kind.name for kind in KINDS])
    arguments = parser.parse_args()
    kinds = [kind for kind in KINDS if kind.name in arguments.kinds]
    with tempfile.TemporaryDirectory(prefix="tdcr-fuzz-") as folder:
        tallies = fuzz(arguments.inputs, arguments.seed, kinds, Path(folder), lambda line: print(line, flush=True))
    columns = ("fault", "hang", "accepted", "changed")
    print(f"\n{'kind':<18}{'inputs':>8}{'exit 0':>8}{'1':>6}{'2':>7}" + "".join(f"{name:>10}" for name in columns))
    for name, tally in tallies.items():
        codes = f"{tally.codes[0]:>8}{tally.codes[1]:>6}{tally.codes[2]:>7}"
        print(f"{name:<18}{tally.inputs:>8}{codes}" + "".join(f"{tally.failures[column]:>10}" for column in columns))
    failed = sum(sum(tally.failures.values()) for tally in tallies.values())
    print(f"{sum(tally.inputs for tally in tallies.values())} inputs, seed {arguments.seed}: {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
