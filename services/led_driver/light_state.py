"""State of all lights: messages in, frames of strips and colours of lamps out when they are due."""

from collections.abc import Sequence

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
    """Strips and lamps of one map. Pure: calls pass the time, and nothing is drawn unless requested."""

    def __init__(self, config: LedDriverConfig) -> None:
        self._config = config
        self.content = StripContent(config)
        self.things = ThingLamps(self.content.profile_color, int(config.cursor_timeout_s * NS_PER_S))
        self.lamps = Lamps(config, self.things)
        self._renderer: Renderer | None = None
        self._strips: dict[str, StripFrame] = {}
        """Strips of the last frame. One that does not change is the same object in the next."""
        self._seq = 0
        self.brightness = config.brightness
        """Brightness of all strips except those in `_own_dimming`, 0 to 1."""
        self._dimming = _table(config.brightness)
        self._own_dimming: dict[str, Bytes] = {}
        self._shown: tuple[bytes, int] | None = None
        """Pixels that are shown instead of the picture, and the time when that ends, ns."""

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

    def show(self, lit: Sequence[LitPixels], until_ns: int) -> None:
        """Show the pixels `lit`, undimmed, and no others before `until_ns` or the next map.

        Raises:
            ValueError: If there is no such strip or pixel.
        """
        slices = {} if self._renderer is None else self._renderer.layout.slices
        pixels = bytearray(0 if self._renderer is None else 3 * self._renderer.layout.count)
        for each in lit:
            where = slices.get(each.id)
            if where is None:
                raise ValueError(f"there is no strip {each.id!r}; there are {', '.join(slices) or 'none'}")
            count = (where.stop - where.start) // 3
            for pixel in each.pixels:
                if pixel >= count:
                    raise ValueError(f"strip {each.id} has no pixel {pixel}; its pixels are 0 to {count - 1}")
                first = where.start + 3 * pixel
                pixels[first : first + 3] = bytes(each.color)
        self._shown = bytes(pixels), until_ns

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
        self._own_dimming = {
            name: table for name, table in self._own_dimming.items() if name in layout.slices
        }
        self.content.set_layout(layout)
        self.lamps.set_lamps(dict.fromkeys(lamp.id for lamp in environment.lamps))
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
        layout = self._renderer.layout
        pixels = self._renderer.render(self.content.segments(now_ns), self.content.cursors(now_ns))
        data = self._dimmed(pixels.ravel(), layout).tobytes()
        if self._shown is not None and now_ns < self._shown[1]:
            data = self._shown[0]
        new_ns = self.content.pop_newest_capture_ns()
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
        if self.brightness == 1.0 and not self._own_dimming:
            return shades
        dimmed = self._dimming.take(shades)
        for name, table in self._own_dimming.items():
            where = layout.slices[name]
            dimmed[where] = table.take(shades[where])
        return dimmed


def _table(brightness: float) -> Bytes:
    return np.asarray(np.rint(np.arange(256) * brightness), dtype=np.uint8)
