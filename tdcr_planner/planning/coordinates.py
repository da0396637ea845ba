"""Drive coordinates: the numbers of a configuration that drive the tendons, and what they make each tendon do.

What they are follows from the robot: a bending vector a segment, of tension or of displacement, where the tendons of
every segment are straight and surround the backbone on one circle; a number a tendon elsewhere.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec

KEYS = {
    ("tension", True): "bending_n",
    ("displacement", True): "bending_m",
    ("tension", False): "tendon_n",
    ("displacement", False): "tendon_m",
}
"""Keys of a scenario's start and goal that state them, by the drive's kind and whether bending vectors exist."""


class DriveCoordinates(ABC):
    """Coordinates of the drive.

    Attributes:
        robot: The robot.
        key: The key of a scenario's start and goal that states them.
        width: How many there are.
        lower: Least value of each, shape (width,).
        upper: Largest, shape (width,).
        are_vectors: Whether they are a bending vector a segment, which turns with the roll.
    """

    robot: RobotSpec
    key: str
    width: int
    lower: FloatArray
    upper: FloatArray
    are_vectors: bool

    @abstractmethod
    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Returns random coordinates (count, width), uniform among those within the drive's limits."""

    @abstractmethod
    def driven(self, values: FloatArray) -> FloatArray:
        """Returns what the drive sets, shape (n, t): tensions, N, or displacements, m, of coordinates (n, width)."""

    @abstractmethod
    def confined(self, values: FloatArray) -> FloatArray:
        """Returns coordinates (n, width) within the bounds and, by shrinking bending vectors, the drive's limits."""

    def within(self, driven: FloatArray) -> FloatArray:
        """Returns the largest use of each row's limits, shape (n,): above 1 where one is broken."""
        low, high = drive_limits(self.robot)
        with np.errstate(divide="ignore", invalid="ignore"):
            used = np.where(driven > 0.0, driven / high, np.where(low < 0.0, driven / low, 0.0))
        return np.asarray(np.where(driven == 0.0, 0.0, used).max(axis=1))


def drive_limits(robot: RobotSpec) -> tuple[FloatArray, FloatArray]:
    """Returns the least and the largest value of what the drive sets, each of shape (t,), N or m."""
    if robot.drive.kind == "displacement":
        return robot.drive.max_displacement
    return np.zeros(robot.tendon_count), robot.max_tensions


def drive_coordinates(robot: RobotSpec) -> DriveCoordinates:
    """Returns the coordinates of a robot's drive.

    Raises:
        InputError: The robot states no limit on what its drive sets, so that there is no space to search.
    """
    if not np.isfinite(np.concatenate(drive_limits(robot))).all():
        key = "max_displacement_m in [drive]" if robot.drive.kind == "displacement" else "max_tension_n of each tendon"
        raise InputError(f"robot {robot.name!r}", f"{key}, the limits of the configuration space", "none")
    key = drive_key(robot)
    if key == "bending_n":
        return TensionVectors(robot)
    return DisplacementVectors(robot) if key == "bending_m" else SingleTendons(robot)


def drive_key(robot: RobotSpec) -> str:
    """Returns the key of a scenario's start and goal that states a robot's drive coordinates."""
    return KEYS[robot.drive.kind, has_bending_vectors(robot)]


def has_bending_vectors(robot: RobotSpec) -> bool:
    """Returns whether every segment's tendons are straight and surround the backbone on one circle."""
    try:
        return len(robot.segment_circles) > 0
    except InputError:
        return False


class TensionVectors(DriveCoordinates):
    """Bending vectors of tension, N, x and y a segment; the tensions of least sum, on top of the pretension."""

    are_vectors = True

    def __init__(self, robot: RobotSpec) -> None:
        """Prepares the coordinates of a robot."""
        self.robot, self.key, self.width = robot, "bending_n", 2 * robot.segment_count
        self._room = robot.max_tensions - robot.pretensions
        self.upper = np.repeat(self._bounds(), 2)
        self.lower = -self.upper

    def _bounds(self) -> FloatArray:
        """Returns the largest length of each segment's bending vector within the tension limits, N.

        The set of reachable bending vectors is a polygon whose corners are sums of neighbouring tendons at full
        tension, so one of the corners is the farthest point.
        """
        bounds = []
        for columns, _ in self.robot.segment_circles:
            angles = np.sort(np.mod(self.robot.tendon_angles[columns], 2.0 * np.pi))
            gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
            farthest = max(1.0, float((2.0 * np.cos(gaps / 2.0)).max()))
            bounds.append(float(self._room[columns].max()) * farthest)
        return np.array(bounds)

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Returns random bending vectors within the tension limits.

        A bending vector lies in the cone of one pair of neighbouring tendons and asks only them, so that the reachable
        vectors of a segment are a parallelogram a pair: one is chosen by its area, then a point of it.
        """
        values, room = np.empty((count, self.width)), self._room
        for index in range(self.robot.segment_count):
            columns = np.flatnonzero(self.robot.tendon_segments == index)
            angles = np.mod(self.robot.tendon_angles[columns], 2.0 * np.pi)
            order = np.argsort(angles, kind="stable")
            after = np.roll(order, -1)
            # Two tendons half a turn or more apart span no cone.
            areas = room[columns[order]] * room[columns[after]] * np.maximum(np.sin(angles[after] - angles[order]), 0.0)
            pair = generator.choice(len(order), count, p=areas / areas.sum())
            first, second = columns[order[pair]], columns[after[pair]]
            pulls = np.stack([room[first], room[second]], axis=1) * generator.uniform(size=(count, 2))
            directions = self.robot.tendon_angles[np.stack([first, second], axis=1)]
            values[:, 2 * index] = (pulls * np.cos(directions)).sum(axis=1)
            values[:, 2 * index + 1] = (pulls * np.sin(directions)).sum(axis=1)
        return values

    def driven(self, values: FloatArray) -> FloatArray:
        """Returns the tensions of bending vectors."""
        return self.robot.tensions_from_bending(values.reshape(len(values), -1, 2))

    def confined(self, values: FloatArray) -> FloatArray:
        """Returns bending vectors shrunk into the tension limits, each segment by itself."""
        values = np.clip(values, self.lower, self.upper)
        tensions = self.driven(values) - self.robot.pretensions
        for index in range(self.robot.segment_count):
            columns = self.robot.tendon_segments == index
            excess = (tensions[:, columns] / self._room[columns]).max(axis=1)
            values[:, 2 * index : 2 * index + 2] /= np.maximum(excess, 1.0)[:, None]
        return np.asarray(values)


class DisplacementVectors(DriveCoordinates):
    """Bending vectors of displacement, m at the tendon circle, x and y a segment; released tendons are negative.

    A drive could ask for far more than the tendons hold. Where tensions have limits, vectors are sampled as the
    displacements that vectors of tension within the limits come with, in linear bending: a vector of tension f on the
    circle of radius r_j takes r_k r_j (sum of L / B) f of a tendon at radius r_k, over the segments of length L and
    bending stiffness B that both pass, and what stretches adds.
    """

    are_vectors = True

    def __init__(self, robot: RobotSpec) -> None:
        """Prepares the coordinates of a robot."""
        self.robot, self.key, self.width = robot, "bending_m", 2 * robot.segment_count
        reach = np.array([self._farthest(index) for index in range(robot.segment_count)])
        self._tensions, self._compliance = None, self._linear_compliance()
        if np.isfinite(robot.max_tensions).all():
            self._tensions = TensionVectors(robot)
            reach = np.minimum(reach, self._compliance @ self._tensions.upper[::2])
        self._reach = reach
        self.upper = np.repeat(reach, 2)
        self.lower = -self.upper

    def _farthest(self, segment: int) -> float:
        """Returns a bound on the length of a segment's bending vector within the displacement limits, m.

        Two neighbouring tendons less than half a turn apart bound what lies between them.
        """
        low, high = self.robot.drive.max_displacement
        columns = self.robot.segment_circles[segment][0]
        angles = np.sort(np.mod(self.robot.tendon_angles[columns], 2.0 * np.pi))
        gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
        most = float(np.maximum(high, -low)[columns].max())
        return most / float(np.cos(gaps.max() / 2.0)) if gaps.max() < np.pi - 1e-6 else most

    def _linear_compliance(self) -> FloatArray:
        """Returns the displacement of each segment's vector for a newton of each, shape (segments, segments), m/N."""
        robot = self.robot
        stiffness = np.array([rod.stiffness_bending_torsion[0] for rod in robot.segment_backbones])
        bends = np.cumsum([part.length_m for part in robot.segments] / stiffness)
        radii = np.array([radius for _, radius in robot.segment_circles])
        index = np.arange(robot.segment_count)
        compliance = np.outer(radii, radii) * bends[np.minimum.outer(index, index)]
        for segment, (columns, _) in enumerate(robot.segment_circles):
            stretch = 1.0 / robot.drive.transmission_stiffness[columns]
            stretch = stretch + robot.segment_ends[segment] / robot.tendon_stiffnesses[columns]
            compliance[segment, segment] += float(stretch.max())
        return np.asarray(compliance)

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Returns random bending vectors within the displacement limits, and about within the tension limits."""
        if self._tensions is None:
            angle = generator.uniform(-np.pi, np.pi, (count, self.robot.segment_count))
            length = self._reach * np.sqrt(generator.uniform(size=angle.shape))
            vectors = np.stack([length * np.cos(angle), length * np.sin(angle)], axis=2)
        else:
            pulls = self._tensions.sample(count, generator).reshape(count, -1, 2)
            vectors = np.einsum("jk,nkc->njc", self._compliance, pulls)
        return self.confined(vectors.reshape(count, -1))

    def driven(self, values: FloatArray) -> FloatArray:
        """Returns the displacements of bending vectors, each tendon following the segment in which it ends."""
        return self.robot.displacements_from_bending(values.reshape(len(values), -1, 2))

    def confined(self, values: FloatArray) -> FloatArray:
        """Returns bending vectors shrunk into the displacement limits, each segment by itself."""
        values = np.clip(values, self.lower, self.upper)
        displacements = self.driven(values)
        for index in range(self.robot.segment_count):
            own = np.where(self.robot.tendon_segments == index, displacements, 0.0)
            values[:, 2 * index : 2 * index + 2] /= np.maximum(self.within(own), 1.0)[:, None]
        return np.asarray(values)


class SingleTendons(DriveCoordinates):
    """What the drive sets, a number a tendon: for routings without bending vectors."""

    are_vectors = False

    def __init__(self, robot: RobotSpec) -> None:
        """Prepares the coordinates of a robot."""
        self.robot, self.key, self.width = robot, KEYS[robot.drive.kind, False], robot.tendon_count
        self.lower, self.upper = drive_limits(robot)

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Returns random values between the limits."""
        return generator.uniform(self.lower, self.upper, (count, self.width))

    def driven(self, values: FloatArray) -> FloatArray:
        """Returns the values themselves."""
        return values.copy()

    def confined(self, values: FloatArray) -> FloatArray:
        """Returns values between the limits."""
        return np.clip(values, self.lower, self.upper)
