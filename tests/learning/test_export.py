"""The model file: the same bytes from every process that trains the same model."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import pytest

PROGRAM = """
import io, sys, torch
from torch import nn
from tdcr_planner.learning.export import _canonical_archive, script_module
torch.manual_seed(1)
network = nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.Linear(8, 2, bias=False), nn.LayerNorm(2))
buffer = io.BytesIO()
torch.jit.save(script_module(network), buffer, _extra_files={"card.json": "{}"})
content = _canonical_archive(buffer)
again = torch.jit.load(io.BytesIO(content))
x = torch.ones(1, 3)
assert torch.equal(again(x), network(x))
sys.stdout.buffer.write(content)
"""


@pytest.fixture(scope="module")
def archives() -> list[bytes]:
    """What processes write that order Python's sets differently."""
    return [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", PROGRAM],
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
            capture_output=True,
            check=True,
        ).stdout
        for seed in range(3)
    ]


def test_every_process_writes_the_same_bytes(archives: list[bytes]) -> None:
    assert len(archives[0]) > 1000
    assert len({hashlib.sha256(archive).hexdigest() for archive in archives}) == 1


def test_no_folder_of_this_machine_is_named(archives: list[bytes]) -> None:
    assert os.path.dirname(os.__file__).encode() not in archives[0]
