"""All that shines: what was heard in, frames of the strips and colours of the lamps out."""

from collections.abc import Sequence

import numpy as np

from pointit.schemas import (
    Cursor,
    Environment,
    Feedback,
    Hover,
    Localization,
    Selection,
    StripFrame,
    StripsFrame,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas.base import Rgb
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.picture.lamps import Lamps
from pointit.services.led_driver.picture.layout import Layout
from pointit.services.led_driver.picture.render import Bytes, Renderer
from pointit.services.led_driver.picture.scene import Scene


class LightState:
    """Strips and lamps of one map; pure: the time comes with every call, nothing is drawn unasked."""

    def __init__(self, config: LedDriverConfig) -> None:
        """Begin without a map: nothing to draw on."""
        self._config = config
        self._scene = Scene(config)
        self._lamps = Lamps(config)
        self._layout: Layout | None = None
        self._renderer: Renderer | None = None
        self._seq = 0
        self.brightness = config.brightness
        """Brightness of all strips but those in `_own_dimming`, 0 to 1."""
        self._dimming = _table(config.brightness)
        self._own_dimming: dict[str, Bytes] = {}

    def set_brightness(self, brightness: float, strips: Sequence[str] = ()) -> None:
        """Dim `strips`, or (empty) all of them, to `brightness`, 0 to 1.

        Raises:
            ValueError: There is no such strip; its text lists those there are.
        """
        known = () if self._layout is None else tuple(self._layout.slices)
        missing = [name for name in strips if name not in known]
        if missing:
            raise ValueError(f"there is no strip {missing[0]!r}; there are {', '.join(known) or 'none'}")
        if strips:
            self._own_dimming.update(dict.fromkeys(strips, _table(brightness)))
        else:
            self.brightness = brightness
            self._dimming = _table(brightness)
            self._own_dimming.clear()

    def on_map(self, environment: Environment) -> None:
        """Lay the strips out anew.

        Raises:
            ValueError: a line has no length, or there are more pixels than a frame can hold; the map
                before stays.
        """
        layout = Layout(environment.strips, environment.belts)
        self._renderer = Renderer(layout, self._config.style)
        self._layout = layout
        self._own_dimming = {
            name: table for name, table in self._own_dimming.items() if name in layout.slices
        }
        self._scene.set_layout(layout)
        self._lamps.set_lamps({lamp.id for lamp in environment.lamps})

    def on_profile(self, user: str, profile: UserProfile) -> None:
        """Take `user`'s colour, pattern and cursor.

        Raises:
            UnknownColormapError: the profile names a colormap that there is none of; its colour is used.
        """
        self._scene.set_profile(user, profile)

    def on_cursor(self, user: str, cursor: Cursor, now_ns: int) -> bool:
        """Take where `user` points; return whether the strips change by it."""
        self._lamps.on_cursor(user, cursor, now_ns)
        return self._scene.set_cursor(user, cursor, now_ns)

    def on_hover(self, user: str, hover: Hover, now_ns: int) -> None:
        """Take what `user`'s cursor is on."""
        self._scene.set_hover(user, hover, now_ns)

    def on_objects(self, tracker: str, objects: TrackedObjects, now_ns: int) -> None:
        """Take all objects of `tracker`."""
        self._scene.set_objects(tracker, objects, now_ns)

    def on_selection(self, selection: Selection) -> None:
        """Take what is selected and reserved."""
        self._scene.set_selection(selection)

    def on_localization(self, user: str, localization: Localization) -> None:
        """Take how `user`'s localization goes: it needs the lamps."""
        self._lamps.on_localization(user, localization)

    def on_feedback(self, feedback: Feedback) -> None:
        """Take a cue, whoever it is for: the state lamp flashes in its colour."""
        self._lamps.on_feedback(feedback)

    def frame(self, now_ns: int, light_s: float = 0.0) -> StripsFrame | None:
        """Return the strips as they are to be seen at `now_ns`, `light_s` later, or None without a map."""
        if self._renderer is None or self._layout is None:
            return None
        self._scene.forget(now_ns)
        pixels = self._renderer.render(self._scene.segments(now_ns), self._scene.cursors(now_ns))
        data = self._dimmed(pixels.ravel(), self._layout).tobytes()
        new_ns = self._scene.pop_newest_capture_ns()
        self._seq += 1
        return StripsFrame(
            stamp_ns=now_ns if new_ns is None else new_ns,
            seq=self._seq,
            strips=(*[StripFrame(id=name, rgb=data[where]) for name, where in self._layout.slices.items()],),
            light_s=light_s,
        )

    def _dimmed(self, shades: Bytes, layout: Layout) -> Bytes:
        """Return `shades`, 0 to 255, scaled by the brightness of their strips."""
        if self.brightness == 1.0 and not self._own_dimming:
            return shades
        dimmed = self._dimming.take(shades)
        for name, table in self._own_dimming.items():
            where = layout.slices[name]
            dimmed[where] = table.take(shades[where])
        return dimmed

    def next_change_ns(self) -> int | None:
        """Return when the strips change although nothing more is heard: something is too old, or blinks."""
        return self._scene.next_change_ns()

    @property
    def has_lamps(self) -> bool:
        """Whether there is any lamp that it has a say in."""
        return self._lamps.any

    def lamp_colors(self, now_ns: int) -> dict[str, Rgb]:
        """Return the colours at `now_ns` of the lamps that it has a say in then; others are left alone."""
        return self._lamps.colors(now_ns)

    def next_lamp_change_ns(self, now_ns: int) -> int | None:
        """Return when lamps change although nothing more is heard."""
        return self._lamps.next_change_ns(now_ns)


def _table(brightness: float) -> Bytes:
    """Return every shade from 0 to 255 at `brightness`, 0 to 1."""
    return np.asarray(np.rint(np.arange(256) * brightness), dtype=np.uint8)
