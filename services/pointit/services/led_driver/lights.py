"""All that shines: what was heard in, frames of the strips and colours of the lamps out."""

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
from pointit.services.led_driver.lamps import Lamps
from pointit.services.led_driver.layout import Layout
from pointit.services.led_driver.render import Renderer
from pointit.services.led_driver.scene import Scene


class Lights:
    """Strips and lamps of one map; pure: the time comes with every call, nothing is drawn unasked."""

    def __init__(self, config: LedDriverConfig) -> None:
        """Begin without a map: nothing to draw on."""
        self._config = config
        self._scene = Scene(config)
        self._lamps = Lamps(config)
        self._layout: Layout | None = None
        self._renderer: Renderer | None = None
        self._seq = 0
        self._strips: dict[str, StripFrame] = {}
        """As last drawn: most strips are as they were, and a message of them need not be made anew."""
        self._dimmed = np.arange(256, dtype=np.uint8)
        self.set_brightness(config.brightness)

    def set_brightness(self, brightness: float) -> None:
        """Dim all strips to `brightness`, 0 to 1."""
        self.brightness = brightness
        self._dimmed = np.rint(np.arange(256) * brightness).astype(np.uint8)

    def on_map(self, environment: Environment) -> None:
        """Lay the strips out anew.

        Raises:
            ValueError: a line has no length, or there are more pixels than a frame can hold; the map
                before stays.
        """
        layout = Layout(environment.strips, environment.belts)
        self._renderer = Renderer(layout, self._config.style)
        self._layout = layout
        self._strips.clear()
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

    def frame(self, now_ns: int) -> StripsFrame | None:
        """Return the strips as they are to be seen at `now_ns`; none before there is a map."""
        if self._renderer is None or self._layout is None:
            return None
        self._scene.forget(now_ns)
        pixels = self._renderer.render(self._scene.segments(now_ns), self._scene.cursors())
        data = (pixels if self.brightness == 1.0 else self._dimmed[pixels]).tobytes()
        new_ns = self._scene.take_new_ns()
        self._seq += 1
        return StripsFrame(
            stamp_ns=now_ns if new_ns is None else new_ns,
            seq=self._seq,
            strips=tuple(StripFrame(id=name, rgb=data[where]) for name, where in self._layout.slices.items()),
        )

    def next_change_ns(self) -> int | None:
        """Return when the strips change although nothing more is heard: something grows too old."""
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
