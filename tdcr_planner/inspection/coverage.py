"""Coverage: what a verified path sees of each point, when, from how near and how steeply, or why it does not."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.inspection.camera import Camera
from tdcr_planner.inspection.causes import Unseen
from tdcr_planner.inspection.targets import Targets
from tdcr_planner.inspection.visibility import Visibility

_BATCH = 512


@dataclass(frozen=True, eq=False)
class Sight:
    """What a path's k states see of p points.

    Attributes:
        first: Index of the first state that sees each point, -1 for none, shape (p,).
        last: Index of the last state that sees it, -1 for none, shape (p,).
        looks: How many states see it, shape (p,).
        distance: Least distance from the camera, shape (p,), m; NaN where it is not seen.
        cosine: Largest cosine of the angle of incidence, shape (p,); NaN where it is not seen.
        pixel: Least length of the surface that one pixel covers, shape (p,), m; NaN where not seen or unknown.
    """

    first: IntArray
    last: IntArray
    looks: IntArray
    distance: FloatArray
    cosine: FloatArray
    pixel: FloatArray

    @property
    def seen(self) -> BoolArray:
        """Which points are seen, shape (p,)."""
        return self.first >= 0

    @property
    def incidence_deg(self) -> FloatArray:
        """Least angle of incidence, shape (p,), degrees; NaN where a point is not seen."""
        return np.asarray(np.rad2deg(np.arccos(np.clip(self.cosine, 0.0, 1.0))))


def look_along(visibility: Visibility, positions: FloatArray, rotations: FloatArray) -> Sight:
    """Returns what the states of a path see.

    Args:
        visibility: Camera, points and what hides them.
        positions: Disk centres of the states in order, shape (k, d, 3), m, world frame.
        rotations: world_from_disk, shape (k, d, 3, 3).
    """
    points = len(visibility.targets)
    first, last = np.full(points, -1), np.full(points, -1)
    looks = np.zeros(points, dtype=np.int64)
    distance, cosine, pixel = np.full(points, np.inf), np.full(points, -np.inf), np.full(points, np.inf)
    for begin in range(0, len(positions), _BATCH):
        part = slice(begin, begin + _BATCH)
        views = visibility.views(positions[part], rotations[part])
        some = views.seen.any(axis=0)
        new = some & (first < 0)
        first[new] = begin + views.seen.argmax(axis=0)[new]
        count = len(views.seen)
        last[some] = begin + count - 1 - views.seen[::-1].argmax(axis=0)[some]
        looks += views.seen.sum(axis=0)
        sizes = visibility.camera.pixel_size(views.distances, views.cosines)
        distance = np.fmin(distance, np.where(views.seen, views.distances, np.inf).min(axis=0))
        cosine = np.fmax(cosine, np.where(views.seen, views.cosines, -np.inf).max(axis=0))
        pixel = np.fmin(pixel, np.where(np.isfinite(sizes), sizes, np.inf).min(axis=0))
    none = first < 0
    distance[none], cosine[none] = np.nan, np.nan
    pixel[~np.isfinite(pixel)] = np.nan
    return Sight(first, last, looks, distance, cosine, pixel)


@dataclass(frozen=True, eq=False)
class Coverage:
    """What an inspection comes to.

    Attributes:
        targets: The points.
        camera: The camera.
        sight: What the path's states see of them.
        can_be_seen: Points that some state sees that the start reaches, shape (p,), as far as the search found.
        causes: Why each point cannot be seen; None where it can be.
        wanted: Share of the surfaces that was asked for, or None.
        of_visible: Share of what can be seen that was asked for where `wanted` is None.
        trace: History of the search: seconds, share of the surfaces seen, body motion in m, share that can be seen.
    """

    targets: Targets
    camera: Camera
    sight: Sight
    can_be_seen: BoolArray
    causes: tuple[Unseen | None, ...]
    wanted: float | None
    of_visible: float
    trace: tuple[tuple[float, float, float, float], ...] = field(default=())

    @property
    def of_all(self) -> float:
        """Share of the surfaces, by area, that is seen."""
        return self.targets.share(self.sight.seen)

    @property
    def visible(self) -> float:
        """Share of the surfaces, by area, that can be seen."""
        return self.targets.share(self.can_be_seen)

    @property
    def of_what_can_be_seen(self) -> float:
        """Share, by area, of what can be seen that is seen; 0 where nothing can be."""
        return self.of_all / self.visible if self.visible > 0.0 else 0.0

    @property
    def asked(self) -> float:
        """Share of the surfaces that is to be seen."""
        return self.of_visible * self.visible if self.wanted is None else self.wanted

    @property
    def reached(self) -> bool:
        """Whether the path sees as much as was asked for."""
        return self.visible > 0.0 and self.of_all >= self.asked - 1e-9

    @property
    def cause_shares(self) -> dict[str, float]:
        """Share of the surfaces, by area, that cannot be seen, for each cause."""
        shares: dict[str, float] = {}
        total = float(self.targets.areas.sum())
        for cause, area in zip(self.causes, self.targets.areas.tolist(), strict=True):
            if cause is not None:
                shares[cause.value] = shares.get(cause.value, 0.0) + area / total
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def states(self) -> list[str]:
        """Returns "seen", "could be seen" or "cannot be seen" for each point."""
        return [
            "seen" if seen else "could be seen" if can else "cannot be seen"
            for seen, can in zip(self.sight.seen, self.can_be_seen, strict=True)
        ]
