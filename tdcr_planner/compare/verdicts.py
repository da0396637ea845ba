"""Verdicts on sampled configurations: the reference's, which is the truth here, and those of the shape models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.collision.scene import Verdict
from tdcr_planner.limits import at_most
from tdcr_planner.planning.causes import Codes
from tdcr_planner.planning.scenario import Scenario, Validity
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import Shapes, ValidityChecker
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.shape.registry import SHAPE_MODELS


@dataclass(frozen=True)
class Variant:
    """A shape model together with the margin that its verdicts keep.

    Attributes:
        name: What results call it.
        model: The shape model.
        with_bound: Whether the model's error bound is part of the margin.
        with_half_step: Whether it stands for the margin of the search, which is the same: clearance and bound.
    """

    name: str
    model: Validity
    with_bound: bool
    with_half_step: bool

    def margins(self, scenario: Scenario, error_bound: FloatArray) -> FloatArray:
        """Returns the distance each disk must keep, shape (d,), m; the clearance asked for is always part of it."""
        return np.asarray(
            scenario.required_clearance + (error_bound if self.with_bound else np.zeros_like(error_bound))
        )


@cache
def variants_of(models: tuple[Validity, ...]) -> tuple[Variant, ...]:
    """Returns the variants of shape models: each with its bound, without it where it has one, and as planned."""
    found = []
    for name in models:
        found.append(Variant(name, name, with_bound=True, with_half_step=False))
        if SHAPE_MODELS.find(name).has_error_bound:
            found.append(Variant(f"{name}_without_bound", name, with_bound=False, with_half_step=False))
    found += [Variant(f"{name}_as_planned", name, with_bound=True, with_half_step=True) for name in models]
    return tuple(found)


MODELS: tuple[Validity, ...] = ("learned", "constant_curvature")
"""What is compared unless others are named."""
ReferenceVerdict = Literal["valid", "no_shape", "limits", "clearance", "self_collision"]
REFERENCE_VERDICTS: tuple[ReferenceVerdict, ...] = ("valid", "no_shape", "limits", "clearance", "self_collision")


@dataclass(frozen=True)
class Verdicts:
    """What reference and models say of n configurations.

    Attributes:
        rows: The configurations, shape (n, dimension).
        reference: Place in REFERENCE_VERDICTS, shape (n,).
        clearance: Clearance under the reference, shape (n,), m; NaN where it has no shape.
        codes: Code of each variant's verdict (see `ValidityChecker.check`; 0 is valid), shape (n, variants).
        deviation: Largest distance of a disk centre from the reference, shape (n, models), m; NaN where one of the two
            has no shape.
        models: The shape models.
    """

    rows: FloatArray
    reference: Codes
    clearance: FloatArray
    codes: NDArray[np.int8]
    deviation: FloatArray
    models: tuple[Validity, ...] = MODELS

    @property
    def variants(self) -> tuple[Variant, ...]:
        """The models together with their margins."""
        return variants_of(self.models)

    @property
    def reference_valid(self) -> BoolArray:
        """Which configurations are valid, shape (n,)."""
        return np.asarray(self.reference == 0)

    def valid(self, variant: Variant) -> BoolArray:
        """Returns which configurations a variant calls valid, shape (n,)."""
        return np.asarray(self.codes[:, self.variants.index(variant)] == 0)

    def deviation_of(self, model: Validity) -> FloatArray:
        """Returns the deviation of a model from the reference, shape (n,), m."""
        return np.asarray(self.deviation[:, self.models.index(model)])


def join_verdicts(parts: Sequence[Verdicts]) -> Verdicts:
    """Returns the verdicts of several batches as one, in their order."""
    return Verdicts(
        rows=np.concatenate([part.rows for part in parts]),
        reference=np.concatenate([part.reference for part in parts]),
        clearance=np.concatenate([part.clearance for part in parts]),
        codes=np.concatenate([part.codes for part in parts]),
        deviation=np.concatenate([part.deviation for part in parts]),
        models=parts[0].models,
    )


def sample_configurations(space: ConfigurationSpace, count: int, seed: int) -> tuple[FloatArray, int]:
    """Returns configurations, uniform among those whose tensions are within their limits.

    The bounds of the space are a box around the reachable bending vectors; what lies in the box but asks a tendon for
    more than its limit no model is needed to reject, so such draws are left out and drawn again.

    Args:
        space: The configuration space.
        count: How many.
        seed: Seed of the draws. The first k of n configurations are the same for every n.

    Returns:
        Rows, shape (count, dimension), and how many draws it took.
    """
    generator = np.random.default_rng(seed)
    found: list[FloatArray] = []
    drawn, missing = 0, count
    while missing:
        batch = generator.uniform(space.lower, space.upper, (1000, space.dimension))
        within = np.flatnonzero(at_most(space.actuate(batch).tensions, space.robot.max_tensions).all(axis=1))
        if len(within) >= missing:
            within = within[:missing]
            drawn += int(within[-1]) + 1
        else:
            drawn += len(batch)
        found.append(batch[within])
        missing -= len(within)
    return np.concatenate(found), drawn


def judge(session: PlanningSession, rows: FloatArray, models: tuple[Validity, ...] = MODELS) -> Verdicts:
    """Returns all verdicts on configurations of a session's scenario.

    Valid is, for the reference, what verification accepts of a state by itself: the solver found a stable shape, the
    robot's limits hold under it, the body keeps the clearance asked for from every surface and does not touch itself.

    Args:
        session: The scenario's session.
        rows: Configurations, shape (n, dimension).
        models: The shape models to judge.
    """
    accepted, states = session.verifier().judge_each(rows)
    solved = states.converged & states.stable
    reference = np.zeros(len(rows), dtype=np.int8)
    reference[~accepted] = REFERENCE_VERDICTS.index("limits")
    close = ~(states.clearance >= session.scenario.required_clearance)
    reference[close & ~accepted] = REFERENCE_VERDICTS.index("clearance")
    reference[~solved] = REFERENCE_VERDICTS.index("no_shape")
    free = np.flatnonzero(reference == 0)
    touching = session.scene.check(states.positions[free], states.rotations[free]) == Verdict.SELF
    reference[free[touching]] = REFERENCE_VERDICTS.index("self_collision")

    variants = variants_of(models)
    codes = np.zeros((len(rows), len(variants)), dtype=np.int8)
    deviation = np.full((len(rows), len(models)), np.nan)
    for column, name in enumerate(models):
        model = session.model(name)
        checker = session.checker(session.scenario.with_planner(validity=name))
        shapes = checker.shapes(rows)
        both = (shapes.codes == 0) & solved
        apart = np.linalg.norm(shapes.positions[both] - states.positions[both], axis=2)
        deviation[both, column] = apart.max(axis=1)
        for place, variant in enumerate(variants):
            if variant.model != name:
                continue
            own = Shapes(shapes.codes.copy(), shapes.positions, shapes.rotations, shapes.levels)
            if variant.with_bound:
                checker.collide(own)
            else:
                margins = variant.margins(session.scenario, model.error_bound)
                ValidityChecker(session.space, model, session.scene.with_margins(margins)).collide(own)
            codes[:, place] = own.codes
    return Verdicts(rows, reference, np.where(solved, states.clearance, np.nan), codes, deviation, models)
