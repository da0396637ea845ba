from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("[0-9]*.py"))


def test_the_examples_are_numbered_without_a_gap() -> None:
    assert [file.name[:2] for file in EXAMPLES] == [f"{number:02d}" for number in range(1, len(EXAMPLES) + 1)]
    assert len(EXAMPLES) >= 6


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_runs_as_it_stands(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [file.name, "--out", str(tmp_path)])
    runpy.run_path(str(file), run_name="__main__")
    shown = capsys.readouterr().out
    assert shown.strip()
    if file.stem in {"03_plan_and_verify", "04_own_mesh"}:
        assert shown.startswith("verified: ")
    if file.stem == "05_wrong_model":
        assert "learned: verified" in shown
        assert "constant_curvature: unverified" in shown
    if file.stem == "07_own_network":
        assert "\nverified: " in shown
