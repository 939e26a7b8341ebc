"""Single lamps: lit for people who localize, coloured by the angle to the ray, or the state of the site."""

import math
from collections import deque
from collections.abc import Collection

from pointit.geometry.colormap import colormap
from pointit.schemas import NS_PER_S, Cursor, Feedback
from pointit.schemas.base import Rgb
from pointit.services.led_driver.config import LedDriverConfig, StateLampConfig
from pointit.services.led_driver.picture.lamp_queue import LampQueue
from pointit.services.led_driver.picture.thing_lamps import ThingLamps

DARK: Rgb = (0, 0, 0)
TARGET: Rgb = (255, 255, 255)
"""Colour of a lamp that a person localizes by."""
PULSE_STEP_NS = NS_PER_S // 20
"""Time between two steps of a pulse, ns."""
FLASHES = 3
"""Limit of flashes in any second. A flash is two changes of brightness or of a colour, up and down (WCAG 2,
2.3.1)."""
CHANGE = 0.1
"""Share of full brightness below which a change does not count."""
_LUMINANCE = (0.2126, 0.7152, 0.0722)


class Lamps:
    """Colours of all lamps. Pure.

    While a person localizes, only lamps that they are to point at are lit, and the state lamp. Otherwise a
    lamp shows the state of its thing while that is hovered or selected, and else what it was set to.
    """

    def __init__(self, config: LedDriverConfig, things: ThingLamps) -> None:
        self._config = config.lamps
        self._things = things
        self._id = config.state_lamp
        self._state = _StateLamp(config.state)
        self._timeout_ns = int(config.cursor_timeout_s * NS_PER_S)
        self.queue = LampQueue(int(config.lamps.localization_timeout_s * NS_PER_S))
        self._cursors: dict[str, tuple[int, Cursor]] = {}
        self._set: dict[str, Rgb] = {}
        """Colours of lamps that were set."""
        self._near: set[str] = set()
        """Lamps that were ever near a ray, and are in the map."""
        self._guards: dict[str, FlashGuard] = {self._id: FlashGuard()} if self._id else {}
        """By lamp: all that were ever in a map or near a ray. Those without another colour are dark."""

    @property
    def follow_people(self) -> bool:
        """True if the colour of any lamp depends on cursors."""
        return bool(self._id or self._near)

    def set_lamps(self, ids: Collection[str]) -> None:
        """Set the `ids` of the lamps of a new map. Those that are gone are switched off."""
        self._near.intersection_update(ids)
        self._set = {lamp_id: color for lamp_id, color in self._set.items() if lamp_id in ids}
        self._guard(ids)

    def on_cursor(self, user: str, cursor: Cursor, now_ns: int) -> None:
        """Set `user`'s cursor."""
        self._cursors[user] = (now_ns, cursor)
        if cursor.lamps:
            new = [lamp.id for lamp in cursor.lamps if lamp.id not in self._near]
            self._near.update(new)
            self._guard(new)

    def set_color(self, lamp_id: str, color: Rgb | None) -> None:
        """Show `color` on a lamp. None: what it shows by itself.

        Raises:
            ValueError: If there is no such lamp, or it shows the state of the site.
        """
        if lamp_id == self._id:
            raise ValueError(f"lamp {lamp_id} shows the state of the site; choose another one")
        if lamp_id not in self._guards:
            known = sorted(self._guards.keys() - {self._id})
            raise ValueError(f"there is no lamp {lamp_id!r}; there are {', '.join(known) or 'none'}")
        if color is None:
            self._set.pop(lamp_id, None)
        else:
            self._set[lamp_id] = color

    def on_feedback(self, feedback: Feedback) -> None:
        """Flash the state lamp in the colour of a cue."""
        if feedback.color is not None and self._id:
            self._state.flash(feedback.color)

    def colors(self, now_ns: int) -> dict[str, Rgb]:
        """Return the colours of all lamps at `now_ns`."""
        self.queue.expire(now_ns)
        for user, (at_ns, _) in list(self._cursors.items()):
            if not 0 <= now_ns - at_ns < self._timeout_ns:
                del self._cursors[user]
        is_localizing = self.queue.is_in_use
        of_things = self._things.colors(now_ns) if self._things.lamps else {}
        wanted = dict.fromkeys(self._guards, DARK)
        if self._cursors and not is_localizing:
            wanted |= {lamp_id: self._by_angle(lamp_id) for lamp_id in self._near}
        if not is_localizing:
            wanted |= self._set | of_things
        if self._id:
            state = "localizing" if is_localizing else "pointing" if self._cursors else "idle"
            wanted[self._id] = self._state.color(state, now_ns)
        wanted |= dict.fromkeys(self.queue.service().targets & wanted.keys(), TARGET)
        return {lamp_id: self._guards[lamp_id].show(color, now_ns) for lamp_id, color in wanted.items()}

    def next_change_ns(self, now_ns: int) -> int | None:
        """Return the time at which colours change without new messages, or None."""
        times = [at + self._timeout_ns for at, _ in self._cursors.values()]
        times += self._things.ends_ns()
        times += [guard.free_ns for guard in self._guards.values() if guard.free_ns is not None]
        if (expiry_ns := self.queue.next_expiry_ns()) is not None:
            times.append(expiry_ns)
        if self._id:
            change_ns = self._state.next_change_ns(now_ns, pulses=self.queue.is_in_use)
            times += [] if change_ns is None else [change_ns]
        return min(times, default=None)

    def _guard(self, ids: Collection[str]) -> None:
        self._guards |= {lamp_id: FlashGuard() for lamp_id in ids if lamp_id not in self._guards}

    def _by_angle(self, lamp_id: str) -> Rgb:
        misses_rad = [
            lamp.miss_rad
            for _, cursor in self._cursors.values()
            for lamp in cursor.lamps
            if lamp.id == lamp_id
        ]
        share = min(misses_rad, default=math.inf) / math.radians(self._config.range_deg)
        return colormap(self._config.colormap).rgb(1.0 - min(share, 1.0))


class _StateLamp:
    """One lamp for the state of the site: dim when idle, with flashes for cues."""

    def __init__(self, config: StateLampConfig) -> None:
        self._config = config
        self._flash_ns = int(config.flash_s * NS_PER_S)
        self._colors = {"idle": config.idle_color, "pointing": config.pointing_color}
        self._waiting: Rgb | None = None
        self._flashing: tuple[int, Rgb] | None = None
        self._pulse_ns: int | None = None
        """Time at which the pulse began, ns."""

    def flash(self, color: Rgb) -> None:
        """Show `color` briefly, after the current flash. Of several, the newest is shown."""
        self._waiting = color

    def color(self, state: str, now_ns: int) -> Rgb:
        """Return the colour of the lamp in `state` at `now_ns`."""
        if self._waiting is not None and not self._busy(now_ns, 2 * self._flash_ns):
            self._flashing, self._waiting = (now_ns, self._waiting), None
        if self._flashing is not None and self._busy(now_ns, self._flash_ns):
            return self._flashing[1]
        if state != "localizing":
            self._pulse_ns = None
            return self._colors[state]
        if self._pulse_ns is None:
            self._pulse_ns = now_ns
        phase = (now_ns - self._pulse_ns) / NS_PER_S * self._config.pulse_hz
        level = 0.6 - 0.4 * math.cos(2.0 * math.pi * phase)
        red, green, blue = (round(value * level) for value in self._config.localizing_color)
        return (red, green, blue)

    def _busy(self, now_ns: int, for_ns: int) -> bool:
        return self._flashing is not None and 0 <= now_ns - self._flashing[0] < for_ns

    def next_change_ns(self, now_ns: int, *, pulses: bool) -> int | None:
        """Return the time at which its colour changes by itself."""
        if pulses:
            return now_ns + PULSE_STEP_NS
        if self._flashing is not None and self._busy(now_ns, self._flash_ns):
            return self._flashing[0] + self._flash_ns
        if self._waiting is not None:
            return now_ns if self._flashing is None else max(now_ns, self._flashing[0] + 2 * self._flash_ns)
        return None


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
        values.append(math.fsum(weight * value for weight, value in zip(_LUMINANCE, values, strict=True)))
        waits_ns = [
            signal.wait_ns(value, now_ns) for signal, value in zip(self._signals, values, strict=True)
        ]
        if any(waits_ns):
            self.free_ns = now_ns + max(waits_ns)
            return self.shown
        for signal, value in zip(self._signals, values, strict=True):
            signal.take(value, now_ns)
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

    def _turns(self, value: float) -> bool:
        return abs(value - self._extreme) >= CHANGE and (value > self._extreme) != self._rising

    def wait_ns(self, value: float, now_ns: int) -> int:
        """Return the time until `value` may be shown, ns."""
        if not self._turns(value) or len(self._turns_ns) < (self._turns_ns.maxlen or 0):
            return 0
        return max(self._turns_ns[0] + NS_PER_S - now_ns, 0)

    def take(self, value: float, now_ns: int) -> None:
        """Record a `value` that is shown."""
        if self._turns(value):
            self._rising = not self._rising
            self._turns_ns.append(now_ns)
            self._extreme = value
        elif (value > self._extreme) == self._rising:
            self._extreme = value
