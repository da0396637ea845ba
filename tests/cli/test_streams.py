"""Output into whatever the standard streams are: closed, ASCII only, full, or read by a program that has gone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.cli.streams import one_line

PROGRAM = f"'{sys.executable}' -c 'from tdcr_planner.cli.main import main; main()'"


def in_shell(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
        timeout=60,
    )


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory, root: Path) -> Path:
    """A robot whose name is not ASCII."""
    file = tmp_path_factory.mktemp("robot") / "robot.toml"
    text = (root / "models/robots/two_segment.toml").read_text(encoding="utf-8")
    assert 'name = "two_segment"' in text
    file.write_text(text.replace('name = "two_segment"', 'name = "Gerät"'), encoding="utf-8")
    return file


def test_characters_that_the_output_cannot_hold_are_escaped(robot: Path) -> None:
    done = in_shell(f"{PROGRAM} info '{robot}'", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert r"Ger\xe4t" in done.stdout


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&- <&-", "| true", "2>&1 | true"])
def test_closed_streams_change_no_exit_code(closed: str, robot: Path) -> None:
    done = in_shell(f"{PROGRAM} info '{robot}' {closed}")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_file_is_not_taken_for_the_closed_output(robot: Path, tmp_path: Path) -> None:
    out = tmp_path / "shape.json"
    done = in_shell(f"{PROGRAM} solve '{robot}' --bending-n 0,0,0,0 --out '{out}' >&- 2>&-")
    assert done.returncode == 0
    assert out.read_text(encoding="utf-8").startswith('{"format"')
    assert out.read_text(encoding="utf-8").endswith("}")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device without room on this system")
def test_an_output_without_room_is_named(robot: Path) -> None:
    done = in_shell(f"{PROGRAM} info '{robot}' >/dev/full")
    assert done.returncode == 1
    assert done.stderr == "error: the output cannot be written: No space left on device\n"


def test_a_name_cannot_steer_the_terminal() -> None:
    name = "\x1b[2Jevil\nname.toml"
    done = subprocess.run(
        [sys.executable, "-c", "from tdcr_planner.cli.main import main; main()", "info", name],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == "error: \\x1b[2Jevil\\nname.toml: no such file\n"
    assert done.returncode == 2


@given(text=st.text(st.characters(exclude_categories=())))
def test_any_text_is_one_line(text: str) -> None:
    line = one_line(text)
    assert line.isprintable()
    assert one_line(line) == line
