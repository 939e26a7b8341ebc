"""Single lamps: coloured by the angle to the ray, and one that shows the state of the site.

Localizing uses the lamps itself: while a person localizes, all lamps but the state lamp are left alone,
and that one too while it is the target.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass

from pointit.geometry.colormap import colormap
from pointit.schemas import NS_PER_S, Cursor, Feedback, Localization
from pointit.schemas.base import Rgb
from pointit.services.led_driver.config import LedDriverConfig, StateLampConfig
from pointit.services.led_driver.picture.flash_guard import FlashGuard

DARK: Rgb = (0, 0, 0)

HANDOVER_NS = NS_PER_S // 5
"""Time for which lamps are left alone after a localization, ns. Its last command may still be in transit."""

PULSE_STEP_NS = NS_PER_S // 20
"""Time between two steps of a pulse, ns."""


@dataclass(slots=True)
class _Localizing:
    target_id: str
    heard_ns: int | None = None


class Lamps:
    """Colours of all lamps. Pure."""

    def __init__(self, config: LedDriverConfig) -> None:
        """Create without lamps except the state lamp."""
        self._config = config.lamps
        self._id = config.state_lamp
        self._state = _StateLamp(config.state)
        self._timeout_ns = int(config.cursor_timeout_s * NS_PER_S)
        self._silence_ns = int(config.lamps.localization_timeout_s * NS_PER_S)
        self._cursors: dict[str, tuple[int, Cursor]] = {}
        self._near: set[str] = set()
        """Lamps that were ever near a ray."""
        self._gone: set[str] = set()
        """Those of them that are no longer in the map."""
        self._localizing: dict[str, _Localizing] = {}
        self._localized_ns: int | None = None
        self._guards: dict[str, FlashGuard] = {}
        self._held_ns: list[int] = []
        """Times at which held-back colours may be shown, ns."""

    @property
    def any(self) -> bool:
        """True if there is a lamp under its control."""
        return bool(self._id or self._near)

    def set_lamps(self, ids: Collection[str]) -> None:
        """Set the `ids` of the lamps of a new map. Lit lamps that are gone are switched off."""
        self._gone = self._near.difference(ids)

    def on_cursor(self, user: str, cursor: Cursor, now_ns: int) -> None:
        """Set `user`'s cursor."""
        self._cursors[user] = (now_ns, cursor)
        if cursor.lamps:
            near = {lamp.id for lamp in cursor.lamps}
            self._near |= near
            self._gone -= near

    def on_localization(self, user: str, localization: Localization) -> None:
        """Set the state of `user`'s localization."""
        if localization.phase == "sampling" and not localization.ahead:
            self._localizing[user] = _Localizing(localization.target_id)
        else:
            self._localizing.pop(user, None)

    def on_feedback(self, feedback: Feedback) -> None:
        """Flash the state lamp in the colour of a cue."""
        if feedback.color is not None and self._id:
            self._state.flash(feedback.color)

    def colors(self, now_ns: int) -> dict[str, Rgb]:
        """Return the colours at `now_ns` of the lamps under its control."""
        self._forget(now_ns)
        wanted: dict[str, Rgb] = {}
        if self._localized_ns is None:
            wanted |= {lamp_id: self._by_angle(lamp_id) for lamp_id in sorted(self._near)}
        if self._id and all(each.target_id != self._id for each in self._localizing.values()):
            state = "localizing" if self._localizing else "pointing" if self._cursors else "idle"
            wanted[self._id] = self._state.color(state, now_ns)
        guards = {lamp_id: self._guards.setdefault(lamp_id, FlashGuard()) for lamp_id in wanted}
        shown = {lamp_id: guards[lamp_id].show(color, now_ns) for lamp_id, color in wanted.items()}
        self._held_ns = [guard.free_ns for guard in guards.values() if guard.free_ns is not None]
        return shown

    def next_change_ns(self, now_ns: int) -> int | None:
        """Return the time at which colours change without new messages, or None."""
        times = [at + self._timeout_ns for at, _ in self._cursors.values()]
        times += [each.heard_ns + self._silence_ns for each in self._localizing.values() if each.heard_ns]
        times += self._held_ns
        if self._localized_ns is not None and not self._localizing:
            times.append(self._localized_ns + HANDOVER_NS)
        if self._id:
            change_ns = self._state.next_change_ns(now_ns, pulses=bool(self._localizing))
            times += [] if change_ns is None else [change_ns]
        return min(times, default=None)

    def _by_angle(self, lamp_id: str) -> Rgb:
        """Return the colour for the nearest ray. Dark if there is none, or the map no longer has the lamp."""
        if not self._cursors or lamp_id in self._gone:
            return DARK
        misses_rad = [
            lamp.miss_rad
            for _, cursor in self._cursors.values()
            for lamp in cursor.lamps
            if lamp.id == lamp_id
        ]
        share = min(misses_rad, default=math.inf) / math.radians(self._config.range_deg)
        return colormap(self._config.colormap).rgb(1.0 - min(share, 1.0))

    def _forget(self, now_ns: int) -> None:
        """Drop expired cursors, and localizations that are silent for so long that they have crashed."""
        for user in [
            user for user, (at, _) in self._cursors.items() if not 0 <= now_ns - at < self._timeout_ns
        ]:
            del self._cursors[user]
        for user, each in list(self._localizing.items()):
            if each.heard_ns is None:
                each.heard_ns = now_ns
            if not 0 <= now_ns - each.heard_ns < self._silence_ns:
                del self._localizing[user]
        if self._localizing:
            self._localized_ns = now_ns
        elif self._localized_ns is not None and not 0 <= now_ns - self._localized_ns < HANDOVER_NS:
            self._localized_ns = None


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
