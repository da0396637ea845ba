"""A short run of `benchmarks/fuzz.py`: damaged and absurd inputs of every kind end in one sentence."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Of every kind some dozen; by hand thousands are run.
INPUTS = 264


def test_no_input_ends_in_a_fault_a_hang_or_a_wrong_answer() -> None:
    command = [sys.executable, str(ROOT / "benchmarks/fuzz.py"), "--inputs", str(INPUTS), "--seed", "5"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{INPUTS} inputs, seed 5: 0 failed" in done.stdout
