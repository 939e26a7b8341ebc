"""Output to a serial LED expander: its channels with parts of strips."""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from pointit.runtime.service.surroundings import HealthSink
from pointit.schemas import Strip, StripsFrame
from pointit.services.led_driver.output.power import Power
from pointit.services.led_driver.output.serial_port import upxl_protocol
from pointit.services.led_driver.output.serial_port.config import ExpanderConfig
from pointit.services.led_driver.output.serial_port.serial_output import SerialFrame, SerialOutput
from pointit.services.led_driver.output.serial_port.wiring import map_channels, too_slow
from pointit.services.led_driver.outputs import LedOutput

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ExpanderFrame(SerialFrame):
    """Content of the board: (channel, order, rgb) of each channel."""

    channels: tuple[tuple[int, str, bytes], ...] = ()

    draws_while_receiving: ClassVar[bool] = True

    def dark(self) -> "ExpanderFrame":
        """Return the same channels, all black."""
        dark = tuple((channel, order, bytes(len(rgb))) for channel, order, rgb in self.channels)
        return replace(self, channels=dark)

    def data(self) -> bytes:
        """Return the bytes of the protocol that show it."""
        return (
            b"".join(upxl_protocol.set_channel(*channel) for channel in self.channels)
            + upxl_protocol.draw_all()
        )

    def draw_time_s(self) -> float:
        """Return the time that the board takes to draw it, s."""
        return upxl_protocol.draw_time_s(max((len(rgb) // 3 for _, _, rgb in self.channels), default=0))


class ExpanderOutput(SerialOutput):
    """Sends frames to one expander."""

    def __init__(self, config: ExpanderConfig, health: HealthSink) -> None:
        super().__init__(config, health)
        self._board = config
        self._power = Power(config)
        self._wiring, _ = map_channels(config, ())

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips. Reports in health what board and wire cannot show."""
        self._wiring, problems = map_channels(self._board, strips)
        if slow := too_slow(self._board, self._wiring.channels):
            problems.append(slow)
            log.warning("%s: %s", self._board.port, slow)
        self.set_problems(problems)

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once."""
        pixels, load = self._power.send(self._wiring.pixel_map.output_bytes(frame))
        self._health.show_load(load, self._board.max_current_a)
        channels = zip(self._wiring.channels, self._wiring.split(pixels), strict=True)
        self.send(
            ExpanderFrame(
                tuple((channel.number, channel.order, rgb) for channel, rgb in channels),
                shown_s=time.monotonic(),
                age_s=age_s,
            )
        )


EXPANDER = LedOutput(
    summary="a serial LED expander (UPXL: ElectroMage, Pixelblaze)",
    config=ExpanderConfig,
    make=lambda config, around: ExpanderOutput(config, around.health),
    argument="port",
    example="PORT",
)
