"""Warnings and metrics of one output, under its address."""

import asyncio

from pointit.runtime.service.surroundings import HealthSink
from pointit.schemas.text import round_beyond
from pointit.services.led_driver.output.power import PowerLoad

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

    def warn(self, topic: str, sentence: str) -> None:
        """Show a warning, which begins with the address, until it is cleared, by `clear` or `""`."""
        self._health.warn(f"{topic} {self._address}", f"{self._address}: {sentence}" if sentence else "")

    def clear(self, topic: str) -> None:
        """Clear a warning."""
        self._health.clear(f"{topic} {self._address}")

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric. None removes it."""
        # a metric's name is short, an address may not be; its end distinguishes ports
        self._health.set_metric(f"{name} {self._address[-FIGURE_NAME:]}", value, unit)

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data at the moment at which it becomes visible."""
        self._health.reached(latency_s)

    def show_load(self, load: PowerLoad, limit_a: float | None) -> None:
        """Show the current of a frame, and warn while frames are dimmed to `limit_a`."""
        self.set_metric("current", load.drawn_a, "A")
        now_s = asyncio.get_running_loop().time()
        if load.limited:
            self._limited_s = now_s
            self.warn(
                "current",
                f"frames need up to {round_beyond(load.wanted_a, limit_a or 0.0)} A and are dimmed to "
                f"{limit_a} A; lower the "
                "brightness, or give more power and raise `max_current_a`",
            )
        elif now_s - self._limited_s >= LIMIT_SHOWN_S:
            self.clear("current")
