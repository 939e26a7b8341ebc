"""Lamps of things: the colour of the person who points at a thing, and of the one who has selected it."""

from collections.abc import Callable
from typing import Literal, NamedTuple

from pointit.schemas import Environment, Hover, Selection
from pointit.schemas.base import Rgb

HOVERED = 0.3
"""Brightness of a thing's lamp when a person begins to point at it, relative to their colour. It grows to 1
with the progress of the selection."""
STEP = 0.05
"""Change of brightness below which a lamp is left as it is."""

Change = Literal["none", "level", "lamps"]
"""Effect of a hover: nothing is shown differently, a lamp is brighter or darker, or other lamps are lit."""


class _Hovered(NamedTuple):
    """The lamp of the thing at which a person points, and its brightness as last shown."""

    received_ns: int
    lamp: str
    level: float


class ThingLamps:
    """Colours of the lamps of things that are hovered or selected. Pure."""

    def __init__(self, color_of: Callable[[str], Rgb], timeout_ns: int) -> None:
        """Create without things. `color_of`: a person's colour. `timeout_ns`: age of an ended hover."""
        self._color_of = color_of
        self._timeout_ns = timeout_ns
        self.lamps: dict[str, str] = {}
        """Lamps of the map's things, by thing. While there are none, `on_hover` need not be called."""
        self._selection: Selection | None = None
        self._owners: dict[str, str] = {}
        """People who have selected a thing, by its lamp."""
        self._hovered: dict[str, _Hovered] = {}
        """By user."""

    def set_map(self, environment: Environment) -> None:
        """Set the things, of which those count whose lamp is in the map. Hovers are forgotten."""
        known = {lamp.id for lamp in environment.lamps}
        self.lamps = {thing.id: thing.lamp for thing in environment.things if thing.lamp in known}
        self._hovered.clear()
        self._find_owners()

    def set_selection(self, selection: Selection) -> bool:
        """Set the selection. Return True if a lamp changes."""
        self._selection = selection
        return self._find_owners()

    def _find_owners(self) -> bool:
        before, self._owners = self._owners, {}
        if self.lamps and self._selection is not None:
            selected = self._selection.objects
            self._owners = {self.lamps[item.id]: item.user for item in selected if item.id in self.lamps}
        return self._owners != before

    def on_hover(self, user: str, hover: Hover, now_ns: int) -> Change:
        """Set `user`'s hovered object. Return its effect."""
        before = self._hovered.get(user)
        lamp = self.lamps.get(hover.object_id)
        if lamp is None:
            self._hovered.pop(user, None)
            return "none" if before is None else "lamps"
        level = HOVERED + (1.0 - HOVERED) * (0.0 if hover.action == "refuse" else hover.progress)
        if before is None or before.lamp != lamp:
            self._hovered[user] = _Hovered(now_ns, lamp, level)
            return "lamps"
        changes = abs(level - before.level) >= STEP
        self._hovered[user] = _Hovered(now_ns, lamp, level if changes else before.level)
        return "level" if changes else "none"

    def colors(self, now_ns: int) -> dict[str, Rgb]:
        """Return the colours of the lamps of hovered and selected things. Ended hovers are dropped.

        A selected thing has its owner's colour. Among people who point at one, the greatest progress counts.
        """
        for user, hovered in list(self._hovered.items()):
            if not 0 <= now_ns - hovered.received_ns < self._timeout_ns:
                del self._hovered[user]
        nearest: dict[str, tuple[float, str]] = {}
        for user, (_, lamp, level) in self._hovered.items():
            if lamp not in nearest or level > nearest[lamp][0]:
                nearest[lamp] = (level, user)
        nearest |= {lamp: (1.0, user) for lamp, user in self._owners.items()}
        return {lamp: self._shade(user, level) for lamp, (level, user) in nearest.items()}

    def reason(self, lamp: str) -> str:
        """Return the reason for the colour of a lamp that is in `colors`."""
        thing = next(thing for thing, its_lamp in self.lamps.items() if its_lamp == lamp)
        if lamp in self._owners:
            return f"{self._owners[lamp]} has selected {thing}"
        users = sorted(user for user, hovered in self._hovered.items() if hovered.lamp == lamp)
        return f"{' and '.join(users)} {'points' if len(users) == 1 else 'point'} at {thing}"

    def _shade(self, user: str, level: float) -> Rgb:
        red, green, blue = (round(value * level) for value in self._color_of(user))
        return (red, green, blue)

    def ends_ns(self) -> list[int]:
        """Return the times at which hovers end without new ones."""
        return [hovered.received_ns + self._timeout_ns for hovered in self._hovered.values()]
