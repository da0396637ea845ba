"""Plan with constant curvature in a scene with gravity: what it calls a path, the reference does not confirm.

Run: python examples/05_wrong_model.py
"""

from __future__ import annotations

from pathlib import Path

from tdcr_planner import PlanningSession, load_scenario

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    scenario = load_scenario(ROOT / "scenes/duct/scenario_sag.toml")
    session = PlanningSession(scenario)
    for validity in ("learned", "constant_curvature"):
        result = session.plan(scenario.with_planner(validity=validity, time_limit_s=5.0))
        print(f"{validity}: {result.status.value} after {result.repairs} repairs")
        print(f"  {result.message}")
        if result.verification is not None:
            print(f"  largest deviation {1e3 * result.verification.worst['deviation_m']:.2g} mm")


if __name__ == "__main__":
    main()
