"""The learned shape model: reading its file, refusing what it was not made for, and answering fast."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray, check_array, check_batch
from tdcr_planner.errors import DomainError, InputError, RobotMismatchError
from tdcr_planner.files import sha256_of_file
from tdcr_planner.limits import at_most
from tdcr_planner.robot import RobotSpec, refuse_unknown
from tdcr_planner.shape.base import DiskPoses, ShapeModel
from tdcr_planner.shape.correction import Corrector
from tdcr_planner.shape.engines import Device, Evaluator, make_evaluator
from tdcr_planner.shape.model_file import Engine, ModelFile, read_model_file
from tdcr_planner.shape.rod_kernel import rod_constants, rod_constants_at
from tdcr_planner.shape.shooting import ShootingFunction

if TYPE_CHECKING:
    import torch

BoundKind = Literal["state", "uniform"]
"""Which error bound a model states: one that follows the state, where it has one, or the same in every state."""


@dataclass(frozen=True)
class Answer:
    """The shapes of a batch and what is known of them.

    Attributes:
        positions: Shape (n, d, 3), m, base frame.
        rotations: base_from_disk, shape (n, d, 3, 3).
        residual: Moment left over at the tip, shape (n,), N m; None where it is not known.
        scale: Scale of each disk's bound, shape (n, d), m, without floor and factor; see `StateMargin`. None where it
            was not asked for.
    """

    positions: FloatArray
    rotations: FloatArray
    residual: FloatArray | None
    scale: FloatArray | None


class LearnedShape(ShapeModel):
    """A trained model as a `ShapeModel`.

    Attributes:
        robot: The robot, with the limits of whoever loaded the model.
        card: What the model says about itself.
        error_bound: Shape (d,), m: covers every point of disk d (centre error plus disk radius times rotation chord)
            with probability 1 - alpha, all disks at once; where the bound follows the state, the most that it can be.
        bound_follows_state: Whether each state has a bound of its own, `error_bound_at`.
        engine: What evaluates the network.
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

    def __init__(
        self,
        path: Path,
        content: ModelFile,
        robot: RobotSpec | None,
        *,
        engine: Engine | None = None,
        device: Device = "cpu",
        bound: BoundKind = "state",
    ) -> None:
        """Prepares a model; use `load_shape_model`."""
        self.path = path
        self.card = card = content.card
        self.robot = robot or card.robot
        self.sha256 = sha256_of_file(path)
        # The bound's rotation part grows with the disk radius, which a robot may change without a new training.
        self._growth = np.maximum(1.0, self.robot.disk_radii / card.robot.disk_radii)
        self._max_tensions = np.asarray(card.domain.max_tension_n)
        limit = card.error_bound.residual_limit_nm
        self._residual_limit = np.inf if limit is None else limit
        self._content = content
        self._corrects = card.adoption is not None and card.adoption.correct
        self._chosen: tuple[str, str] | None = None
        self.use(engine=engine, device=device, bound=bound)

    def use(self, *, engine: str | None = None, device: str = "cpu", bound: str = "state") -> None:
        """Chooses what evaluates the model, where, and which bound it states; see `load_shape_model`."""
        chosen = engine or self._content.engines[0], device
        if chosen != self._chosen:
            self._evaluate: Evaluator = make_evaluator(self.path, self._content, *chosen)
            self._chosen = chosen
        self.engine = chosen[0]
        margin = self.card.state_margin
        self.bound_follows_state = bound == "state" and margin is not None
        disks = self.card.error_bound.disk_m
        if self.bound_follows_state and margin is not None:
            disks = margin.ceiling_m
        self.error_bound = np.asarray(disks) * self._growth

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
        if content.foreign is not None:
            raise InputError("torch_module", "a network of this project", "an adopted one")
        return paper_module(self.path, self.card, content.tensors)

    @cached_property
    def _has_weight(self) -> bool:
        """Whether gravity does anything to the robot."""
        return rod_constants(self.card.robot).base_mass > 0.0

    @cached_property
    def _corrector(self) -> Corrector:
        return Corrector(self.card.robot)

    def in_domain(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> BoolArray:
        """Returns which rows lie inside the model's domain, shape (n,); see `ShapeModel.in_domain`."""
        domain = self.card.domain
        inside = (tensions >= 0.0).all(axis=1) & at_most(tensions, self._max_tensions).all(axis=1)
        if self._has_weight:
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
        answer = self.answer(tensions, gravity, tip_force, with_scale=False)
        return self._poses(answer.positions, answer.rotations, answer.residual)

    def poses_and_bounds(
        self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
    ) -> tuple[DiskPoses, FloatArray]:
        """Returns `disk_poses_unchecked` and `error_bound_at` of the same states, at the cost of one of them."""
        answer = self.answer(tensions, gravity, tip_force)
        poses = self._poses(answer.positions, answer.rotations, answer.residual)
        margin = self.card.state_margin
        if answer.scale is None or margin is None or not self.bound_follows_state:
            return poses, self.error_bound
        own = (answer.scale + margin.floor_m) * (np.asarray(margin.factor) * self._growth)
        # Far beyond the largest bound that was seen, or where mechanics give no shape, nothing is known of the error.
        known = np.asarray((own <= self.error_bound).all(axis=1))
        solved = np.asarray(poses.solved & known)
        return DiskPoses(poses.positions, poses.rotations, solved), np.fmin(own, self.error_bound)

    def error_bound_at(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> FloatArray:
        """Returns the bound of each state; see `ShapeModel.error_bound_at`."""
        if not self.bound_follows_state:
            return self.error_bound
        return self.poses_and_bounds(tensions, gravity, tip_force)[1]

    def answer(
        self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray, *, with_scale: bool | None = None
    ) -> Answer:
        """Returns the shapes of a batch with all that is known of them; arguments as in `disk_poses_unchecked`.

        Args:
            tensions: Shape (n, t), N.
            gravity: Shape (n, 3), m/s^2, base frame.
            tip_force: Shape (n, 3), N, base frame.
            with_scale: Whether the scale of each state's bound is asked for; None where the model needs it.
        """
        inputs = _contiguous(tensions, gravity, tip_force)
        positions, rotations, residual = self._evaluate(*inputs)
        wanted = self.bound_follows_state if with_scale is None else with_scale
        if not (wanted or self._corrects):
            return Answer(positions, rotations, residual, None)
        step = self._corrector.correct(positions, *inputs)
        if self._corrects:
            return Answer(step.positions, step.rotations, step.residual, step.remainder)
        return Answer(positions, rotations, residual, self._corrector.scale(positions, rotations, step))

    def _poses(self, positions: FloatArray, rotations: FloatArray, residual: FloatArray | None) -> DiskPoses:
        solved = np.ones(len(positions), dtype=np.bool_) if residual is None else residual <= self._residual_limit
        return DiskPoses(positions, rotations, solved)

    @property
    def has_residual(self) -> bool:
        """Whether each answer says what moment it leaves unbalanced at the tip."""
        return self._content.weights is not None or self._corrects

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
        if not isinstance(self._evaluate, ShootingFunction):
            raise InputError("arc_lengths", "a compiled model with the `shooting` network", f"{self._description}")
        constants, columns = rod_constants_at(self.card.robot, stops)
        positions, rotations, residual = self._evaluate.with_constants(
            constants, *self._check(tensions, gravity, tip_force)
        )
        return DiskPoses(positions[:, columns], rotations[:, columns], residual <= self._residual_limit)

    def residual(
        self, tensions: ArrayLike, *, gravity: ArrayLike | None = None, tip_force: ArrayLike | None = None
    ) -> FloatArray:
        """Returns the moment that each shape leaves unbalanced at the tip (residual of the cut form), (n,), N m."""
        residual = self.answer(*self._check(tensions, gravity, tip_force), with_scale=False).residual
        if residual is None:
            raise InputError("residual", "a model that corrects its shapes by mechanics", f"{self._description}")
        return residual

    @property
    def _description(self) -> str:
        return f"network {self.card.network!r}, evaluated by {self.engine}"

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


def _contiguous(*arrays: FloatArray) -> tuple[FloatArray, ...]:
    return tuple(np.ascontiguousarray(array) for array in arrays)


def load_shape_model(
    path: str | Path,
    robot: RobotSpec | None = None,
    *,
    engine: Engine | None = None,
    device: Device = "cpu",
    bound: BoundKind = "state",
) -> LearnedShape:
    """Returns the model that a file holds.

    Of this project's own models nothing in the file is run. An adopted network is a program: it is checked first, and
    only what computes shapes is let through.

    Args:
        path: A file written by `tdcr train`.
        robot: The robot it shall serve; None for the one in its card.
        engine: What evaluates it: "compiled", "torchscript" or "onnx"; None for the fastest that the file has.
        device: "cpu", or "cuda" with "torchscript".
        bound: "state" for a bound that follows the state, where the file has one; "uniform" for the same everywhere.

    Raises:
        FormatError: The file is missing, damaged, no shape model of this format, or holds another module.
        InputError: The robot has what the learned model does not know, the file has no such engine, or there is no
            such device.
        RobotMismatchError: It was made for a robot with other mechanics.
    """
    path = Path(path)
    content = read_model_file(path)
    card = content.card
    if robot is not None:
        refuse_unknown(robot, (), "the learned model")
    if robot is not None and robot.mechanics_hash != card.robot_mechanics_hash:
        raise RobotMismatchError(
            f"{card.robot.name!r} (mechanics {card.robot_mechanics_hash[:12]})",
            f"{robot.name!r} (mechanics {robot.mechanics_hash[:12]})",
            str(path),
        )
    return LearnedShape(path, content, robot, engine=engine, device=device, bound=bound)
