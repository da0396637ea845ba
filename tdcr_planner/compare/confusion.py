"""How often two verdicts agree: confusion matrices, rates with intervals, and agreement against clearance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.rates import Rate, binomial_rate

# Edges of the clearance bins, m, counted from the clearance that is asked: fine where verdicts are in question.
EXCESS_EDGES = 1e-3 * np.array(
    [-np.inf, -20.0, -10.0, -5.0, -3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, np.inf]
)


@dataclass(frozen=True)
class Confusion:
    """A model's verdicts against the reference's.

    Attributes:
        both_valid: States that both call valid.
        false_valid: States that the model calls valid and the reference does not.
        false_invalid: States that the model calls invalid and the reference valid.
        both_invalid: States that both call invalid.
    """

    both_valid: int
    false_valid: int
    false_invalid: int
    both_invalid: int

    @property
    def total(self) -> int:
        """Number of states."""
        return self.both_valid + self.false_valid + self.false_invalid + self.both_invalid

    @property
    def rates(self) -> dict[str, Rate]:
        """Rates by name.

        agreement, false_valid and false_invalid are shares of all states. The others are conditional:
        false_valid_of_accepted of the states that the model calls valid (what a planner that trusts it runs into),
        false_valid_of_invalid of those that are invalid, false_invalid_of_rejected of the states that the model calls
        invalid, false_invalid_of_valid of those that are valid (the room that caution costs).
        """
        accepted, rejected = self.both_valid + self.false_valid, self.both_invalid + self.false_invalid
        valid, invalid = self.both_valid + self.false_invalid, self.both_invalid + self.false_valid
        return {
            "agreement": binomial_rate(self.both_valid + self.both_invalid, self.total),
            "false_valid": binomial_rate(self.false_valid, self.total),
            "false_valid_of_accepted": binomial_rate(self.false_valid, accepted),
            "false_valid_of_invalid": binomial_rate(self.false_valid, invalid),
            "false_invalid": binomial_rate(self.false_invalid, self.total),
            "false_invalid_of_rejected": binomial_rate(self.false_invalid, rejected),
            "false_invalid_of_valid": binomial_rate(self.false_invalid, valid),
        }


def count_verdicts(model_valid: BoolArray, reference_valid: BoolArray) -> Confusion:
    """Returns the confusion matrix of two verdicts on the same states, each of shape (n,)."""
    return Confusion(
        both_valid=int((model_valid & reference_valid).sum()),
        false_valid=int((model_valid & ~reference_valid).sum()),
        false_invalid=int((~model_valid & reference_valid).sum()),
        both_invalid=int((~model_valid & ~reference_valid).sum()),
    )


@dataclass(frozen=True)
class ClearanceBin:
    """The states whose clearance under the reference lies in one range.

    Attributes:
        low: Lower end, m, counted from the clearance that is asked.
        high: Upper end, m.
        agreement: Share of them on which model and reference agree.
    """

    low: float
    high: float
    agreement: Rate


def agreement_by_clearance(
    model_valid: BoolArray, reference_valid: BoolArray, clearance: FloatArray, asked: float
) -> tuple[ClearanceBin, ...]:
    """Returns the share of agreement in each bin of EXCESS_EDGES that holds a state.

    Args:
        model_valid: Shape (n,).
        reference_valid: Shape (n,).
        clearance: Under the reference, shape (n,), m; NaN states are left out.
        asked: The clearance to keep, m.
    """
    known = np.isfinite(clearance)
    place = np.searchsorted(EXCESS_EDGES, clearance[known] - asked, side="right") - 1
    agrees = (model_valid == reference_valid)[known]
    bins = []
    for index in range(len(EXCESS_EDGES) - 1):
        inside = place == index
        if inside.any():
            rate = binomial_rate(int(agrees[inside].sum()), int(inside.sum()))
            bins.append(ClearanceBin(float(EXCESS_EDGES[index]), float(EXCESS_EDGES[index + 1]), rate))
    return tuple(bins)
