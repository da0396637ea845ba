"""What each command imports: a library that takes time to load is there only where the command needs it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

NUMERIC = {"numba", "scipy"}
DRAWING = {"matplotlib", "plotly", "PIL"}
SEARCH = {"ompl", "fcl"}
# Of commands that never need them: the learned model's weights are read as data, meshes by this package's readers.
NEVER = {"torch", "trimesh", "distributed", "dask", "viser", "pyarrow", "pandas"}
SCIPY = {"scipy.sparse", "scipy.spatial", "scipy.stats", "scipy.optimize", "scipy.ndimage"}
SCENARIO = "scenes/duct/scenario_elbow.toml"

RUN = """
import json, sys
from pathlib import Path
from tdcr_planner.cli import pictures
from tdcr_planner.cli.main import run

def draw_later(written, draw):
    Path(seen).write_text(json.dumps(sorted(sys.modules)))
    return []

seen, *arguments = sys.argv[1:]
pictures.draw_after = draw_later
try:
    code = run(arguments)
except SystemExit as end:
    code = end.code
if not Path(seen).exists():
    draw_later("", None)
sys.exit(code)
"""


def _imported(tmp_path: Path, root: Path, *arguments: str, code: int = 0) -> set[str]:
    """Returns the modules that a command has imported at its end, or when it would begin to draw."""
    seen = tmp_path / "modules.json"
    command = [sys.executable, "-c", RUN, str(seen), *arguments]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    return set(json.loads(seen.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("arguments", "code", "forbidden"),
    [
        (["--help"], 0, NEVER | DRAWING | SEARCH | NUMERIC | {"pydantic"}),
        (["plan", "--help"], 0, NEVER | DRAWING | SEARCH | NUMERIC),
        (["plan", "no.toml", "--out", "out"], 2, NEVER | DRAWING | SEARCH | NUMERIC),
        (["fly"], 2, NEVER | DRAWING | SEARCH | NUMERIC),
        (["info", SCENARIO], 0, NEVER | DRAWING | SEARCH | NUMERIC),
        (["info", "models/robots/paper.toml"], 0, NEVER | DRAWING | SEARCH | NUMERIC),
        (["info", "models/shape/paper/model.pt"], 0, NEVER | DRAWING | SEARCH | SCIPY),
        (["solve", "models/robots/paper.toml", "--bending-n", "1,0"], 0, NEVER | DRAWING | SEARCH | SCIPY),
        (["roadmap", SCENARIO, "--vertices", "5", "--no-progress", "--out"], 0, NEVER | DRAWING),
    ],
    ids=lambda value: " ".join(value)[:40] if isinstance(value, list) else None,
)
def test_a_command_imports_only_what_it_needs(tmp_path, root, arguments, code, forbidden):
    if arguments[-1] == "--out":
        arguments = [*arguments, str(tmp_path / "map.npz")]
    assert not forbidden & _imported(tmp_path, root, *arguments, code=code)


def test_a_plan_and_its_verification_draw_nothing_before_the_verdict_and_need_no_torch(tmp_path, root):
    out = tmp_path / "out"
    planned = _imported(tmp_path, root, "plan", SCENARIO, "--out", str(out), "--no-progress")
    assert not (NEVER | DRAWING | SCIPY) & planned
    (tmp_path / "modules.json").unlink()
    verified = _imported(tmp_path, root, "verify", str(out / "result.json"))
    assert not (NEVER | DRAWING | SCIPY | {"ompl"}) & verified
