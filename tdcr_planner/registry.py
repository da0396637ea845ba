"""Registries: kinds of things found by the name that files use, this package's and those of installed packages."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from tdcr_planner.errors import InputError, UnknownNameError

Kind = TypeVar("Kind")

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Source:
    """Where a kind comes from: "module:attribute", and the package that registers it; empty for this one's own."""

    target: str
    package: str = ""


class Registry(Generic[Kind]):
    """The kinds of one thing, such as shape models, by name; each is imported when it is first used.

    A package adds a kind by an entry point of the registry's group, whose name is the kind's name in files and whose
    value is "module:attribute". An entry point with a name that is taken is left out, with a warning once. One that
    cannot be imported is an error where its name is asked for, and is left out with a warning where all are.
    """

    def __init__(
        self,
        what: str,
        *,
        built_in: Mapping[str, str],
        check: Callable[[str, Any], Kind],
        group: str | None = None,
    ) -> None:
        """Prepares the registry; nothing is imported.

        Args:
            what: What the kinds are, such as "shape model".
            built_in: This package's own kinds: name to "module:attribute".
            check: Called with name and object; returns the kind, or raises InputError where it is none.
            group: Group of the entry points that add kinds; None for a registry that has only its own.
        """
        self.what = what
        self.group = group
        self._built_in = {name: _Source(target) for name, target in built_in.items()}
        self._check = check
        self._loaded: dict[_Source, Kind] = {}
        self._sources: dict[tuple[str, ...], dict[str, _Source]] = {}
        self._warned: set[str] = set()

    def names(self) -> tuple[str, ...]:
        """Returns the names of all kinds, this package's own first, without importing any."""
        return tuple(self._all_sources())

    def check_name(self, name: str, place: str | None = None) -> str:
        """Returns a name that is registered, without importing its kind.

        Args:
            name: The name.
            place: What the message calls it, such as "planner.validity"; None for what the registry holds.

        Raises:
            UnknownNameError: There is no such kind.
        """
        # This package's own names need no look at what is installed.
        if name not in self._built_in and name not in self._all_sources():
            raise UnknownNameError(place or self.what, name, self.names())
        return name

    def find(self, name: str) -> Kind:
        """Returns the kind of a name.

        Raises:
            InputError: There is no such kind, or the package that registers it cannot be used.
        """
        self.check_name(name)
        return self._load(name, self._built_in.get(name) or self._all_sources()[name])

    def usable(self) -> Iterator[tuple[str, Kind]]:
        """Yields name and kind of all that can be imported; warns of the others, once."""
        for name, source in self._all_sources().items():
            try:
                yield name, self._load(name, source)
            except InputError as error:
                self._warn(str(error))

    def _load(self, name: str, source: _Source) -> Kind:
        if source not in self._loaded:
            self._loaded[source] = self._check(name, self._import(name, source))
        return self._loaded[source]

    def _import(self, name: str, source: _Source) -> Any:
        module, _, attributes = source.target.partition(":")
        try:
            found = import_module(module)
            for attribute in filter(None, attributes.split(".")):
                found = getattr(found, attribute)
        except (Exception, SystemExit) as error:  # a module is a program: it may raise anything
            if not source.package:
                raise
            raise InputError(
                f"{self.what} {name!r}",
                f"package {source.package} to provide it as {source.target}",
                f"{type(error).__name__}: {error}",
            ) from error
        return found

    def _all_sources(self) -> dict[str, _Source]:
        path = tuple(sys.path)
        if path not in self._sources:
            self._sources[path] = {**self._built_in}
            if self.group is not None:
                for point in sorted(entry_points(group=self.group), key=lambda item: (item.name, _package(item))):
                    self._add(self._sources[path], point)
        return self._sources[path]

    def _add(self, sources: dict[str, _Source], point: EntryPoint) -> None:
        source = _Source(point.value, _package(point))
        known = sources.setdefault(point.name, source)
        if known != source:
            owner = f"package {known.package}" if known.package else "tdcr_planner"
            self._warn(
                f"package {source.package} registers a {self.what} {point.name!r}, a name that {owner} has: left out"
            )

    def _warn(self, message: str) -> None:
        if message not in self._warned:
            self._warned.add(message)
            logger.warning("%s", message)


def _package(point: EntryPoint) -> str:
    return "of unknown name" if point.dist is None else point.dist.name
