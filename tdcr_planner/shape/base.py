"""What every shape model offers: disk poses from tensions and loads, a domain, a bound on its error, and its name.

A shape model is a class in one file: it says how files and pictures call it, how it is loaded, what its answers cost
and how far they may be trusted. `shape.registry` finds it by its name. A bound that depends on the state is
`error_bound_at`; the default is the same bound for all states.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec

WARM_UPS = 3
"""Answers after which the first ones' cost, as compiling and allocating, is over."""


@dataclass(frozen=True)
class DiskPoses:
    """The disks of a batch of shapes, base included.

    Attributes:
        positions: Disk centres, shape (n, d, 3), m, base frame.
        rotations: base_from_disk, shape (n, d, 3, 3).
        solved: Shape (n,); false where the model has no shape to offer (the reference did not converge). Poses of
            such a row must not be used.
        tensions: Shape (n, t), N, where the drive sets displacements and the model solves for them; else None.
    """

    positions: FloatArray
    rotations: FloatArray
    solved: BoolArray
    tensions: FloatArray | None = None


class ShapeModel(ABC):
    """A map from tensions and loads to disk poses.

    A class states what holds for all of its models; `load`, `disk_poses` and the attributes `robot` and `error_bound`
    are what it must have, all else has a default.

    Attributes:
        name: What scenario and suite files call it.
        title: What pictures and tables call it; its name where it is empty.
        colour: Its colour in pictures, "#rrggbb".
        marker: Its marker in plots, as matplotlib names it.
        needs_file: Whether it is loaded from the file that the scenario names as its shape_model.
        has_error_bound: Whether it states a bound on its error, so that verdicts with and without it differ.
        is_fast: Whether thousands of shapes in a call cost little; goal states are sampled more sparsely without it.
        knows: Names, of `robot.FEATURES`, of what it knows beyond what a version 1 robot file can say.
        domain_is_box: Whether its domain is a box of tensions from 0 and a ball for each load, so that the largest
            tensions stand for all.
        robot: The robot whose shape it gives.
        error_bound: Bound on the position error of each disk against the reference, all states, shape (d,), m; zeros
            for a model that states none.
        sha256: Hash of the file that decides its answers; None without a file.
        bound_follows_state: Whether each state has a bound of its own, `error_bound_at`.
    """

    name: ClassVar[str]
    title: ClassVar[str] = ""
    colour: ClassVar[str] = "#6E6E6E"
    marker: ClassVar[str] = "^"
    needs_file: ClassVar[bool] = False
    has_error_bound: ClassVar[bool] = False
    is_fast: ClassVar[bool] = True
    knows: ClassVar[frozenset[str]] = frozenset()
    domain_is_box: ClassVar[bool] = False

    robot: RobotSpec
    error_bound: FloatArray
    sha256: str | None = None
    bound_follows_state: bool = False

    @classmethod
    def label(cls) -> str:
        """Returns what pictures and tables call the model."""
        return cls.title or cls.name.replace("_", " ")

    @classmethod
    @abstractmethod
    def load(cls, robot: RobotSpec, file: Path | None) -> Self:
        """Returns the model for a robot.

        Args:
            robot: The robot.
            file: The scenario's shape_model, absolute; None where it names none, which never happens to a model that
                needs a file.

        Raises:
            TdcrError: The file or the robot cannot be used.
        """

    @abstractmethod
    def disk_poses(
        self,
        tensions: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        tip_force: ArrayLike | None = None,
    ) -> DiskPoses:
        """Returns the disk poses of a batch.

        Args:
            tensions: Shape (n, t), N, one column a tendon in the robot file's order; displacements, m, of a robot that
                is driven by displacement, for the models that know such robots.
            gravity: Shape (3,) or (n, 3), m/s^2, base frame; None for none.
            tip_force: Shape (3,) or (n, 3), N, base frame, at the last disk; None for none.

        Raises:
            InputError: Wrong shape, NaN or negative tension.
            DomainError: A row lies outside the model's domain.
        """

    def disk_poses_unchecked(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> DiskPoses:
        """Returns the disk poses of a batch for callers that have checked their inputs, as the planner has.

        Args:
            tensions: Shape (n, t), N, float64.
            gravity: Shape (n, 3), m/s^2, base frame, float64.
            tip_force: Shape (n, 3), N, base frame, float64.
        """
        return self.disk_poses(tensions, gravity=gravity, tip_force=tip_force)

    def in_domain(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> BoolArray:  # noqa: ARG002
        """Returns which rows lie inside the model's domain, shape (n,); all of them by default.

        Args:
            tensions: Shape (n, t), N.
            gravity: Shape (n, 3), m/s^2, base frame.
            tip_force: Shape (n, 3), N, base frame.
        """
        return np.ones(len(tensions), dtype=np.bool_)

    def error_bound_at(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> FloatArray:  # noqa: ARG002
        """Returns the bound on each disk's position error, m: shape (n, d) by state, or (d,) where it is the same.

        No entry may exceed `error_bound`, which stands for the states whose own bound nobody asks for.

        Args:
            tensions: Shape (n, t), N.
            gravity: Shape (n, 3), m/s^2, base frame.
            tip_force: Shape (n, 3), N, base frame.
        """
        return self.error_bound

    def poses_and_bounds(
        self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
    ) -> tuple[DiskPoses, FloatArray]:
        """Returns `disk_poses_unchecked` and `error_bound_at` of the same states, for models that know both at once."""
        inputs = tensions, gravity, tip_force
        return self.disk_poses_unchecked(*inputs), self.error_bound_at(*inputs)

    def use(self, *, engine: str | None = None, device: str = "cpu", bound: str = "state") -> None:  # noqa: ARG002
        """Chooses what evaluates a model of a file, where, and which bound it states; by default there is no choice.

        Args:
            engine: Name of what evaluates it; None for the fastest.
            device: "cpu" or "cuda".
            bound: "state" or "uniform".

        Raises:
            InputError: The model has no such engine, or there is no such device.
        """
        if engine is not None:
            raise InputError("shape_engine", f"none, which the model {self.name!r} does not have", engine)

    def warm_up(self) -> None:
        """Answers a few times, so that what the first answers cost is no part of a query's time."""
        at_rest = self.robot.pretensions[None]
        if self.robot.drive.kind == "displacement":
            at_rest = np.zeros_like(at_rest)
        for _ in range(WARM_UPS):
            self.disk_poses(at_rest)
