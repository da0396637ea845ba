"""Compiled code is never stale, and its cache is a convenience: whatever is wrong with it, results are the same."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import tdcr_planner
from tdcr_planner.machine_code import FOLDER

PACKAGE = Path(tdcr_planner.__file__).parent
CALLER = """
    from tdcr_planner.compiled import njit
    from kernels.middle import middle


    @njit
    def caller(x):
        return middle(x) + 1.0
"""
MIDDLE = """
    from tdcr_planner.compiled import njit
    from kernels.callee import OFFSET, callee


    @njit(nogil=True)
    def middle(x):
        return callee(x, True) + callee(x, False) + OFFSET
"""
CALLEE = '''
    from tdcr_planner.compiled import njit

    OFFSET = 10.0


    @njit(error_model="numpy")
    def callee(x, doubled):
        """Returns x or twice x."""
        return 2.0 * x if doubled else x
'''
RUN = """
import json, sys
from kernels.caller import caller
value = caller(3.0)
stats = caller.stats
print(json.dumps({"value": value, "compiled": sum(stats.cache_misses.values()), "path": stats.cache_path}))
"""


class Project:
    """A package of three files with compiled functions that call each other, and a way to run it in a process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.home = folder / "home"
        self.cache = folder / "cache"
        (folder / "kernels").mkdir()
        self.home.mkdir()
        for name, text in (("__init__", ""), ("caller", CALLER), ("middle", MIDDLE), ("callee", CALLEE)):
            self.file(name).write_text(textwrap.dedent(text))

    def file(self, name: str) -> Path:
        return self.folder / "kernels" / f"{name}.py"

    def replace(self, name: str, old: str, new: str) -> None:
        text = self.file(name).read_text(encoding="utf-8")
        assert text.count(old) == 1
        self.file(name).write_text(text.replace(old, new))

    def run(self, **environment: str) -> tuple[dict[str, object], str]:
        """Runs the caller in a process of its own; returns what it printed and its standard error."""
        paths = os.pathsep.join([str(self.folder), str(PACKAGE.parent)])
        variables = {"PATH": os.environ["PATH"], "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
        variables |= {"HOME": str(self.home), "TMPDIR": str(self.folder / "tmp")} | environment
        (self.folder / "tmp").mkdir(exist_ok=True)
        done = subprocess.run([sys.executable, "-c", RUN], env=variables, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout), done.stderr

    def files(self) -> list[Path]:
        return sorted((self.cache / FOLDER).glob("*.code"))


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project(tmp_path)


@pytest.fixture
def filled(project: Project) -> Project:
    """The project after a first run: its cache holds one function."""
    found, said = project.run(TDCR_CACHE_DIR=str(project.cache))
    assert (found["value"], found["compiled"], said) == (20.0, 1, "")
    (file,) = project.files()
    assert file.name.startswith("caller.caller-")
    return project


def test_a_second_process_compiles_nothing(filled: Project) -> None:
    found, said = filled.run(TDCR_CACHE_DIR=str(filled.cache))
    assert (found["value"], found["compiled"], said) == (20.0, 0, "")


@pytest.mark.parametrize(
    ("name", "old", "new", "value"),
    [
        ("callee", "2.0 * x", "5.0 * x", 29.0),
        ("callee", "OFFSET = 10.0", "OFFSET = 20.0", 30.0),
        ("middle", "callee(x, False)", "callee(-x, False)", 14.0),
        ("callee", "x, doubled):", "x, doubled, more=7.0):\n    x = x + more", 41.0),
    ],
    ids=["a callee of a callee", "a constant of another file", "a callee", "a default"],
)
def test_a_change_in_another_file_counts(filled: Project, name: str, old: str, new: str, value: float) -> None:
    filled.replace(name, old, new)
    found, _ = filled.run(TDCR_CACHE_DIR=str(filled.cache))
    assert (found["value"], found["compiled"]) == (value, 1)
    found, _ = filled.run(TDCR_CACHE_DIR=str(filled.cache))
    assert (found["value"], found["compiled"]) == (value, 0)


def test_a_docstring_or_a_line_more_compiles_nothing(filled: Project) -> None:
    filled.replace("callee", "Returns x or twice x.", "Returns x, or x twice.")
    filled.replace("middle", "from kernels.callee", "\n\nfrom kernels.callee")
    found, _ = filled.run(TDCR_CACHE_DIR=str(filled.cache))
    assert (found["value"], found["compiled"]) == (20.0, 0)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: content[:5000] + bytes([content[5000] ^ 1]) + content[5001:],
        lambda content: content[::-1],
    ],
    ids=["empty", "truncated", "one bit", "garbage"],
)
def test_a_damaged_file_is_thrown_away(filled: Project, damage: object) -> None:
    (file,) = filled.files()
    content = file.read_bytes()
    file.write_bytes(damage(content))  # type: ignore[operator]
    found, said = filled.run(TDCR_CACHE_DIR=str(filled.cache))
    assert (found["value"], found["compiled"], said) == (20.0, 1, "")
    found, _ = filled.run(TDCR_CACHE_DIR=str(filled.cache))
    assert found["compiled"] == 0


def test_numbas_own_variable_comes_first(project: Project) -> None:
    given = project.folder / "given"
    found, said = project.run(TDCR_CACHE_DIR=str(project.cache), NUMBA_CACHE_DIR=str(given))
    assert (found["path"], said) == (str(given / FOLDER), "")
    assert not project.files()


def blocked(project: Project) -> Path:
    """Returns a folder that nobody can make: a file is in its place, which stops root too."""
    path = project.folder / "blocked"
    path.write_text("in the way")
    return path


def test_a_cache_that_cannot_be_made_is_one_remark(project: Project) -> None:
    found, said = project.run(TDCR_CACHE_DIR=str(blocked(project)))
    assert found["value"] == 20.0
    assert str(found["path"]).startswith(str(project.folder / "tmp"))
    (line,) = said.splitlines()
    assert "compiled code is kept in" in line
    assert str(project.folder / "blocked") in line
    assert project.run(TDCR_CACHE_DIR=str(project.folder / "blocked"))[0]["compiled"] == 0


def test_without_any_folder_it_compiles_each_time(project: Project) -> None:
    path = str(blocked(project))
    found, said = project.run(TDCR_CACHE_DIR=path, TMPDIR=path, TEMP=path, TMP=path)
    # Python falls back to /tmp where TMPDIR cannot be used, so the function may be kept there.
    assert found["value"] == 20.0
    assert len(said.splitlines()) == 1


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="folders have no owner here")
@pytest.mark.parametrize("kind", ["mode", "owner", "link"])
def test_a_folder_that_others_can_write_to_is_not_read(filled: Project, kind: str) -> None:
    folder = filled.cache / FOLDER
    if kind == "mode":
        folder.chmod(0o777)
    elif kind == "link":
        folder.rename(filled.cache / "elsewhere")
        folder.symlink_to(filled.cache / "elsewhere")
    elif os.geteuid() == 0:
        os.chown(folder, 12345, 12345)
    else:
        pytest.skip("only root can give a folder away")
    found, said = filled.run(TDCR_CACHE_DIR=str(filled.cache))
    assert (found["value"], found["compiled"]) == (20.0, 1)
    reason = {"mode": "other users can write to it", "owner": "belongs to user 12345", "link": "is a link"}[kind]
    assert reason in said


def kernel_files() -> list[Path]:
    return [
        path
        for path in sorted(PACKAGE.rglob("*.py"))
        if "njit" in path.read_text(encoding="utf-8") and path.name != "compiled.py"
    ]


@pytest.mark.parametrize("path", kernel_files(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_every_kernel_has_the_decorator_whose_cache_is_never_stale(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module == "numba":
            assert "njit" not in [name.name for name in node.names]
        assert not (isinstance(node, ast.Attribute) and node.attr in ("njit", "jit", "vectorize", "guvectorize"))
