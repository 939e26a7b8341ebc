"""Entries of strips for a map, with names that it can have."""

from collections.abc import Callable, Container, Iterable, Sequence
from itertools import count

from pydantic import ValidationError

from pointit.maps.light_files.strip_fit import FittedStrip
from pointit.maps.model import StripEntry
from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError
from pointit.schemas.table_types import valid_name
from pointit.schemas.text import describe_mistake

Note = Callable[[str], object]
"""Receives a sentence on what differs from the file."""


def no_note(_: str) -> None:
    """Ignore a sentence."""


def named_strips(
    found: Iterable[tuple[str, int, FittedStrip]], names: Container[str], on_note: Note = no_note
) -> dict[str, StripEntry]:
    """Return entries of strips, given by name (`""`: none), number of the first pixel, and line."""
    strips: dict[str, StripEntry] = {}
    end = 0
    for name, first, each in found:
        plain = valid_name(name)
        is_free = name and name == plain and name not in strips
        key = name if is_free else free_name(plain or f"strip_{len(strips) + 1}", strips, names)
        if name != plain:
            on_note(f"strip {format_value(name)} is called {key}, a name that a map can have")
        line = [[round(float(value), 6) for value in vertex] for vertex in each.line]
        strips[key] = strip_entry(line, each.pixels, None if first == end else first)
        end = first + each.pixels
    return strips


def strip_entry(line: Sequence[Sequence[float]], pixels: int, offset: int | None = None) -> StripEntry:
    """Return a strip. Raises ConfigError if no map can have it."""
    try:
        return StripEntry.model_validate({"line": line, "pixels": pixels, "offset": offset})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"a strip of {pixels} pixels: {where}: {describe_mistake(first)}") from None


def free_name(name: str, *taken: Container[str]) -> str:
    """Return `name`, with a number if one of `taken` has it."""

    def is_free(key: str) -> bool:
        return not any(key in each for each in taken)

    return name if is_free(name) else next(filter(is_free, (f"{name[:60]}_{number}" for number in count(2))))
