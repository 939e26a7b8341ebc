"""Strips on one controller: map, gamma, current and health, which all protocols share.

No core: it reports the health of a controller and logs.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Sequence

from pointit.runtime.service.plugin_guard import HealthSink, Surroundings
from pointit.schemas import Strip, StripsFrame
from pointit.schemas.text import round_beyond
from pointit.services.led_driver.output.pixel_map import PixelMap, Power, PowerLoad, map_pixels
from pointit.services.led_driver.outputs import OutputConfig

LIMIT_SHOWN_S = 2.0
"""Time for which dimming is reported, s. Health is read once a second."""
FIGURE_NAME = 50
"""Maximum number of characters of the address in the name of a metric."""


class OutputHealth:
    """Health of the output at an address."""

    def __init__(self, health: HealthSink, address: str) -> None:
        self._health = health
        self._address = address
        self._limited_s = -LIMIT_SHOWN_S
        self.light_s = 0.0
        """Time from `show` to the last byte of the last new frame on the wire, s; 0.0 before the first."""

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show a warning, which begins with the address, until it is cleared, by `clear` or `""`."""
        if sentence:
            sentence = f"{self._address}: {sentence}"
        self._health.warn(code, sentence, subject or self._address)

    def clear(self, code: str, subject: str = "") -> None:
        """Clear a warning."""
        self._health.clear(code, subject or self._address)

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric. None removes it."""
        # a metric's name is short, an address may not be; its end distinguishes ports
        address = self._address[-FIGURE_NAME:]
        self._health.set_metric(f"{name} {address}", value, unit)

    def reached(self, age_s: float, light_s: float) -> None:
        """Record that what was captured `age_s` before `show` has left `light_s` after it."""
        self.light_s = light_s
        self._health.reached(age_s + light_s)

    def show_load(self, load: PowerLoad, limit_a: float | None) -> None:
        """Show the current of a frame, and warn while frames are dimmed to `limit_a`."""
        self.set_metric("current", load.drawn_a, "A")
        now_s = asyncio.get_running_loop().time()
        if load.limited:
            self._limited_s = now_s
            wanted_a = round_beyond(load.wanted_a, limit_a or 0.0)
            self.warn(
                "current",
                f"frames need up to {wanted_a} A and are dimmed to {limit_a} A; lower the brightness, or "
                "give more power and raise `max_current_a`",
            )
        elif now_s - self._limited_s >= LIMIT_SHOWN_S:
            self.clear("current")


class PixelOutput(ABC):
    """Shows strips on one controller: an `Output` of which a subclass only sends the pixels."""

    def __init__(self, config: OutputConfig, surroundings: Surroundings, address: str) -> None:
        """Prepare; nothing is opened yet. `address` names the output in health."""
        self._config = config
        self._power = Power(config)
        self._strips: tuple[Strip, ...] | None = None
        self.health = OutputHealth(surroundings.health, address)
        """Warnings and metrics of this output."""
        self.pixel_map, _ = map_pixels((), ())
        """Pixels of the strips on the output."""

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last byte of the last new frame, s; 0.0 before the first."""
        return self.health.light_s

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips. Reports in health what the output cannot show."""
        if tuple(strips) == self._strips:  # no blink
            return
        self._strips = tuple(strips)
        self.pixel_map, problems = self.map_strips(strips)
        self._on_map(problems)

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once."""
        pixels, load = self._power.send(self.pixel_map.output_bytes(frame))
        self.health.show_load(load, self._config.max_current_a)
        self.send_pixels(pixels, age_s)

    def map_strips(self, strips: Sequence[Strip]) -> tuple[PixelMap, list[str]]:
        """Return the pixels of `strips` on the output, and sentences about what it cannot show."""
        pixel_map, problems = map_pixels(self._config.segments, strips)
        return pixel_map.covering(self.pixel_map), problems

    @abstractmethod
    def send_pixels(self, pixels: bytes, age_s: float) -> None:
        """Send `pixels` of the present map, captured `age_s` ago, instead of unsent ones. Returns at once."""

    @abstractmethod
    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""

    def _on_map(self, problems: list[str]) -> None:
        self.health.warn("segments", "; ".join(problems))
