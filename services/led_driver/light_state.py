"""State of all lights: messages in, frames of strips and colours of lamps out when they are due."""

from collections.abc import Iterable, Sequence

import numpy as np

from pointit.schemas import NS_PER_S, Cursor, Environment, LitPixels, StripFrame, StripsFrame
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.lamps import Lamps, ThingLamps
from pointit.services.led_driver.render import Bytes, Layout, Renderer
from pointit.services.led_driver.strip_content import StripContent


class FrameLimiter:
    """Caps the rate of frames so that each shows the freshest cursor.

    A cursor is drawn when it arrives, unless the last frame is too recent. Then it waits, like all other
    changes, for the next cursor, for `timeout_s` at most. A timer at the period's end instead would show
    every cursor of a stream faster than the cap up to one of its periods late.
    """

    def __init__(self, max_rate_hz: float, timeout_s: float) -> None:
        self._period_s = 1.0 / max_rate_hz
        self._slack_s = self._period_s / 4.0
        """Time by which a frame may be early, so that a stream at exactly the cap tolerates jitter, s."""
        self._timeout_s = timeout_s
        self._next_s = float("-inf")
        self._due_s: float | None = None

    def request_frame(self, now_s: float, *, fresh: bool) -> float | None:
        """Return the time until drawing, s, 0 for now. None if a frame is already due.

        Args:
            now_s: time on any monotonic clock.
            fresh: True if a cursor came, False if anything else changed.
        """
        wait_s = self._next_s - now_s
        if fresh and wait_s <= self._slack_s:
            return 0.0
        if self._due_s is not None:
            return None
        wait_s = max(wait_s, self._timeout_s)
        if wait_s <= 0.0:
            return 0.0
        self._due_s = now_s + wait_s
        return wait_s

    def drawn(self, now_s: float) -> None:
        """Record that a frame was drawn."""
        self._next_s = max(self._next_s, now_s) + self._period_s
        self._due_s = None


class LightState:
    """What the strips and lamps of one map show now: cursors, objects, who hovers and who owns. Pure.

    Messages are put in as they come, with the time of their arrival, and `frame` draws all strips when
    somebody wants a frame. Nothing is drawn in between, so a hundred messages between two frames cost one
    drawing. What is not repeated fades: a cursor ends `cursor_timeout_s` after its last message.

    >>> from pointit.schemas import Environment, Strip
    >>> lights = LightState(LedDriverConfig())
    >>> lights.on_map(Environment(stamp_ns=0, name="room", strips=(
    ...     Strip(id="shelf", line_m=((0, 0, 1), (1, 0, 1)), pixels=3),)))
    >>> [strip.rgb.hex() for strip in lights.frame(now_ns=0).strips]
    ['000000000000000000']

    `next_change_ns` of its parts says when a frame changes without a new message; a shell sets its timer by
    it.
    """

    def __init__(self, config: LedDriverConfig) -> None:
        self._config = config
        self.content = StripContent(config)
        cursor_timeout_ns = int(config.cursor_timeout_s * NS_PER_S)
        self.things = ThingLamps(self.content.profile_color, cursor_timeout_ns)
        self.lamps = Lamps(config, self.things)
        self._renderer: Renderer | None = None
        self._strips: dict[str, StripFrame] = {}
        """Strips of the last frame. One that does not change is the same object in the next."""
        self._seq = 0
        self.brightness = config.brightness
        """Brightness of all strips except those in `_own_dimming`, 0 to 1."""
        self._dimming = _dimming_table(config.brightness)
        self._own_dimming: dict[str, Bytes] = {}
        self._shown: tuple[bytes, int] | None = None
        """Pixels that are shown instead of the picture, and the time when that ends, ns."""

    def set_brightness(self, brightness: float, strips: Sequence[str] = ()) -> None:
        """Dim `strips`, or all of them if empty, to `brightness`, 0 to 1.

        Raises:
            ValueError: If there is no such strip. The message lists the existing ones.
        """
        known: tuple[str, ...] = ()
        if self._renderer is not None:
            known = tuple(self._renderer.layout.slices)
        for name in strips:
            if name not in known:
                raise ValueError(_unknown_strip(name, known))
        if strips:
            self._own_dimming.update(dict.fromkeys(strips, _dimming_table(brightness)))
        else:
            self.brightness = brightness
            self._dimming = _dimming_table(brightness)
            self._own_dimming.clear()

    def show(self, lit: Sequence[LitPixels], until_ns: int) -> None:
        """Show the pixels `lit`, undimmed, and no others before `until_ns` or the next map.

        Raises:
            ValueError: If there is no such strip or pixel.
        """
        slices: dict[str, slice] = {}
        picture = bytearray()
        if self._renderer is not None:
            slices = self._renderer.layout.slices
            picture = bytearray(3 * self._renderer.layout.count)
        for group in lit:
            strip = slices.get(group.id)
            if strip is None:
                raise ValueError(_unknown_strip(group.id, slices))
            count = (strip.stop - strip.start) // 3
            for pixel in group.pixels:
                if pixel >= count:
                    raise ValueError(
                        f"strip {group.id} has no pixel {pixel}; its pixels are 0 to {count - 1}"
                    )
                first = strip.start + 3 * pixel
                picture[first : first + 3] = bytes(group.color)
        self._shown = (bytes(picture), until_ns)

    def on_map(self, environment: Environment) -> None:
        """Rebuild the layout of the strips.

        Raises:
            ValueError: If a line has no length, or there are more pixels than a frame can hold. The last map
                stays.
        """
        layout = Layout(environment.strips, environment.belts)
        self._renderer = Renderer(layout, self._config.style)
        self._strips.clear()
        self._shown = None
        for strip in self._own_dimming.keys() - layout.slices.keys():
            del self._own_dimming[strip]
        self.content.set_layout(layout)
        lamp_ids = dict.fromkeys(lamp.id for lamp in environment.lamps)
        self.lamps.set_lamps(lamp_ids)
        self.things.set_map(environment)

    def on_cursor(self, user: str, cursor: Cursor, now_ns: int) -> bool:
        """Set `user`'s cursor. Return True if the strips change."""
        self.lamps.on_cursor(user, cursor, now_ns)
        return self.content.set_cursor(user, cursor, now_ns)

    def frame(self, now_ns: int, light_s: float = 0.0) -> StripsFrame | None:
        """Return the strips for `now_ns`, to be seen `light_s` later, or None without a map."""
        if self._renderer is None:
            return None
        self.content.forget(now_ns)

        # Drawn even while other pixels are shown: the picture's times of change and capture go on
        layout = self._renderer.layout
        segments = self.content.segments(now_ns)
        cursors = self.content.cursors(now_ns)
        pixels = self._renderer.render(segments, cursors)
        data = self._dimmed(pixels.ravel(), layout).tobytes()
        if self._shown is not None and now_ns < self._shown[1]:
            data = self._shown[0]

        # The frame has the time of the newest cursor in it, by which its latency is measured
        stamp_ns = self.content.pop_newest_capture_ns()
        if stamp_ns is None:
            stamp_ns = now_ns
        self._seq += 1
        strips = [self._strip(name, data[part]) for name, part in layout.slices.items()]
        return StripsFrame(stamp_ns=stamp_ns, seq=self._seq, strips=tuple(strips), light_s=light_s)

    def _strip(self, name: str, rgb: bytes) -> StripFrame:
        strip = self._strips.get(name)
        if strip is None or strip.rgb != rgb:
            strip = self._strips[name] = StripFrame(id=name, rgb=rgb)
        return strip

    def _dimmed(self, shades: Bytes, layout: Layout) -> Bytes:
        if self.brightness == 1.0 and not self._own_dimming:
            return shades
        dimmed = self._dimming.take(shades)
        for name, table in self._own_dimming.items():
            strip = layout.slices[name]
            dimmed[strip] = table.take(shades[strip])
        return dimmed


def _unknown_strip(name: str, known: Iterable[str]) -> str:
    names = ", ".join(known) or "none"
    return f"there is no strip {name!r}; there are {names}"


def _dimming_table(brightness: float) -> Bytes:
    values = np.rint(np.arange(256) * brightness)
    return np.asarray(values, dtype=np.uint8)
