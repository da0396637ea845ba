"""Model files and checkpoints on disk: a kill at any moment leaves the one that was there or the next, never a part."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest
import torch

from tdcr_planner.errors import FormatError
from tdcr_planner.learning.checkpoint import load_checkpoint, save_checkpoint, write_bytes

SIZE = 3_000_000
# What `write_bytes` does, without the seconds that importing torch takes.
WRITER = """
import itertools, sys
from tdcr_planner.files import write_file_whole
for number in itertools.count(1):
    with write_file_whole(sys.argv[1]) as temporary:
        temporary.write_bytes(bytes([number % 256]) * int(sys.argv[2]))
"""


def test_a_kill_at_any_moment_leaves_a_whole_file(tmp_path, random):
    path = tmp_path / "model.pt"
    for delay in random.uniform(0.0, 0.02, 6):
        write_bytes(path, bytes(SIZE))
        with subprocess.Popen([sys.executable, "-c", WRITER, str(path), str(SIZE)]) as process:
            while path.read_bytes()[:1] == b"\0":
                assert process.poll() is None
                time.sleep(0.001)
            time.sleep(delay)
            process.send_signal(signal.SIGKILL)
        content = path.read_bytes()
        assert len(content) == SIZE
        assert len(set(content)) == 1


def test_a_checkpoint_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "model.pt.checkpoint"
    like = {"epoch": 0, "losses": [0.0]}
    assert load_checkpoint(path, "robot", "settings", like) is None
    save_checkpoint(path, "robot", "settings", {"epoch": 3, "losses": [1.0, 0.5]})
    assert load_checkpoint(path, "robot", "settings", like) == {"epoch": 3, "losses": [1.0, 0.5]}
    with pytest.raises(FormatError, match="its robot differs"):
        load_checkpoint(path, "another", "settings", like)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("epoch", True),
        ("epoch", 1.5),
        ("epoch", "3"),
        ("best", float("nan")),
        ("losses", [1.0, float("inf")]),
        ("losses", (1.0,)),
        ("weights", {"w": torch.zeros(3)}),
        ("weights", {"w": torch.zeros(2, dtype=torch.float64)}),
        ("weights", {"w": torch.tensor([0.0, float("nan")])}),
        ("weights", {"w": torch.zeros(2), "more": torch.zeros(2)}),
        ("weights", {}),
        ("done", 1),
    ],
)
def test_a_state_built_otherwise_is_refused_by_its_place(tmp_path, name, value):
    path = tmp_path / "model.pt.checkpoint"
    like = {"epoch": 0, "best": float("inf"), "losses": [0.0], "weights": {"w": torch.ones(2)}, "done": False}
    save_checkpoint(path, "robot", "settings", {**like, name: value})
    with pytest.raises(FormatError, match=f"state.{name}"):
        load_checkpoint(path, "robot", "settings", like)


def test_a_damaged_checkpoint_is_refused_or_read_as_it_was(tmp_path, random):
    path = tmp_path / "model.pt.checkpoint"
    like = {"epoch": 7, "weights": {"w": torch.arange(50.0)}}
    save_checkpoint(path, "robot", "settings", like)
    whole = path.read_bytes()
    for _ in range(100):
        content = bytearray(whole)
        content[random.integers(len(whole))] ^= 1 << random.integers(8)
        path.write_bytes(content)
        try:
            state = load_checkpoint(path, "robot", "settings", like)
        except FormatError:
            continue
        assert state is not None
        assert state["epoch"] == 7
        assert torch.equal(state["weights"]["w"], like["weights"]["w"])
