"""Rooms of PointIt that a build may leave out, their plug-ins, and the error message if one is absent."""

import importlib
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from types import ModuleType
from typing import TypeAlias, TypeVar

from pointit.runtime.errors import ConfigError

T = TypeVar("T")

Part: TypeAlias = tuple[Sequence[str], Callable[[], T]]
"""Rooms that must be there, and what imports and returns the part."""


def present(parts: Iterable[Part[T]]) -> list[T]:
    """Return those of `parts` whose rooms are there, in their order; imports no others."""
    return [load() for rooms, load in parts if all(map(is_there, rooms))]


def is_there(room: str) -> bool:
    """Return True if the module or package `room` is part of this build; does not import it."""
    try:
        return find_spec(room) is not None
    except ModuleNotFoundError:  # nor is what it stands in
        return False


def import_room(module: str, what: str) -> ModuleType:
    """Return `module`, imported for `what`.

    Raises:
        ConfigError: If it, or what it stands in, is not part of this build.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if not f"{module}.".startswith(f"{error.name}."):
            raise
        raise ConfigError(f"{what} is not part of this build of PointIt: there is no {error.name}") from error
