"""Strips on a controller in the network: a base of all protocols whose frames are datagrams."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pointit.runtime.service.surroundings import HealthSink
from pointit.schemas import Strip, StripsFrame
from pointit.services.led_driver.output.datagram_sender import Datagram, DatagramSender, Destination
from pointit.services.led_driver.output.output_health import OutputHealth
from pointit.services.led_driver.output.pixel_map import WHOLE, PixelMap, map_pixels
from pointit.services.led_driver.output.power import Power
from pointit.services.led_driver.outputs import OutputConfig

EncodePixels = Callable[[bytes, PixelMap, int], Sequence[Datagram]]
"""Returns the datagrams that show pixels, given the output's map and the number of the frame, from 1."""


@dataclass(frozen=True, kw_only=True)
class Wire:
    """Protocol of a controller. Pure."""

    encode: EncodePixels
    encode_end: EncodePixels | None = None
    """Datagrams at the end, given dark pixels. If None, those of a dark frame."""
    block_bytes: int | None = None
    """Number of bytes of a universe. Its pixels are whole."""
    first_block: int = 0
    """Number of the first universe."""
    max_rate_hz: float
    """Number of frames per second that the controller takes."""


class NetworkOutput:
    """Sends frames to one controller in the network. Newer frames replace unsent ones."""

    def __init__(
        self, config: OutputConfig, destination: Destination, wire: Wire, health: HealthSink, address: str
    ) -> None:
        """Prepare; nothing is opened yet. `address` names the output in health."""
        self._config = config
        self._wire = wire
        self._health = OutputHealth(health, address)
        self._power = Power(config)
        self._map, _ = map_pixels((), ())
        self._strips: tuple[Strip, ...] | None = None
        self._sender = DatagramSender(
            destination,
            lambda pixels, number: self._wire.encode(pixels, self._map, number),
            self._health,
            max_rate_hz=wire.max_rate_hz,
            encode_end=self._encode_end,
        )

    def _encode_end(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        return (self._wire.encode_end or self._wire.encode)(bytes(len(pixels)), self._map, number)

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last datagram of the last new frame, s; 0.0 before the first."""
        return self._sender.light_s

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips. Reports in health what the output cannot show."""
        if tuple(strips) == self._strips:  # no blink
            return
        self._strips = tuple(strips)
        block_pixels = WHOLE
        if self._wire.block_bytes is not None:
            orders = [segment.order for segment in self._config.segments] or ["RGB"]
            block_pixels = self._wire.block_bytes // len(orders[0])
        new_map, problems = map_pixels(
            self._config.segments, strips, block_pixels=block_pixels, first_block=self._wire.first_block
        )
        self._map = new_map.covering(self._map)
        self._sender.send(bytes(self._map.size))
        self._health.warn("segments", "; ".join(problems))

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once."""
        pixels, load = self._power.send(self._map.output_bytes(frame))
        self._health.show_load(load, self._config.max_current_a)
        self._sender.send(pixels, age_s)

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        await self._sender.run()
