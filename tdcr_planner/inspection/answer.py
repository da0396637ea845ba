"""The answer to an inspection: a path as `plan` answers, and what it sees."""

from __future__ import annotations

from dataclasses import dataclass

from tdcr_planner.inspection.coverage import Coverage
from tdcr_planner.query.result import PlanResult, PlanStatus

PLANNER_NAME = "inspection"


@dataclass(frozen=True)
class Inspection:
    """The answer to an inspection.

    Attributes:
        plan: The path and what the reference says of it, as `plan` answers.
        coverage: What the path sees.
    """

    plan: PlanResult
    coverage: Coverage

    @property
    def done(self) -> bool:
        """Whether the path is verified and sees what was asked for."""
        return self.plan.status is PlanStatus.VERIFIED and self.coverage.reached


def describe_coverage(coverage: Coverage) -> str:
    """Returns what a verified path sees, as a sentence."""
    text = (
        f"sees {100 * coverage.of_all:.1f} % of the surfaces, {100 * coverage.of_what_can_be_seen:.1f} % of the "
        f"{100 * coverage.visible:.1f} % that can be seen"
    )
    if not coverage.reached:
        text += f"; {100 * coverage.asked:.1f} % were asked for"
        if coverage.asked > coverage.visible:
            text += f", and more than {100 * coverage.visible:.1f} % cannot be seen"
    return text
