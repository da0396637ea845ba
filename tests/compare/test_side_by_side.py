"""Model files side by side in one scenario."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.compare.side_by_side import compare_files
from tdcr_planner.errors import InputError

MODELS = Path(__file__).resolve().parents[2] / "models/shape/paper"


def test_two_files_stand_beside_constant_curvature_and_the_reference(make_scenario) -> None:
    told = []
    files = [MODELS / "model.pt", MODELS / "published.pt"]
    scenario = make_scenario(gravity_m_s2=[0.0, 0.0, 0.0])
    found = compare_files(scenario, files, samples=60, paths=1, progress=lambda *step: told.append(step))
    assert [row.name for row in found.rows] == ["model.pt", "published.pt", "constant curvature", "reference"]
    own, published, arcs, reference = found.rows
    # Unloaded, this project's model is exact, and the published one is not; the reference is compared with itself.
    assert own.error_m[1] < 1e-9 < 1e-4 < published.error_m[0]
    assert reference.error_m[1] < 1e-12
    # The median of the bound by state is that of the card's, below a quarter of the uniform 3.05 mm.
    assert 0.0002 < published.margin_m < 0.003 / 4 + 2e-4
    assert reference.margin_m == arcs.margin_m == 0.0
    for row in found.rows:
        assert row.verified.total == 1
        assert row.shape_us > 0.0
        assert row.false_valid.count == 0
    assert told[-1][0] == told[-1][1] == 4


def test_no_files_are_an_error(make_scenario) -> None:
    with pytest.raises(InputError, match="1 to 20 files"):
        compare_files(make_scenario(), [])


def test_the_command_writes_a_table_and_a_plot(
    make_scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = make_scenario(gravity_m_s2=[0.0, 0.0, 0.0])
    out = tmp_path / "out"
    options = ["--samples", "40", "--paths", "0", "--no-progress", "--out", str(out)]
    assert run(["compare", str(scenario.path), "--models", str(MODELS / "published.pt"), *options]) == 0
    assert "| published.pt |" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {"compare.json", "compare.md", "error_against_time.png"}
    content = json.loads((out / "compare.json").read_text(encoding="utf-8"))
    assert [model["name"] for model in content["models"]] == ["published.pt", "constant curvature", "reference"]
    assert content["models"][0]["plan_s"] is None
    assert run(["compare", str(scenario.path), "--models", "missing.pt", *options]) == 2
    assert "missing.pt" in capsys.readouterr().err
