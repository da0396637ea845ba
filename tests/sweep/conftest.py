"""Suites of two small scenarios, and job functions that worker processes can import."""

from __future__ import annotations

from pathlib import Path

import pytest

from tdcr_planner.sweep.suite import load_suite

HELPERS = Path(__file__).parent / "helpers"


@pytest.fixture
def fake_jobs(monkeypatch):
    """The module of job functions, importable here and in worker processes."""
    monkeypatch.syspath_prepend(HELPERS)
    import tdcr_fake_jobs

    return tdcr_fake_jobs


@pytest.fixture
def write_suite(make_scenario, tmp_path):
    """Returns a function that writes a suite of two scenarios and gives its path."""

    def write(**changes) -> Path:
        first = make_scenario().path
        (tmp_path / "second.toml").write_text(first.read_text(encoding="utf-8") + "\n# another file, another hash\n")
        table = {
            "format": '"tdcr-suite/1"',
            "scenarios": '[{file = "scenario.toml", difficulty = "hard"}, {file = "second.toml", difficulty = "easy"}]',
            "planners": '["RRTConnect"]',
            "models": '["constant_curvature"]',
            "seeds": "[1, 2, 3]",
            **changes,
        }
        path = tmp_path / "suite.toml"
        path.write_text("".join(f"{key} = {value}\n" for key, value in table.items() if value is not None))
        return path

    return write


@pytest.fixture
def suite(write_suite):
    return load_suite(write_suite())
