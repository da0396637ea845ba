"""Model files and checkpoints on disk: a kill at any moment leaves the one that was there or the next, never a part."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

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
    assert load_checkpoint(path, "robot", "settings") is None
    save_checkpoint(path, "robot", "settings", {"epoch": 3, "losses": [1.0, 0.5]})
    assert load_checkpoint(path, "robot", "settings") == {"epoch": 3, "losses": [1.0, 0.5]}
    with pytest.raises(FormatError, match="its robot differs"):
        load_checkpoint(path, "another", "settings")
