"""Validity: whether configurations respect the robot's limits and keep clear of the scene, many at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.limits import ROUNDING, at_most
from tdcr_planner.planning.causes import CAUSES, Cause, Codes
from tdcr_planner.planning.kernels import actuate, actuation_tables, to_world
from tdcr_planner.planning.margin_levels import Levels, MarginLevels
from tdcr_planner.planning.reasons import contact_reason
from tdcr_planner.planning.robot_limits import RobotLimits
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import Actuation, ConfigurationSpace
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.base import ShapeModel


class Scene(Protocol):
    """What the search asks of a collision scene; see `tdcr_planner.collision.scene.CollisionScene`."""

    def check(self, positions: FloatArray, rotations: FloatArray) -> Any:
        """Returns a verdict code a state, shape (n,): 0 free, else the code of a `Cause`."""
        ...

    def find_hit(self, positions: FloatArray, rotations: FloatArray) -> tuple[int, int]:
        """Returns the first state that is not free, of n in order, and its verdict code; -1 and 0 where all are."""
        ...

    def first_contact(self, positions: FloatArray, rotations: FloatArray) -> Any:
        """Returns the first contact of one state (with mesh_name or mesh, and part), or None."""
        ...

    def clearance(self, positions: FloatArray, rotations: FloatArray) -> FloatArray:
        """Returns the distance of the body from the nearest surface, shape (n,), m."""
        ...

    @property
    def prover(self) -> Any:
        """What bounds the body's slack; see `tdcr_planner.collision.prover.ClearanceProver`."""
        ...


@dataclass
class Shapes:
    """World-frame disk poses of a batch of configurations and what is known of their validity.

    Attributes:
        codes: Shape (n,); 0 where nothing speaks against the row so far.
        positions: Shape (n, d, 3), m, world frame; not to be used where the code is not 0.
        rotations: world_from_disk, shape (n, d, 3, 3).
        levels: Level of each state's margin, shape (n,); None where all keep the same.
        tensions: Shape (n, t), N, where the model solves for them; None where the drive sets them.
    """

    codes: Codes
    positions: FloatArray
    rotations: FloatArray
    levels: Levels | None = None
    tensions: FloatArray | None = None


def planning_margins(scenario: Scenario, model: ShapeModel) -> FloatArray:
    """Returns the distance each disk must keep from every surface, shape (d,), m.

    The clearance asked for and the shape model's error bound for the disk.
    """
    return np.asarray(scenario.required_clearance + model.error_bound)


class ValidityChecker:
    """Tests configurations in batches, the cheap tests first, and counts what it rejects by cause.

    Attributes:
        space: The configuration space whose rows it tests.
        model: The shape model that it asks.
        scene: The scene, whose body is inflated by `planning_margins`; where each state has a margin of its own, by
            the least of them.
        states_checked: How many states it has tested.
        rejected: How many states were rejected for each cause.
    """

    def __init__(
        self, space: ConfigurationSpace, model: ShapeModel, scene: Scene, *, base_margins: FloatArray | None = None
    ) -> None:
        """Prepares the checker; nothing is tested yet.

        Args:
            space: The configuration space.
            model: The shape model.
            scene: The scene, grown by its margins.
            base_margins: What each disk keeps besides an error bound that follows the state, shape (d,), m; None where
                the scene's margins hold for all states.
        """
        self.space = space
        self.model = model
        self._levels = None
        if base_margins is not None and model.bound_follows_state:
            self._levels = MarginLevels(scene, base_margins, model.error_bound)
            scene = self._levels.scene(0)
        self.scene = scene
        self.robot: RobotSpec = space.robot
        self.states_checked = 0
        self.rejected: dict[Cause, int] = dict.fromkeys(CAUSES, 0)
        self._ruled_out: list[tuple[FloatArray, float]] = []
        vectors_of_tension = space.coordinates.key == "bending_n"
        self._tables = actuation_tables(space, ROUNDING * self.robot.max_tensions) if vectors_of_tension else None
        self._limits = RobotLimits(self.robot)
        self._always_in_domain = self._domain_holds_everywhere()
        self._disk_poses = model.disk_poses_unchecked

    def check(self, rows: FloatArray) -> Codes:
        """Returns a code a row: 0 for valid, else that of the `Cause`.

        Args:
            rows: Configurations, shape (n, dimension).
        """
        shapes = self.shapes(rows)
        self.collide(shapes)
        self.count(shapes.codes)
        return shapes.codes

    def valid(self, rows: FloatArray) -> BoolArray:
        """Returns which rows are valid, shape (n,)."""
        return np.asarray(self.check(rows) == 0)

    def world_poses(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Returns positions (n, d, 3), rotations (n, d, 3, 3), world frame, and which rows have a shape, (n,).

        Limits are not tested here; a row outside the model's domain has no shape.
        """
        actuation, over, excessive = self._actuate(rows)
        codes = np.zeros(len(rows), dtype=np.int8)
        if excessive:
            if self._always_in_domain:
                codes[over] = Cause.MODEL_DOMAIN.code
            codes[~np.isfinite(rows).all(axis=1)] = Cause.NOT_FINITE.code
        shapes = self._place(actuation, codes)
        return shapes.positions, shapes.rotations, np.asarray(shapes.codes == 0)

    def actuate(self, rows: FloatArray) -> Actuation:
        """Returns what `ConfigurationSpace.actuate` returns, by compiled code."""
        return self._actuate(rows)[0]

    def _actuate(self, rows: FloatArray) -> tuple[Actuation, BoolArray, int]:
        """Returns actuations, which rows (n,) ask too much of the drive or are not finite, and how many do."""
        if self._tables is not None:
            *parts, over, excessive = actuate(rows, self._tables)
            return Actuation(*parts), over, excessive
        finite: BoolArray = np.asarray(np.isfinite(rows).all(axis=1))
        actuation = self.space.actuate(np.where(finite[:, None], rows, 0.0))
        over = np.asarray(~finite | (self.space.coordinates.within(actuation.tensions) > 1.0 + ROUNDING))
        return actuation, over, int(over.sum())

    def shapes(self, rows: FloatArray) -> Shapes:
        """Returns the shapes of rows (n, dimension) after every test but the scene's."""
        actuation, over, excessive = self._actuate(rows)
        codes = np.zeros(len(rows), dtype=np.int8)
        if excessive:
            displaced = self.robot.drive.kind == "displacement"
            codes[over] = (Cause.TENDON_DISPLACEMENT if displaced else Cause.TENSION_LIMIT).code
            codes[~np.isfinite(rows).all(axis=1)] = Cause.NOT_FINITE.code
        for centre, radius in self._ruled_out:
            near = (np.abs((rows - centre) * self.motion_scale).max(axis=1) < radius) & (codes == 0)
            codes[near] = Cause.RULED_OUT.code
        shapes = self._place(actuation, codes)
        if self._limits.any:
            alive = np.flatnonzero(shapes.codes == 0)
            shapes.codes[alive] = self._limits.check(actuation.tensions[alive], shapes.rotations[alive])
        if shapes.tensions is not None:
            pulled = ~np.asarray(at_most(np.nan_to_num(shapes.tensions), self.robot.max_tensions)).all(axis=1)
            shapes.codes[pulled & (shapes.codes == 0)] = Cause.TENSION_LIMIT.code
        return shapes

    def collide(self, shapes: Shapes, which: slice | NDArray[Any] = slice(None)) -> None:
        """Asks the scene about the rows that nothing speaks against and writes its verdicts into their codes."""
        codes = shapes.codes[which]
        if self._levels is None and not codes.any():
            shapes.codes[which] = self.scene.check(shapes.positions[which], shapes.rotations[which])
            return
        alive = np.flatnonzero(codes == 0)
        codes = codes.copy()
        for scene, part in self._by_scene(None if shapes.levels is None else shapes.levels[which], alive):
            codes[part] = scene.check(shapes.positions[which][part], shapes.rotations[which][part])
        shapes.codes[which] = codes

    def scene_for(self, shapes: Shapes) -> Scene:
        """Returns the scene whose margins cover all of some states."""
        if self._levels is None or shapes.levels is None:
            return self.scene
        return cast(Scene, self._levels.scene(int(shapes.levels.max(initial=0))))

    def _by_scene(self, levels: Levels | None, which: NDArray[Any]) -> Iterator[tuple[Scene, NDArray[Any]]]:
        """Yields the scene of each margin among some states, and which of them keep it."""
        if self._levels is None or levels is None:
            if len(which):
                yield self.scene, which
            return
        for level in np.unique(levels[which]):
            yield self._levels.scene(int(level)), which[levels[which] == level]

    def slack(self, configurations: FloatArray, cap: float) -> FloatArray:
        """Returns how far the body may move at each configuration without coming nearer than it must.

        The slack is what the body keeps beyond the required distance: the least over its parts of their distance from
        the walls less their margin, and half of what lies between two of its parts.

        Args:
            configurations: Shape (n, dimension).
            cap: The most that is of interest, m; smaller values are found faster.

        Returns:
            Certified lower bounds, `cap` at most, shape (n,), m. Where a configuration is in collision, or nearer than
            required, a number of 0 or less; minus infinity where it breaks a limit or has no shape.
        """
        shapes = self.shapes(configurations)
        known = shapes.codes == 0
        self.collide(shapes)
        found = np.full(len(configurations), -np.inf)
        free = shapes.codes == 0
        for scene, part in self._by_scene(shapes.levels, np.flatnonzero(free)):
            found[part] = scene.prover.slack(shapes.positions[part], shapes.rotations[part], cap)
        for scene, part in self._by_scene(shapes.levels, np.flatnonzero(known & ~free)):
            clearance = scene.clearance(shapes.positions[part], shapes.rotations[part])
            found[part] = np.minimum(clearance - scene.prover.required.max(initial=0.0), 0.0)
        self.count(shapes.codes)
        return found

    def count(self, codes: Codes) -> None:
        """Adds tested states to the counters."""
        self.states_checked += len(codes)
        if not codes.any():
            return
        for code in codes[codes != 0].tolist():
            self.rejected[CAUSES[code - 1]] += 1

    def rule_out(self, row: FloatArray, radius_m: float) -> None:
        """Rejects from now on what lies near a configuration.

        Args:
            row: The configuration, shape (dimension,).
            radius_m: How near, as motion of the body (each coordinate weighted by `motion_scale`), m.
        """
        self._ruled_out.append((np.array(row, dtype=np.float64), float(radius_m)))

    def explain(self, row: FloatArray) -> str:
        """Returns why a configuration is rejected; empty when it is valid.

        For a contact it names part and mesh, for a distance below the required one what that is made of.
        """
        shapes = self.shapes(row[None])
        if shapes.codes[0] == 0:
            self.collide(shapes)
        code = int(shapes.codes[0])
        if code == 0:
            return ""
        cause = CAUSES[code - 1]
        if cause not in (Cause.OBSTACLE, Cause.CAVITY, Cause.SELF_COLLISION):
            tensions = self.actuate(row[None]).tensions if shapes.tensions is None else shapes.tensions
            return self._limits.explain(cause, self.robot, tensions[0])
        bound = np.asarray(self.model.error_bound)
        if self._levels is not None and shapes.levels is not None:
            bound = self._levels.bound(int(shapes.levels[0]))
        reason = contact_reason(self.scene_for(shapes), bound, shapes.positions[0], shapes.rotations[0])
        return f"{cause.value}: {reason}" if reason else cause.value

    @cached_property
    def motion_scale(self) -> FloatArray:
        """How far the body's fastest point moves for one unit of each coordinate, shape (dimension,), m per unit.

        The median over random configurations within the tension limits, by differences.
        """
        return motion_scale(self)

    def _domain_holds_everywhere(self) -> bool:
        """Returns whether every row within the tension limits is inside the model's domain, told once.

        Where the domain is a box of tensions from 0 and a ball for each load, the corner of largest tensions, under
        the loads as they are, stands for all rows: roll turns the loads and keeps their size. Rows beyond the tension
        limits are rejected before.
        """
        if not self.model.domain_is_box:
            return False
        *_, gravity, tip_force = self.space.world
        corner = self.robot.max_tensions[None]
        return bool(self.model.in_domain(corner, gravity[None], tip_force[None]).all())

    def _place(self, actuation: Actuation, codes: Codes) -> Shapes:
        """Returns world poses of the rows whose code is 0, and codes for those without a shape."""
        if not self._always_in_domain:
            inside = self.model.in_domain(actuation.tensions, actuation.gravity, actuation.tip_force)
            if not inside.all():
                codes[(codes == 0) & ~inside] = Cause.MODEL_DOMAIN.code
        if not codes.any():
            return self._pose_all(actuation, codes)
        alive = np.flatnonzero(codes == 0)
        disks = self.robot.disk_count
        shapes = Shapes(codes, np.full((len(codes), disks, 3), np.nan), np.full((len(codes), disks, 3, 3), np.nan))
        if len(alive):
            posed = self._pose_all(actuation.take(alive), np.zeros(len(alive), dtype=np.int8))
            shapes.codes[alive] = posed.codes
            shapes.positions[alive] = posed.positions
            shapes.rotations[alive] = posed.rotations
            if posed.levels is not None:
                shapes.levels = np.zeros(len(codes), dtype=np.int8)
                shapes.levels[alive] = posed.levels
            if posed.tensions is not None:
                shapes.tensions = np.full((len(codes), self.robot.tendon_count), np.nan)
                shapes.tensions[alive] = posed.tensions
        return shapes

    def _pose_all(self, actuation: Actuation, codes: Codes) -> Shapes:
        inputs = actuation.tensions, actuation.gravity, actuation.tip_force
        levels = None
        if self._levels is None:
            poses = self._disk_poses(*inputs)
        else:
            poses, bounds = self.model.poses_and_bounds(*inputs)
            levels = self._levels.of(bounds)
        positions, rotations, finite, broken = to_world(
            poses.positions, poses.rotations, actuation.base_positions, actuation.base_rotations
        )
        if broken:
            codes[~finite] = Cause.NOT_FINITE.code
        if not poses.solved.all():
            codes[~poses.solved] = Cause.NO_SHAPE.code
        return Shapes(codes, positions, rotations, levels, poses.tensions)


def motion_scale(checker: ValidityChecker, samples: int = 24, seed: int = 0) -> FloatArray:
    """Returns the median motion of the body's fastest disk point for one unit of each coordinate, m per unit."""
    space = checker.space
    generator = np.random.default_rng(seed)
    span = space.upper - space.lower
    rows = sample_within_tensions(checker, samples, generator)
    shift = 1e-3 * span
    stacked = np.concatenate([rows, *(rows + shift * unit for unit in np.eye(space.dimension))])
    positions, rotations, solved = checker.world_poses(stacked)
    positions = positions.reshape(space.dimension + 1, samples, -1, 3)
    rotations = rotations.reshape(space.dimension + 1, samples, -1, 3, 3)
    usable = solved.reshape(space.dimension + 1, samples)
    turn = np.linalg.norm(rotations[1:] - rotations[0], axis=(-2, -1)) / np.sqrt(2.0)
    motion = np.linalg.norm(positions[1:] - positions[0], axis=-1) + turn * disk_reaches(checker.robot)
    fastest = np.where(usable[1:] & usable[0], motion.max(axis=-1), np.nan)
    scale = np.array([np.nanmedian(row) if np.isfinite(row).any() else 0.0 for row in fastest]) / shift
    # A coordinate that moves nothing keeps a small weight, so that the planner's space stays a metric space.
    return np.asarray(np.maximum(scale, 1e-6 / span))


def disk_reaches(robot: RobotSpec) -> FloatArray:
    """Returns the largest distance of a point of each disk from its centre, shape (d,), m."""
    return np.asarray(np.hypot(robot.disk_radii, robot.disk_thicknesses / 2.0))


def sample_within_tensions(checker: ValidityChecker, count: int, generator: np.random.Generator) -> FloatArray:
    """Returns random rows (count, dimension), uniform among those whose tensions are within their limits."""
    return checker.space.sample(count, generator)


def rejections(counts: dict[Cause, int] | Iterable[tuple[Cause, int]]) -> dict[str, int]:
    """Returns the counts by cause as plain names, without the zeros."""
    return {cause.value: count for cause, count in dict(counts).items() if count}
