"""The errors of this package: one family, each carrying the values it speaks of."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class TdcrError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(TdcrError, ValueError):
    """An argument is not what the call needs.

    Attributes:
        name: The argument's name.
        expected: What would be valid.
        got: What came.
    """

    def __init__(self, name: str, expected: str, got: object) -> None:
        self.name = name
        self.expected = expected
        self.got = got
        super().__init__(f"{name}: expected {expected}, got {got}")


class UnknownNameError(InputError):
    """A name is none of those that the call knows."""

    def __init__(self, name: str, got: str, valid: Iterable[str], note: str = "") -> None:
        """Words the message around the nearest of the known names.

        Args:
            name: What is being named, such as "planner.name".
            got: The unknown name.
            valid: The known names.
            note: What there is to say about the unknown name, appended to it.
        """
        super().__init__(name, nearest_name(got, valid), f"{got!r}{note}")
        self.args = (f"{name}: got {self.got}; {self.expected}",)


class FormatError(TdcrError):
    """A file cannot be read as what it should be.

    Attributes:
        path: The file.
        place: The key, row or part inside the file; empty for the file as a whole.
        problem: What is wrong and what would be valid.
    """

    def __init__(self, path: str | Path, problem: str, place: str = "") -> None:
        self.path = Path(path)
        self.place = place
        self.problem = problem
        where = f"{path}: {place}" if place else f"{path}"
        super().__init__(f"{where}: {problem}")


class MissingLibraryError(TdcrError):
    """A library that is left out on some systems is needed.

    Attributes:
        library: Its name.
    """

    def __init__(self, library: str, purpose: str, systems: str) -> None:
        """Words the message.

        Args:
            library: The library's name.
            purpose: What it is needed for, as "to ...".
            systems: Where it runs.
        """
        self.library = library
        super().__init__(f"{library} is not installed and is needed {purpose}; it runs on {systems}: see README.md")


class RobotMismatchError(TdcrError):
    """A shape model was made for another robot.

    Attributes:
        model_robot: Name and hash of the model's robot.
        given_robot: Name and hash of the robot at hand.
    """

    def __init__(self, model_robot: str, given_robot: str, source: str = "shape model") -> None:
        self.model_robot = model_robot
        self.given_robot = given_robot
        super().__init__(
            f"{source}: made for robot {model_robot}, not for {given_robot}; "
            "train a model for this robot with `tdcr train` or use the robot it was made for"
        )


class DomainError(InputError):
    """A load or tension lies outside the domain that a shape model was trained on."""


class WorkersError(TdcrError):
    """Workers could not do what was asked: they are gone, or a job failed that the result cannot do without."""


def nearest_name(name: str, valid: Iterable[str]) -> str:
    """Returns a hint naming the valid name nearest to a misspelt one, and all valid names; case does not count.

    Args:
        name: The unknown name.
        valid: The names that are known.

    Returns:
        For example ``did you mean 'radius_m'? valid: length_m, radius_m``.
    """
    names = sorted(valid)
    by_folded = {known.casefold(): known for known in names}
    close = difflib.get_close_matches(name.casefold(), by_folded, n=1, cutoff=0.4)
    hint = f"did you mean '{by_folded[close[0]]}'? " if close else ""
    return f"{hint}valid: {', '.join(names)}"
