"""One lamp of a site."""

from collections.abc import Callable
from typing import Generic, TypeVar

from pointit.api.requests import LedsRequests
from pointit.schemas.base import Rgb

D = TypeVar("D")
F = TypeVar("F")


class Lamp(Generic[D, F]):
    """One lamp of the map: the colour it shows, and a colour for it.

    People who localize go first: while they use lamps, all others are dark, and then have their colour again.
    """

    def __init__(self, name: str, leds: LedsRequests[D], colors: Callable[[str], F]) -> None:
        self.name = name
        self._leds = leds
        self._colors = colors

    def set(self, color: str | Rgb | None) -> D:
        """Show `color`: `#rrggbb` or (red, green, blue). None gives the lamp back to the site.

        Raises:
            RefusedError: If there is no such lamp.
            AccessDeniedError: If this identity may not ask for it.
        """
        return self._leds.set_color(self.name, color)

    def colors(self) -> F:
        """Return an iterator over the `LampColor` it shows: the present one at once, then each change."""
        return self._colors(self.name)
