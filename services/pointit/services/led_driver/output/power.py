"""What a controller's LEDs are sent: gamma, and no more current than the supply gives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.services.led_driver.config import OutputConfig

FULL_PIXEL = 3 * 255
"""Sum of a white pixel's bytes."""


@dataclass(frozen=True, slots=True)
class Load:
    """What one frame draws."""

    wanted_a: float
    """As it was asked for."""
    drawn_a: float
    """As it is sent: the same, or the limit at most."""

    @property
    def limited(self) -> bool:
        """Whether the frame was dimmed."""
        return self.drawn_a < self.wanted_a


class Power:
    """Frames as they look right to the frames that are sent.

    Eyes see ratios, LEDs are driven by straight numbers: a byte v becomes 255·(v / 255)^gamma. The current
    is estimated from the sum of the bytes that are sent, without what dark LEDs draw. Above the limit all
    of the frame is scaled down, so that colours keep their hue.
    """

    def __init__(self, config: OutputConfig) -> None:
        """Take gamma and limits of one output."""
        self._sent = np.rint(255.0 * (np.arange(256) / 255.0) ** config.gamma)
        self._table = self._sent.astype(np.uint8).tobytes()
        self._a_per_count = config.current_per_pixel_ma / 1000.0 / FULL_PIXEL
        self._limit_a = config.max_current_a

    def send(self, strips: Sequence[bytes]) -> tuple[list[bytes], Load]:
        """Return the bytes to send for `strips`, all of one frame, and what they draw."""
        data = b"".join(strips)
        counts = np.bincount(np.frombuffer(data, dtype=np.uint8), minlength=256)
        wanted_a = drawn_a = float(counts @ self._sent) * self._a_per_count
        table = self._table
        if self._limit_a is not None and wanted_a > self._limit_a:
            scaled = np.floor(self._sent * (self._limit_a / wanted_a))  # never above the limit by rounding
            table = scaled.astype(np.uint8).tobytes()
            drawn_a = float(counts @ scaled) * self._a_per_count
        return [strip.translate(table) for strip in strips], Load(wanted_a, drawn_a)
