"""Single lamps: lit for localization, coloured by the angle to the ray, or as their thing's state.

led-driver alone decides. Localizers state which lamps they use and which one is to be lit
(`Localization.lamps`, `target_id`), again every second, so that a restarted led-driver restores the queue.
"""

import math
from collections import deque
from collections.abc import Callable, Collection
from typing import Literal, NamedTuple

from pointit.geometry.colormap import colormap
from pointit.schemas import NS_PER_S, Cursor, Environment, Hover, LampLease, Localization, Selection
from pointit.schemas.base import Rgb
from pointit.schemas.expiring_dict import ExpiringDict
from pointit.schemas.text import all_of
from pointit.services.led_driver.config import LedDriverConfig

Change = Literal["none", "level", "lamps"]
"""Effect of a hover: nothing is shown differently, a lamp is brighter or darker, or other lamps are lit."""

MAX_LOCALIZATION_AGE_NS = 3 * NS_PER_S
"""Age after which a localization by lamps counts as ended, ns. Active ones are published once a second."""
MAX_PEOPLE = 64
"""Limit of people. Beyond it the one silent for longest is forgotten."""

HOVERED = 0.3
"""Brightness of a thing's lamp when a person begins to point at it, relative to their colour. It grows to 1
with the progress of the selection."""
BRIGHTNESS_STEP = 0.05
"""Change of brightness below which a lamp is left as it is."""
DARK: Rgb = (0, 0, 0)
TARGET: Rgb = (255, 255, 255)
"""Colour of a lamp that a person localizes by."""
FLASHES = 3
"""Limit of flashes in any second. A flash is two changes of brightness or of a colour, up and down (WCAG 2,
2.3.1)."""
LAMP_RANGE_RAD = math.radians(30.0)
"""Angle to a ray at which a lamp has the first colour of its colormap, rad."""
CHANGE = 0.1
"""Share of full brightness below which a change does not count."""
_LUMINANCE = (0.2126, 0.7152, 0.0722)


class LampService(NamedTuple):
    """Lamps as they are shared out."""

    leases: tuple[LampLease, ...] = ()
    """Lamps of each person, and the order of the waiting users."""
    targets: frozenset[str] | set[str] = frozenset()
    """Ids of the lamps to light."""


class LampQueue:
    """Localizations of all people, and the lamps that each may use. Pure."""

    def __init__(self, silence_ns: int) -> None:
        """Create without people. `silence_ns`: age after which a localization without lamps has ended."""
        self._silence_ns = silence_ns
        self.active = ExpiringDict[str, Localization](self._timeout_ns, max_keys=MAX_PEOPLE)
        """By user."""

    def on_localization(self, user: str, localization: Localization, now_ns: int) -> None:
        """Set the state of `user`'s localization."""
        if localization.phase == "sampling":
            self.active.put(user, localization, now_ns)
        else:
            self.active.discard(user)

    def leave(self, user: str) -> None:
        """Remove `user`, who or whose localizer has left."""
        self.active.discard(user)

    def expire(self, now_ns: int) -> None:
        """Remove localizations that have sent nothing for longer than the timeout."""
        self.active.expire(now_ns)

    @property
    def is_in_use(self) -> bool:
        """True if anybody localizes rather than waits."""
        return any(not localization.ahead for localization in self.active.values())

    def service(self) -> LampService:
        """Return the order of people, those who point before those who wait, and the lamps to light."""
        requests = [request for request in self.active.items() if request[1].lamps]

        # Each waits for those before them who use one of their lamps
        leases: list[LampLease] = []
        targets: set[str] = set()
        for user, localization in sorted(requests, key=_precedence):
            lamps = set(localization.lamps)
            ahead = tuple(lease.user for lease in leases if not lamps.isdisjoint(lease.lamps))
            lease = LampLease(
                user=user, since_ns=localization.since_ns, lamps=localization.lamps, ahead=ahead
            )
            leases.append(lease)
            is_served = not ahead and not localization.ahead
            if is_served and localization.target_id in lamps:
                targets.add(localization.target_id)
        return LampService(tuple(leases), targets)

    def _timeout_ns(self, localization: Localization) -> int:
        return MAX_LOCALIZATION_AGE_NS if localization.lamps else self._silence_ns


def _precedence(request: tuple[str, Localization]) -> tuple[bool, int, str]:
    """Return the sort key of a user's localization: those who point, then the earliest, then by name."""
    # those who point come first: clocks differ, so a later request may state an earlier time
    user, localization = request
    return (bool(localization.ahead), localization.since_ns, user)


class _Hovered(NamedTuple):
    """The lamp of the thing at which a person points, and its brightness as last shown."""

    lamp: str
    level: float


class ThingLamps:
    """Colours of the lamps of things that are hovered or selected. Pure."""

    def __init__(self, color_of: Callable[[str], Rgb], timeout_ns: int) -> None:
        """Create without things. `color_of`: a person's colour. `timeout_ns`: age of an ended hover."""
        self._color_of = color_of
        self.lamps: dict[str, str] = {}
        """Lamps of the map's things, by thing. While there are none, `on_hover` need not be called."""
        self._selection: Selection | None = None
        self._owners: dict[str, str] = {}
        """People who have selected a thing, by its lamp."""
        self.hovered = ExpiringDict[str, _Hovered](timeout_ns)
        """By user."""

    def set_map(self, environment: Environment) -> None:
        """Set the things, of which those count whose lamp is in the map. Hovers are forgotten."""
        lamp_ids = {lamp.id for lamp in environment.lamps}
        self.lamps = {thing.id: thing.lamp for thing in environment.things if thing.lamp in lamp_ids}
        self.hovered.clear()
        self._find_owners()

    def set_selection(self, selection: Selection) -> bool:
        """Set the selection. Return True if a lamp changes."""
        self._selection = selection
        return self._find_owners()

    def _find_owners(self) -> bool:
        previous = self._owners
        self._owners = {}
        if self.lamps and self._selection is not None:
            for item in self._selection.objects:
                lamp = self.lamps.get(item.id)
                if lamp is not None and not item.is_pending:
                    self._owners[lamp] = item.user
        return self._owners != previous

    def on_hover(self, user: str, hover: Hover, now_ns: int) -> Change:
        """Set `user`'s hovered object. Return its effect."""
        previous = self.hovered.get(user)
        lamp = self.lamps.get(hover.object_id)
        if lamp is None:
            self.hovered.discard(user)
            return "none" if previous is None else "lamps"
        progress = 0.0 if hover.action == "refuse" else hover.progress
        level = HOVERED + (1.0 - HOVERED) * progress
        if previous is None or previous.lamp != lamp:
            self.hovered.put(user, _Hovered(lamp, level), now_ns)
            return "lamps"

        # A level that is not shown is not stored, so that many small steps add up to a visible one
        if abs(level - previous.level) < BRIGHTNESS_STEP:
            self.hovered.put(user, _Hovered(lamp, previous.level), now_ns)
            return "none"
        self.hovered.put(user, _Hovered(lamp, level), now_ns)
        return "level"

    def colors(self, now_ns: int) -> dict[str, Rgb]:
        """Return the colours of the lamps of hovered and selected things. Ended hovers are dropped.

        A selected thing has its owner's colour. Among people who point at one, the greatest progress counts.
        """
        self.hovered.expire(now_ns)
        shown: dict[str, tuple[float, str]] = {}
        for user, (lamp, level) in self.hovered.items():
            if lamp not in shown or level > shown[lamp][0]:
                shown[lamp] = (level, user)
        for lamp, owner in self._owners.items():
            shown[lamp] = (1.0, owner)
        colors: dict[str, Rgb] = {}
        for lamp, (level, user) in shown.items():
            colors[lamp] = self._shade(user, level)
        return colors

    def reason(self, lamp: str) -> str:
        """Return the reason for the colour of a lamp that is in `colors`."""
        thing = next(thing for thing, thing_lamp in self.lamps.items() if thing_lamp == lamp)
        if lamp in self._owners:
            return f"{self._owners[lamp]} has selected {thing}"
        users = sorted(user for user, hovered in self.hovered.items() if hovered.lamp == lamp)
        verb = "points" if len(users) == 1 else "point"
        return f"{all_of(users)} {verb} at {thing}"

    def _shade(self, user: str, level: float) -> Rgb:
        red, green, blue = (round(value * level) for value in self._color_of(user))
        return (red, green, blue)


class Lamps:
    """Colours of all lamps. Pure.

    While a person localizes, only lamps that they are to point at are lit. Otherwise a lamp shows the state
    of its thing while that is hovered or selected, and else what it was set to.
    """

    def __init__(self, config: LedDriverConfig, things: ThingLamps) -> None:
        self._colormap = config.lamps.colormap
        self._things = things
        self.queue = LampQueue(int(config.lamps.localization_timeout_s * NS_PER_S))
        self._cursors = ExpiringDict[str, Cursor](int(config.cursor_timeout_s * NS_PER_S))
        self._set: dict[str, Rgb] = {}
        """Colours of lamps that were set."""
        self._ids: frozenset[str] = frozenset()
        """Lamps of the map. Others that a message names are ignored: they have no key, and no light."""
        self._near_lamps: set[str] = set()
        """Lamps that were ever near a ray, and are in the map."""
        self._guards: dict[str, FlashGuard] = {}
        """By lamp: all that were ever in a map. Those without another colour are dark."""

    @property
    def follow_people(self) -> bool:
        """True if the colour of any lamp depends on cursors."""
        return bool(self._near_lamps)

    def set_lamps(self, ids: Collection[str]) -> None:
        """Set the `ids` of the lamps of a new map. Those that are gone are switched off."""
        self._ids = frozenset(ids)
        self._near_lamps.intersection_update(ids)
        self._set = {lamp_id: color for lamp_id, color in self._set.items() if lamp_id in ids}
        self._add_guards(ids)

    def on_cursor(self, user: str, cursor: Cursor, now_ns: int) -> None:
        """Set `user`'s cursor."""
        self._cursors.put(user, cursor, now_ns)
        for lamp in cursor.lamps:
            if lamp.id in self._ids:
                self._near_lamps.add(lamp.id)

    def set_color(self, lamp_id: str, color: Rgb | None) -> None:
        """Show `color` on a lamp. None: what it shows by itself.

        Raises:
            ValueError: If there is no such lamp.
        """
        if lamp_id not in self._guards:
            lamp_ids = ", ".join(sorted(self._guards)) or "none"
            raise ValueError(f"there is no lamp {lamp_id!r}; there are {lamp_ids}")
        if color is None:
            self._set.pop(lamp_id, None)
        else:
            self._set[lamp_id] = color

    def colors(self, now_ns: int) -> dict[str, Rgb]:
        """Return the colours of all lamps at `now_ns`."""
        self.queue.expire(now_ns)
        self._cursors.expire(now_ns)
        of_things = self._things.colors(now_ns) if self._things.lamps else {}

        # While nobody localizes: by angle, unless set, unless the lamp shows the state of its thing
        colors = dict.fromkeys(self._guards, DARK)
        if not self.queue.is_in_use:
            if self._cursors:
                colors |= {lamp_id: self._color_by_angle(lamp_id) for lamp_id in self._near_lamps}
            colors |= self._set | of_things

        # Targets that the map has are lit, and no lamp flashes too often
        targets = self.queue.service().targets
        colors |= dict.fromkeys(targets & colors.keys(), TARGET)
        for lamp_id, color in colors.items():
            colors[lamp_id] = self._guards[lamp_id].show(color, now_ns)
        return colors

    def next_change_ns(self) -> int | None:
        """Return the time at which colours change without new messages, or None."""
        changes_ns = [guard.free_ns for guard in self._guards.values()]
        for expiring in (self._things.hovered, self._cursors, self.queue.active):
            changes_ns.append(expiring.next_expiry_ns())
        return min((change_ns for change_ns in changes_ns if change_ns is not None), default=None)

    def _add_guards(self, ids: Collection[str]) -> None:
        for lamp_id in ids:
            if lamp_id not in self._guards:
                self._guards[lamp_id] = FlashGuard()

    def _color_by_angle(self, lamp_id: str) -> Rgb:
        """Return the colour of a lamp by its angle to the nearest ray."""
        miss_rad = math.inf
        for cursor in self._cursors.values():
            for lamp in cursor.lamps:
                if lamp.id == lamp_id:
                    miss_rad = min(miss_rad, lamp.miss_rad)
        share = min(miss_rad / LAMP_RANGE_RAD, 1.0)
        return colormap(self._colormap).rgb(1.0 - share)


class FlashGuard:
    """Colours of one lamp, each held back until it may be shown.

    At most three flashes a second, whatever is commanded, since more can trigger seizures.
    """

    def __init__(self) -> None:
        self.shown: Rgb = (0, 0, 0)
        self._signals = [_Signal() for _ in range(4)]
        self.free_ns: int | None = None
        """Time at which the held-back colour may be shown, ns, or None if none is held back."""

    def show(self, color: Rgb, now_ns: int) -> Rgb:
        """Return the colour that the lamp may show at `now_ns`: `color`, or the one shown before."""
        values = [value / 255.0 for value in color]
        luminance = math.fsum(weight * value for weight, value in zip(_LUMINANCE, values, strict=True))
        values.append(luminance)

        # All channels change together or not at all: a mixture would be a colour that nobody has requested
        waits_ns: list[int] = []
        for signal, value in zip(self._signals, values, strict=True):
            waits_ns.append(signal.wait_ns(value, now_ns))
        if any(waits_ns):
            self.free_ns = now_ns + max(waits_ns)
            return self.shown
        for signal, value in zip(self._signals, values, strict=True):
            signal.record(value, now_ns)
        self.free_ns = None
        self.shown = color
        return color


class _Signal:
    """Ups and downs of one channel."""

    def __init__(self) -> None:
        self._rising = False
        self._extreme = 0.0
        """Extreme value since the last turn."""
        self._turns_ns: deque[int] = deque(maxlen=2 * FLASHES - 1)

    def _is_turn(self, value: float) -> bool:
        if abs(value - self._extreme) < CHANGE:
            return False
        is_higher = value > self._extreme
        return is_higher != self._rising

    def wait_ns(self, value: float, now_ns: int) -> int:
        """Return the time until `value` may be shown, ns."""
        max_turns = self._turns_ns.maxlen or 0
        if not self._is_turn(value):
            return 0
        if len(self._turns_ns) < max_turns:
            return 0
        return max(self._turns_ns[0] + NS_PER_S - now_ns, 0)

    def record(self, value: float, now_ns: int) -> None:
        """Record a `value` that is shown."""
        if self._is_turn(value):
            self._rising = not self._rising
            self._turns_ns.append(now_ns)
            self._extreme = value
            return
        is_higher = value > self._extreme
        if is_higher == self._rising:
            self._extreme = value
