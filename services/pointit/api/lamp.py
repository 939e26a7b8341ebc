"""One lamp of a site."""

import re
from collections.abc import Callable
from typing import Generic, TypeVar

from pointit.api.requests import Ask, query_of
from pointit.schemas import SchemaError
from pointit.schemas.base import Rgb
from pointit.schemas.topics import SET_LAMP

D = TypeVar("D")
F = TypeVar("F")

HEX = re.compile(r"#[0-9a-fA-F]{6}")


def rgb_of(color: str | Rgb | None) -> Rgb | None:
    """Return red, green and blue of `color`, `#rrggbb` or the three numbers.

    Raises:
        SchemaError: If a text is no colour.
    """
    if not isinstance(color, str):
        return color
    if not HEX.fullmatch(color):
        raise SchemaError(f"{color!r} is no colour: write one like '#ff8800', or (255, 136, 0)")
    red, green, blue = bytes.fromhex(color[1:])
    return (red, green, blue)


class Lamp(Generic[D, F]):
    """One lamp: what it shows, and what it is to show.

    People who localize go first: while they use lamps, yours are dark, and then have your colour again.
    """

    def __init__(self, name: str, ask: Ask, colors: Callable[[str], F]) -> None:
        self.name = name
        self._ask = ask
        self._colors = colors

    def set(self, color: str | Rgb | None) -> D:
        """Show `color`, `#rrggbb` or (red, green, blue); None gives the lamp back to the site.

        Raises:
            RefusedError: If there is no such lamp.
            AccessDeniedError: If this identity may not ask for it.
        """
        done: D = self._ask(SET_LAMP, query_of(SET_LAMP, {"color": rgb_of(color)}), self.name)
        return done

    def colors(self) -> F:
        """Return an iterator over the `LampColor` it shows: the present one at once, then each change."""
        return self._colors(self.name)
