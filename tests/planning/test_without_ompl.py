"""Where OMPL cannot be installed, everything but the search works."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = """
import sys
sys.modules["ompl"] = None
from tdcr_planner.cli.main import run
assert run(["solve", sys.argv[1], "--bending-n", "0.5,0"]) == 0
assert run(["info", sys.argv[2]]) == 0
import tdcr_planner.query.session, tdcr_planner.report.results, tdcr_planner.learning.train
from tdcr_planner.query.result import library_versions
from tdcr_planner.planning.offered import require_ompl
from tdcr_planner.errors import MissingLibraryError
assert "ompl" in library_versions()
try:
    require_ompl()
except MissingLibraryError as error:
    print(error)
"""


def test_what_does_not_search_works_and_the_message_says_where_ompl_runs(root: Path) -> None:
    files = [str(root / "models/robots/paper.toml"), str(root / "scenes/duct/scenario_elbow.toml")]
    done = subprocess.run([sys.executable, "-c", SCRIPT, *files], capture_output=True, text=True, cwd=root, check=False)
    assert done.returncode == 0, done.stderr
    assert "ompl is not installed" in done.stdout.splitlines()[-1]
    assert "macOS" in done.stdout.splitlines()[-1]
