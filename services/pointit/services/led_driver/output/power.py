"""Values sent to a controller's LEDs: gamma correction and current limit."""

from dataclasses import dataclass

import numpy as np

from pointit.services.led_driver.outputs import OutputConfig

FULL_PIXEL = 3 * 255
"""Sum of a white pixel's bytes."""


@dataclass(frozen=True, slots=True)
class PowerLoad:
    """Current of one frame."""

    wanted_a: float
    """Current of the frame as requested, A."""
    drawn_a: float
    """Current of the frame as sent, A: the same, or the limit."""

    @property
    def limited(self) -> bool:
        """True if the frame was dimmed."""
        return self.drawn_a < self.wanted_a


class Power:
    """Converts frames as perceived to the values sent.

    Perceived brightness is nonlinear, LEDs are linear: a byte v becomes 255·(v / 255)^gamma. The current is
    estimated from the sum of the bytes that are sent, without that of dark LEDs. Above the limit the whole
    frame is scaled down, so that colours keep their hue.
    """

    def __init__(self, config: OutputConfig) -> None:
        """Set gamma and limits of one output."""
        self._sent = np.rint(255.0 * (np.arange(256) / 255.0) ** config.gamma)
        self._table = self._sent.astype(np.uint8).tobytes()
        self._a_per_count = config.current_per_pixel_ma / 1000.0 / FULL_PIXEL
        self._limit_a = config.max_current_a

    def send(self, pixels: bytes) -> tuple[bytes, PowerLoad]:
        """Return the bytes to send for the `pixels` of a frame, and their current."""
        sent = pixels.translate(self._table)
        wanted_a = drawn_a = self._current_a(sent)
        if self._limit_a is not None and wanted_a > self._limit_a:
            scaled = np.floor(self._sent * (self._limit_a / wanted_a))  # rounding must not exceed the limit
            sent = pixels.translate(scaled.astype(np.uint8).tobytes())
            drawn_a = self._current_a(sent)
        return sent, PowerLoad(wanted_a, drawn_a)

    def _current_a(self, sent: bytes) -> float:
        return int(np.frombuffer(sent, dtype=np.uint8).sum(dtype=np.uint32)) * self._a_per_count
