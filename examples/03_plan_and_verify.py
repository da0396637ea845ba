"""Plan through the bent duct, let the reference verify the path, write result and pictures.

Run: python examples/03_plan_and_verify.py --out out/examples
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tdcr_planner import load_scenario, plan, verify
from tdcr_planner.report.results import write_result

ROOT = Path(__file__).resolve().parents[1]


def main(out: Path) -> None:
    result = plan(load_scenario(ROOT / "scenes/duct/scenario_elbow.toml"), seed=1)
    print(f"{result.status.value}: {result.message}")
    assert result.path is not None
    report = verify(result, refine=10)
    print(
        f"checked again at a tenth of the step: {report.states} states, verified {report.verified}, "
        f"least clearance {1e3 * report.worst['clearance_m']:.2f} mm"
    )
    print(f"wrote {write_result(result, out / 'elbow')}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/examples"))
    main(parser.parse_args().out)
