"""Reach: which cells of a volume the tip attains with a free, stable shape, by a path from the start, else why not."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.inspection.grid import Grid
from tdcr_planner.planning.causes import CAUSES, Cause
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.validity import ValidityChecker, sample_within_tensions
from tdcr_planner.query.session import PlanningSession

Progress = Callable[[float, str], None]

_BATCH = 4096
_REACH = 0.2  # longest step of growth, in robot lengths of body motion
_HALVINGS = 6
_TRIED = 4  # reached states to which a state is tried to be joined
_LINKS = 200  # states tried to be joined between two batches
_ROADMAP = 0.4  # of the time, for the roadmap
_FIRST_S = 0.3
_IDLE = 12  # batches without anything gained after which the map is done
_WIDEN = 0.02  # of the volume's sides, on each end
_FIRST = 20_000  # states that tell the volume
_NEIGHBOURS = np.ones((3, 3, 3), dtype=np.bool_)


class Verdict(IntEnum):
    """What is known of a cell."""

    REACHED = 0
    NO_PATH = 1
    COLLIDES = 2
    LIMIT = 3
    OUT_OF_REACH = 4


NAMES = {
    Verdict.REACHED: "reached by a path from the start",
    Verdict.NO_PATH: "a free shape attains it, no path found",
    Verdict.COLLIDES: "every shape found collides",
    Verdict.LIMIT: "beyond a limit of the robot",
    Verdict.OUT_OF_REACH: "out of reach",
}


@dataclass(frozen=True, eq=False)
class ReachMap:
    """What is known of the cells of a volume.

    Attributes:
        grid: The cells.
        verdicts: `Verdict` of each cell, shape (cells,).
        causes: What collides or which limit is broken, by name, "" where nothing is in the way, one a cell.
        rows: A configuration that attains each cell, shape (cells, dimension); NaN where none is known.
        tips: Its tip under the reference, shape (cells, 3), m; NaN likewise.
        states: How many states were looked at.
        confirmed: How many attained cells the reference was asked about: all of them.
        refused: How many of these it refused; they are not called attained.
        seconds: Time that it took.
    """

    grid: Grid
    verdicts: IntArray
    causes: tuple[str, ...]
    rows: FloatArray
    tips: FloatArray
    states: int
    confirmed: int
    refused: int
    seconds: float

    def count(self, verdict: Verdict) -> int:
        """Returns how many cells have a verdict."""
        return int((self.verdicts == verdict).sum())

    @property
    def reached_volume(self) -> float:
        """Volume of the cells that are reached, m^3."""
        return self.count(Verdict.REACHED) * self.grid.size**3


def map_reach(
    session: PlanningSession,
    *,
    cells: int = 10_000,
    grid: Grid | None = None,
    time_limit_s: float = 20.0,
    batches: int | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> ReachMap:
    """Returns which cells the tip attains in a session's scene.

    States are drawn over the whole space and around those that attain cells beside cells that none attains. Each state
    that attains a cell is tried to be joined to those that the start reaches by a proven motion. At the end the
    reference is asked about the state of every attained cell: it must have a stable shape within the limits, keep the
    clearance, and put the tip into the cell.

    Args:
        session: The scene.
        cells: Number of cells, about.
        grid: The cells; None for a box around all tips that shapes within the limits have, cut to that
            around the scene's cavities.
        time_limit_s: Time for the search.
        batches: Batches of states after which it ends; None for the time alone.
        seed: Of the draws.
        progress: Told the share of the time that has passed and a remark.

    Raises:
        InputError: Fewer than 8 cells.
    """
    if grid is None and cells < 8:
        raise InputError("cells", "8 or more", cells)
    begin = time.monotonic()
    checker = session.checker()
    generator = np.random.default_rng(seed)
    search = _ReachSearch(session, checker, grid or _volume(session, checker, cells, generator), generator)
    search.run(begin + time_limit_s, batches, progress)
    return search.confirmed(begin)


def scene_grid(session: PlanningSession, cells: int) -> Grid:
    """Returns a grid of about so many cells over the scene's meshes, whatever the robot."""
    bounds = [mesh.bounds for mesh in session.meshes]
    return Grid.of(np.min([low for low, _ in bounds], axis=0), np.max([high for _, high in bounds], axis=0), cells)


def _volume(session: PlanningSession, checker: ValidityChecker, cells: int, generator: np.random.Generator) -> Grid:
    """Returns a grid over all tips of shapes within the limits, as far as they lie in the box around the cavities."""
    shapes = checker.shapes(sample_within_tensions(checker, _FIRST, generator))
    tips = shapes.positions[shapes.codes == 0][:, -1]
    lower, upper = tips.min(axis=0), tips.max(axis=0)
    room = _WIDEN * (upper - lower)
    lower, upper = lower - room, upper + room
    cavities = [mesh.bounds for mesh in session.meshes if mesh.role == "cavity"]
    if cavities:
        low = np.maximum(lower, np.min([bounds[0] for bounds in cavities], axis=0))
        high = np.minimum(upper, np.max([bounds[1] for bounds in cavities], axis=0))
        if (low < high).all():
            lower, upper = low, high
    return Grid.of(lower, upper, cells)


class _ReachSearch:
    """A map in the making."""

    def __init__(
        self, session: PlanningSession, checker: ValidityChecker, grid: Grid, generator: np.random.Generator
    ) -> None:
        self._session, self._checker, self._grid = session, checker, grid
        self._generator = generator
        self._edges = EdgeChecker(checker, session.scenario.planner.step_m)
        bound = float(np.asarray(checker.model.error_bound)[-1])
        self._margin = min(bound, 0.2 * grid.size)
        dimension = checker.space.dimension
        self.rows: FloatArray = np.full((grid.cells, dimension), np.nan)
        self.attained: BoolArray = np.zeros(grid.cells, dtype=np.bool_)
        self.reached: BoolArray = np.zeros(grid.cells, dtype=np.bool_)
        self.blocked: IntArray = np.zeros(grid.cells, dtype=np.int64)
        self._tries: IntArray = np.zeros(grid.cells, dtype=np.int64)
        start = session.scenario.file.start
        self._start = session.space.row_of(start)
        self._builder = session.roadmap_builder(seed=int(generator.integers(1, 2**31 - 1)))
        self._tree_rows: FloatArray = (
            self._start[None] if checker.valid(self._start[None])[0] else self._start[None][:0]
        )
        self._joined: list[FloatArray] = []
        self._reach = _REACH * checker.robot.length

    def run(self, deadline: float, batches: int | None, progress: Progress | None) -> None:
        """Draws batches until a time by time.monotonic(), their number, or until nothing is gained for long."""
        begin, idle, roadmap_s, done = time.monotonic(), 0, 0.0, 0
        self._add(self._start[None])
        self._take_reached(self._tree_rows)
        while time.monotonic() < deadline and idle < _IDLE and (batches is None or done < batches):
            done += 1
            known = int(self.attained.sum()) + int(self.reached.sum())
            self._add(sample_within_tensions(self._checker, _BATCH, self._generator))
            self._add(self._grown())
            if len(self._tree_rows):
                spent = time.monotonic() - begin
                if roadmap_s <= _ROADMAP * spent:
                    roadmap_s += self._grow_roadmap(min(max(_ROADMAP * spent, _FIRST_S), deadline - time.monotonic()))
                self._join(deadline)
            idle = 0 if int(self.attained.sum()) + int(self.reached.sum()) > known else idle + 1
            if progress is not None:
                share = (time.monotonic() - begin) / max(deadline - begin, 1e-9)
                progress(min(share, 1.0), f"{int(self.reached.sum()):,} of {self._grid.cells:,} cells reached")

    def _add(self, rows: FloatArray) -> None:
        """Looks at configurations and notes which cells they attain, or what is in the way."""
        if not len(rows):
            return
        shapes = self._checker.shapes(rows)
        known = shapes.codes == 0
        self._checker.collide(shapes)
        self._checker.count(shapes.codes)
        tips = shapes.positions[:, -1]
        inner, cells = self._grid.find(tips, self._margin), self._grid.find(tips)
        free = np.flatnonzero((shapes.codes == 0) & (inner >= 0))
        fresh, first = np.unique(inner[free], return_index=True)
        new = ~self.attained[fresh]
        self.rows[fresh[new]] = rows[free[first[new]]]
        self.attained[fresh[new]] = True
        # A second state for a cell that no path is known to gives another chance of one.
        again = ~self.reached[fresh] & ~new & (self._tries[fresh] >= 1)
        self.rows[fresh[again]] = rows[free[first[again]]]
        hit = np.flatnonzero((shapes.codes != 0) & (cells >= 0))
        # A shape that collides says more of a cell than one that breaks a limit.
        order = np.argsort(known[hit], kind="stable")
        for index in hit[order]:
            self.blocked[cells[index]] = shapes.codes[index]

    def _grown(self) -> FloatArray:
        """Returns configurations around those whose cells lie beside cells that are not reached."""
        shape = self._grid.shape
        open_ = binary_dilation(~self.reached.reshape(shape), structure=_NEIGHBOURS).reshape(-1)
        edge = np.flatnonzero(self.attained & open_)
        if not len(edge):
            return np.empty((0, self.rows.shape[1]))
        chances = np.where(self.reached[edge], 1.0, 0.5)
        roots = edge[self._generator.choice(len(edge), size=_BATCH, p=chances / chances.sum())]
        size = self._reach * 2.0 ** self._generator.uniform(-_HALVINGS, 0.0, (_BATCH, 1))
        steps = size * self._generator.normal(size=(_BATCH, self.rows.shape[1])) / self._checker.motion_scale
        return np.clip(self.rows[roots] + steps, self._checker.space.lower, self._checker.space.upper)

    def _grow_roadmap(self, seconds: float) -> float:
        """Grows the roadmap, through whose narrow places single steps do not lead; returns the time that it took."""
        begin = time.monotonic()
        self._builder.run(time_limit_s=max(seconds, 1e-3))
        roadmap = self._builder.roadmap()
        first = int(np.flatnonzero((roadmap.rows == self._start).all(axis=1))[0])
        self._tree_rows = roadmap.rows[roadmap.components == roadmap.components[first]]
        self._take_reached(self._tree_rows)
        return time.monotonic() - begin

    def _take_reached(self, rows: FloatArray) -> None:
        """Notes the cells of valid states, shape (n, dimension), that the start reaches."""
        positions, _, known = self._checker.world_poses(rows)
        cells = self._grid.find(positions[:, -1], self._margin)
        free = np.flatnonzero(known & (cells >= 0))
        fresh, first = np.unique(cells[free], return_index=True)
        new = ~self.reached[fresh]
        self.rows[fresh[new]] = rows[free[first[new]]]
        self.attained[fresh[new]] = True
        self.reached[fresh[new]] = True

    def _join(self, deadline: float) -> None:
        """Tries to join states that no path is known to, the least tried first."""
        waiting = np.flatnonzero(self.attained & ~self.reached)
        if not len(waiting):
            return
        scale = self._checker.motion_scale
        tree_rows = np.concatenate([self._tree_rows, *(row[None] for row in self._joined)])
        distance, near = cKDTree(tree_rows * scale).query(self.rows[waiting] * scale, k=min(_TRIED, len(tree_rows)))
        distance, near = distance.reshape(len(waiting), -1), near.reshape(len(waiting), -1)
        order = np.lexsort([distance[:, 0], self._tries[waiting]])[:_LINKS]
        for place in order.tolist():
            if time.monotonic() >= deadline:
                return
            cell = waiting[place]
            self._tries[cell] += 1
            for other in near[place]:
                if self._edges.check_edge(tree_rows[other], self.rows[cell]):
                    self.reached[cell] = True
                    self._joined.append(self.rows[cell].copy())
                    break

    def confirmed(self, begin: float) -> ReachMap:
        """Returns the map after the reference has judged the state of every attained cell."""
        which = np.flatnonzero(self.attained)
        tips = np.full((self._grid.cells, 3), np.nan)
        refused = 0
        if len(which):
            good, states = self._session.verifier().judge_each(self.rows[which])
            good &= ~states.touches_itself & (self._grid.find(states.positions[:, -1]) == which)
            tips[which[good]] = states.positions[good, -1]
            refused = int((~good).sum())
            self.attained[which[~good]] = False
            self.reached[which[~good]] = False
            self.rows[which[~good]] = np.nan
        verdicts = np.full(self._grid.cells, int(Verdict.OUT_OF_REACH))
        limits = [Cause.STRAIN.code, Cause.TENDON_DISPLACEMENT.code, Cause.TENSION_LIMIT.code]
        verdicts[self.blocked > 0] = int(Verdict.COLLIDES)
        verdicts[np.isin(self.blocked, limits)] = int(Verdict.LIMIT)
        verdicts[self.attained] = int(Verdict.NO_PATH)
        verdicts[self.reached] = int(Verdict.REACHED)
        causes = [
            CAUSES[code - 1].value if verdict in (Verdict.COLLIDES, Verdict.LIMIT) else ""
            for code, verdict in zip(self.blocked.tolist(), verdicts.tolist(), strict=True)
        ]
        return ReachMap(
            grid=self._grid,
            verdicts=verdicts,
            causes=tuple(causes),
            rows=self.rows,
            tips=tips,
            states=self._checker.states_checked,
            confirmed=len(which),
            refused=refused,
            seconds=time.monotonic() - begin,
        )
