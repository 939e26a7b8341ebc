"""State of all lights: messages in, frames of the strips and colours of the lamps out."""

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
from pointit.services.led_driver.picture.lamp_queue import LampService
from pointit.services.led_driver.picture.lamps import Lamps
from pointit.services.led_driver.picture.layout import Layout
from pointit.services.led_driver.picture.render import Bytes, Renderer
from pointit.services.led_driver.picture.strip_content import StripContent


class LightState:
    """Strips and lamps of one map. Pure: calls pass the time, and nothing is drawn unless requested."""

    def __init__(self, config: LedDriverConfig) -> None:
        """Create without a map."""
        self._config = config
        self._scene = StripContent(config)
        self._lamps = Lamps(config)
        self._renderer: Renderer | None = None
        self._strips: dict[str, StripFrame] = {}
        """Strips of the last frame. One that does not change is the same object in the next."""
        self._seq = 0
        self.brightness = config.brightness
        """Brightness of all strips except those in `_own_dimming`, 0 to 1."""
        self._dimming = _table(config.brightness)
        self._own_dimming: dict[str, Bytes] = {}

    def set_brightness(self, brightness: float, strips: Sequence[str] = ()) -> None:
        """Dim `strips`, or all of them if empty, to `brightness`, 0 to 1.

        Raises:
            ValueError: If there is no such strip. The message lists the existing ones.
        """
        known = () if self._renderer is None else tuple(self._renderer.layout.slices)
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
        """Rebuild the layout of the strips.

        Raises:
            ValueError: If a line has no length, or there are more pixels than a frame can hold. The last map
                stays.
        """
        layout = Layout(environment.strips, environment.belts)
        self._renderer = Renderer(layout, self._config.style)
        self._strips.clear()
        self._own_dimming = {
            name: table for name, table in self._own_dimming.items() if name in layout.slices
        }
        self._scene.set_layout(layout)
        self._lamps.set_lamps(dict.fromkeys(lamp.id for lamp in environment.lamps))

    def on_profile(self, user: str, profile: UserProfile) -> None:
        """Set `user`'s colour, pattern and cursor.

        Raises:
            UnknownColormapError: If the profile names an unknown colormap. The profile's colour is used.
        """
        self._scene.set_profile(user, profile)

    def on_cursor(self, user: str, cursor: Cursor, now_ns: int) -> bool:
        """Set `user`'s cursor. Return True if the strips change."""
        self._lamps.on_cursor(user, cursor, now_ns)
        return self._scene.set_cursor(user, cursor, now_ns)

    def cursor_color(self, user: str) -> Rgb:
        """Return the colour of `user`'s cursor, or of their profile without one."""
        return self._scene.cursor_color(user)

    @property
    def people_with_cursors(self) -> frozenset[str]:
        """People whose cursor had not expired when the last frame was drawn."""
        return self._scene.people_with_cursors

    def on_hover(self, user: str, hover: Hover, now_ns: int) -> None:
        """Set `user`'s hovered object."""
        self._scene.set_hover(user, hover, now_ns)

    def on_objects(self, tracker: str, objects: TrackedObjects, now_ns: int) -> None:
        """Set all objects of `tracker`."""
        self._scene.set_objects(tracker, objects, now_ns)

    def on_selection(self, selection: Selection) -> None:
        """Set what is selected and reserved."""
        self._scene.set_selection(selection)

    def on_localization(self, user: str, localization: Localization, now_ns: int) -> None:
        """Set the state of `user`'s localization, which may need lamps."""
        self._lamps.queue.on_localization(user, localization, now_ns)

    def on_absence(self, user: str) -> None:
        """Free the lamps of `user`, who or whose localizer has left."""
        self._lamps.queue.leave(user)

    def on_feedback(self, feedback: Feedback) -> None:
        """Flash the state lamp in the colour of any person's cue."""
        self._lamps.on_feedback(feedback)

    def frame(self, now_ns: int, light_s: float = 0.0) -> StripsFrame | None:
        """Return the strips for `now_ns`, to be seen `light_s` later, or None without a map."""
        if self._renderer is None:
            return None
        self._scene.forget(now_ns)
        layout = self._renderer.layout
        pixels = self._renderer.render(self._scene.segments(now_ns), self._scene.cursors(now_ns))
        data = self._dimmed(pixels.ravel(), layout).tobytes()
        new_ns = self._scene.pop_newest_capture_ns()
        self._seq += 1
        return StripsFrame(
            stamp_ns=now_ns if new_ns is None else new_ns,
            seq=self._seq,
            strips=(*[self._strip(name, data[where]) for name, where in layout.slices.items()],),
            light_s=light_s,
        )

    def _strip(self, name: str, rgb: bytes) -> StripFrame:
        strip = self._strips.get(name)
        if strip is None or strip.rgb != rgb:
            strip = self._strips[name] = StripFrame(id=name, rgb=rgb)
        return strip

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
        """Return the time of the next change without new messages: something expires or blinks."""
        return self._scene.next_change_ns()

    @property
    def lamps_follow_people(self) -> bool:
        """True if the colour of any lamp depends on cursors and cues."""
        return self._lamps.follow_people

    def lamp_colors(self, now_ns: int) -> dict[str, Rgb]:
        """Return the colours of all lamps at `now_ns`."""
        return self._lamps.colors(now_ns)

    def set_lamp(self, lamp_id: str, color: Rgb | None) -> None:
        """Show `color` on a lamp. None: what it shows by itself.

        Raises:
            ValueError: If there is no such lamp, or it shows the state of the site.
        """
        self._lamps.set_color(lamp_id, color)

    def lamp_service(self) -> LampService:
        """Return the people who use lamps to localize or wait for them, and the lamps lit for them."""
        return self._lamps.queue.service()

    def next_lamp_change_ns(self, now_ns: int) -> int | None:
        """Return the time of the next change of lamps without new messages."""
        return self._lamps.next_change_ns(now_ns)


def _table(brightness: float) -> Bytes:
    """Return a table of all shades from 0 to 255 at `brightness`, 0 to 1."""
    return np.asarray(np.rint(np.arange(256) * brightness), dtype=np.uint8)
