"""The learned shape model: reading its file, refusing what it was not made for, and answering fast."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray, check_array, check_batch
from tdcr_planner.errors import DomainError, InputError, RobotMismatchError
from tdcr_planner.files import sha256_of_file
from tdcr_planner.limits import at_most
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.base import DiskPoses, ShapeModel
from tdcr_planner.shape.model_file import ModelFile, read_model_file
from tdcr_planner.shape.rod_kernel import rod_constants, rod_constants_at
from tdcr_planner.shape.shooting import ShootingFunction

if TYPE_CHECKING:
    import torch


class LearnedShape(ShapeModel):
    """A trained model as a `ShapeModel`.

    Attributes:
        robot: The robot, with the limits of whoever loaded the model.
        card: What the model says about itself.
        error_bound: Shape (d,), m: covers every point of disk d (centre error plus disk radius times rotation chord)
            with probability 1 - alpha, all disks at once.
        path: The model file.
        sha256: Hash of the model file.
    """

    name = "learned"
    title = "learned"
    colour = "#0072B2"
    marker = "o"
    needs_file = True
    has_error_bound = True
    domain_is_box = True
    sha256: str

    def __init__(self, path: Path, content: ModelFile, robot: RobotSpec | None) -> None:
        """Prepares a model; use `load_shape_model`."""
        self.path = path
        self.card = card = content.card
        self.robot = robot or card.robot
        self.sha256 = sha256_of_file(path)
        # The bound's rotation part grows with the disk radius, which a robot may change without a new training.
        growth = np.maximum(1.0, self.robot.disk_radii / card.robot.disk_radii)
        self.error_bound: FloatArray = np.asarray(card.error_bound.disk_m) * growth
        self._max_tensions = np.asarray(card.domain.max_tension_n)
        limit = card.error_bound.residual_limit_nm
        self._residual_limit = np.inf if limit is None else limit
        self._content = content
        weights = content.weights
        self._function = None if weights is None else ShootingFunction(rod_constants(card.robot), weights)

    @classmethod
    def load(cls, robot: RobotSpec, file: Path | None) -> LearnedShape:
        """Returns the model of a file for a robot; see `load_shape_model`."""
        if file is None:
            raise InputError("shape_model", "a model file, as `tdcr train` writes it", "none")
        return load_shape_model(file, robot)

    @cached_property
    def torch_module(self) -> torch.jit.ScriptModule:
        """The TorchScript module of the same weights, built from this project's classes.

        The program that the file stores is for others, such as C++; it is never loaded.
        """
        from tdcr_planner.shape.torch_module import paper_module, shooting_module

        content = self._content
        if content.weights is not None:
            return shooting_module(self.card, content.weights)
        return paper_module(self.path, self.card, content.tensors)

    def in_domain(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> BoolArray:
        """Returns which rows lie inside the model's domain, shape (n,); see `ShapeModel.in_domain`."""
        domain = self.card.domain
        inside = (tensions >= 0.0).all(axis=1) & at_most(tensions, self._max_tensions).all(axis=1)
        inside &= at_most(np.linalg.norm(gravity, axis=1), domain.gravity_m_s2)
        inside &= at_most(np.linalg.norm(tip_force, axis=1), domain.tip_force_n)
        return np.asarray(inside)

    def disk_poses(
        self,
        tensions: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        tip_force: ArrayLike | None = None,
    ) -> DiskPoses:
        """Returns the disk poses of a batch; see `ShapeModel.disk_poses`.

        Raises:
            InputError: Wrong shape, NaN or negative tension.
            DomainError: A row lies outside the model's domain; names row, value and limit.
        """
        return self.disk_poses_unchecked(*self._check(tensions, gravity, tip_force))

    def disk_poses_unchecked(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> DiskPoses:
        """The same without any check: for callers that have checked their inputs, as the planner has.

        Args:
            tensions: Shape (n, t), N, float64.
            gravity: Shape (n, 3), m/s^2, base frame, float64.
            tip_force: Shape (n, 3), N, base frame, float64.
        """
        if self._function is None:
            positions, rotations = self._run_torch(tensions, gravity, tip_force)
            return DiskPoses(positions, rotations, np.ones(len(tensions), dtype=np.bool_))
        positions, rotations, residual = self._function(
            np.ascontiguousarray(tensions), np.ascontiguousarray(gravity), np.ascontiguousarray(tip_force)
        )
        return DiskPoses(positions, rotations, residual <= self._residual_limit)

    def poses_at(
        self,
        arc_lengths: ArrayLike,
        tensions: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        tip_force: ArrayLike | None = None,
    ) -> DiskPoses:
        """Returns the poses of cross-sections anywhere along the backbone.

        Args:
            arc_lengths: Shape (k,), m, increasing, from 0 to the robot's length.
            tensions: Shape (n, t), N.
            gravity: Shape (3,) or (n, 3), m/s^2, base frame; None for none.
            tip_force: Shape (3,) or (n, 3), N, base frame; None for none.

        Returns:
            Poses with k cross-sections in the place of d disks.
        """
        stops = check_array("arc_lengths", arc_lengths, (None,))
        length = self.robot.length
        if not len(stops) or (np.diff(stops) <= 0.0).any() or stops[0] < 0.0 or not at_most(stops[-1], length):
            raise InputError("arc_lengths", f"increasing numbers from 0 to {length:g} m", stops.tolist())
        if self._function is None:
            raise InputError("arc_lengths", "a model with the `shooting` network", f"network {self.card.network!r}")
        constants, columns = rod_constants_at(self.card.robot, stops)
        positions, rotations, residual = self._function.with_constants(
            constants, *self._check(tensions, gravity, tip_force)
        )
        return DiskPoses(positions[:, columns], rotations[:, columns], residual <= self._residual_limit)

    def residual(
        self, tensions: ArrayLike, *, gravity: ArrayLike | None = None, tip_force: ArrayLike | None = None
    ) -> FloatArray:
        """Returns the moment that each shape leaves unbalanced at the tip (residual of the cut form), (n,), N m."""
        if self._function is None:
            raise InputError("residual", "a model with the `shooting` network", f"network {self.card.network!r}")
        return self._function(*self._check(tensions, gravity, tip_force))[2]

    def _check(
        self, tensions: ArrayLike, gravity: ArrayLike | None, tip_force: ArrayLike | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        tension = self.robot.check_tensions(tensions)
        g = check_batch("gravity", gravity, len(tension), 3)
        f = check_batch("tip_force", tip_force, len(tension), 3)
        outside = np.flatnonzero(~self.in_domain(tension, g, f))
        if len(outside):
            self._refuse(int(outside[0]), tension, g, f)
        return tension, g, f

    def _refuse(self, row: int, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> None:
        domain = self.card.domain
        over = np.flatnonzero(~at_most(tensions[row], self._max_tensions))
        if len(over):
            column = int(over[0])
            limit, value = self._max_tensions[column], tensions[row, column]
            raise DomainError(
                "tensions",
                f"at most {limit:g} N, the domain of {self.path}",
                f"{value:g} N in row {row}, tendon {column}",
            )
        loads = (
            ("gravity", gravity, domain.gravity_m_s2, "m/s^2"),
            ("tip_force", tip_force, domain.tip_force_n, "N"),
        )
        for name, vectors, limit, unit in loads:
            size = float(np.linalg.norm(vectors[row]))
            if not at_most(size, limit):
                raise DomainError(
                    name, f"at most {limit:g} {unit}, the domain of {self.path}", f"{size:g} {unit} in row {row}"
                )

    def _run_torch(
        self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        import torch

        # One load for all rows is a view that torch could not write to, of which it warns.
        inputs = [
            torch.from_numpy(np.require(array, requirements=("C", "W"))) for array in (tensions, gravity, tip_force)
        ]
        with torch.inference_mode():
            positions, rotations = self.torch_module(*inputs)
        return positions.numpy(), rotations.numpy()


def load_shape_model(path: str | Path, robot: RobotSpec | None = None) -> LearnedShape:
    """Returns the model that a file holds; nothing of the file is run.

    Args:
        path: A file written by `tdcr train`.
        robot: The robot it shall serve; None for the one in its card.

    Raises:
        FormatError: The file is missing, damaged, no shape model of this format, or holds another module.
        RobotMismatchError: It was made for a robot with other mechanics.
    """
    path = Path(path)
    content = read_model_file(path)
    card = content.card
    if robot is not None and robot.mechanics_hash != card.robot_mechanics_hash:
        raise RobotMismatchError(
            f"{card.robot.name!r} (mechanics {card.robot_mechanics_hash[:12]})",
            f"{robot.name!r} (mechanics {robot.mechanics_hash[:12]})",
            str(path),
        )
    return LearnedShape(path, content, robot)
