"""Whether a trained model is fit for planning with its robot, and if not, which part of its domain is to blame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdcr_planner.learning.dataset import Cases, Progress, Sample, draw_cases, no_progress, solve_cases
from tdcr_planner.learning.judge import body_errors
from tdcr_planner.shape.card import Domain
from tdcr_planner.shape.learned import LearnedShape

FIT_IN_RADII = 0.25
"""A fit model's largest error bound, in disk radii. A robot that passes openings of 1.5 times its own width has half a
disk radius on each side; the clearance takes 0.05 of it by default, the bound may take 0.25."""
FIT_STATES = 0.9
"""Of a bound that follows the state, the part of the planner's states in which it must be that small."""
_BLAME_CASES = 4000


@dataclass(frozen=True)
class Fitness:
    """A model's error bound against the size of its robot.

    Attributes:
        bound_m: Bound of the disk where it is largest in disk radii.
        radius_m: That disk's radius.
        disk: That disk's index, base 0.
        states: The part of the states, as the planner meets them, that have no larger bound; 1 for a uniform bound.
        blame: What the bound would be with each part of the domain halved, (name, m), the smallest first; empty for a
            fit model.
    """

    bound_m: float
    radius_m: float
    disk: int
    states: float = 1.0
    blame: tuple[tuple[str, float], ...] = ()

    @property
    def fit(self) -> bool:
        """Whether the bound is at most `FIT_IN_RADII` disk radii at every disk."""
        return self.bound_m <= FIT_IN_RADII * self.radius_m

    def describe(self) -> str:
        """Returns the verdict in one or a few lines."""
        where = "" if self.states == 1.0 else f"in {self.states:.0%} of states at most, "
        size = (
            f"{where}the error bound of {1e3 * self.bound_m:.3g} mm at disk {self.disk} is "
            f"{self.bound_m / self.radius_m:.0%} of the disk's radius of {1e3 * self.radius_m:.3g} mm"
        )
        if self.fit:
            return f"fit for planning: {size}, at most {FIT_IN_RADII:.0%} is"
        lines = [
            f"NOT fit for planning: {size}, and at most {FIT_IN_RADII:.0%} is: the planner keeps the robot that far "
            "from every surface"
        ]
        if self.blame:
            name, bound = self.blame[0]
            lines.append(f"most to blame: {name}; with half as much the bound would be {1e3 * bound:.3g} mm")
            lines += [f"  with half the {other} {1e3 * bound:.3g} mm" for other, bound in self.blame[1:]]
        lines.append(
            "train for a smaller [domain], with more [dataset] cases, [optimiser] epochs or [shooting] corrections; or "
            "plan with validity = 'reference'"
        )
        return "\n".join(lines)


def judge_fitness(model: LearnedShape, *, seed: int = 0, threads: int = 1, progress: Progress = no_progress) -> Fitness:
    """Returns whether a model is fit for planning with its robot.

    For one that is not, each load and the tensions are halved in turn, and the model is judged again on cases of that
    part of its domain.

    Args:
        model: The model.
        seed: Seed of those cases.
        threads: Threads of the reference.
        progress: Called with stage, steps done, steps in all and a remark.
    """
    fitness = _state_fitness(model, seed) if model.bound_follows_state else _uniform_fitness(model)
    if fitness.fit:
        return fitness
    # Quantiles of equally many cases compare with one another; their ratio to the whole domain's scales the bound.
    whole = _error_quantile(model, model.card.domain, seed, threads, progress, "whole domain")
    blame = [
        (name, fitness.bound_m * _error_quantile(model, domain, seed, threads, progress, f"half the {name}") / whole)
        for name, domain in _halved(model.card.domain)
    ]
    return replace(fitness, blame=tuple(sorted(blame, key=lambda item: item[1])))


def _uniform_fitness(model: LearnedShape) -> Fitness:
    radii = model.robot.disk_radii
    disk = int(np.argmax(model.error_bound / radii))
    return Fitness(float(model.error_bound[disk]), float(radii[disk]), disk)


def _state_fitness(model: LearnedShape, seed: int) -> Fitness:
    """Returns the fitness by the bound that all but the worst of the planner's states have."""
    radii = model.robot.disk_radii
    generator = np.random.default_rng([seed, 2002])
    cases = draw_cases(model.card.robot, model.card.domain, "planner", _BLAME_CASES, generator)
    bounds = np.broadcast_to(
        model.error_bound_at(cases.tensions, cases.gravity, cases.tip_force), (len(cases), len(radii))
    )
    most = np.quantile(bounds, FIT_STATES, axis=0)
    disk = int(np.argmax(most / radii))
    return Fitness(float(most[disk]), float(radii[disk]), disk, FIT_STATES)


def _halved(domain: Domain) -> list[tuple[str, Domain]]:
    """Returns the domain with each of its parts halved in turn, with the part's name."""
    limits = tuple(0.5 * limit for limit in domain.max_tension_n)
    halved = [("tensions", domain.model_copy(update={"max_tension_n": limits}))]
    if domain.gravity_m_s2 > 0.0:
        halved.append(("gravity", domain.model_copy(update={"gravity_m_s2": 0.5 * domain.gravity_m_s2})))
    if domain.tip_force_n > 0.0:
        halved.append(("tip force", domain.model_copy(update={"tip_force_n": 0.5 * domain.tip_force_n})))
    return halved


def _error_quantile(
    model: LearnedShape, domain: Domain, seed: int, threads: int, progress: Progress, stage: str
) -> float:
    """Returns the 1 - alpha quantile of the body's error in a domain, the larger of both samples', m."""
    robot = model.card.robot
    samples: tuple[Sample, ...] = ("planner", "uniform")
    found = []
    for index, sample in enumerate(samples):
        cases: Cases = draw_cases(robot, domain, sample, _BLAME_CASES, np.random.default_rng([seed, 2000 + index]))
        solved = solve_cases(robot, cases, threads=threads, progress=progress, stage=stage)
        poses = model.disk_poses_unchecked(solved.cases.tensions, solved.cases.gravity, solved.cases.tip_force)
        errors = body_errors(robot, poses.positions, poses.rotations, solved).max(axis=1)
        found.append(float(np.quantile(errors, 1.0 - model.card.error_bound.alpha)))
    return max(found)
