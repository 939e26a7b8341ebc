"""Universes sent to a receiver, and their end: the interface of E1.31 and Art-Net."""

from collections.abc import Sequence
from typing import Protocol

from pointit.services.led_driver.output.datagram_sender import Datagram, Destination
from pointit.services.led_driver.output.network_output import Wire
from pointit.services.led_driver.output.pixel_map import PixelMap

UNIVERSE_SLOTS = 512
"""Number of values of a universe, a byte each."""
RATE_HZ = 40.0
"""Number of frames per second; DMX itself carries 44."""
Universe = tuple[int, bytes]
"""Number of a universe, and its values from the first slot on."""


class DmxStream(Protocol):
    """Packets that set universes of one receiver. Pure."""

    @property
    def destination(self) -> Destination:
        """Return the receiver."""
        ...

    def frame(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`. `number` counts frames."""
        ...

    def end(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes` for the last time."""
        ...


def pixels_wire(stream: DmxStream, first_universe: int, rate_hz: float) -> Wire:
    """Return the protocol of an output whose pixels fill universes from `first_universe` on."""

    def universes(pixels: bytes, pixel_map: PixelMap) -> list[Universe]:
        return [(block.number, pixels[block.start : block.start + block.size]) for block in pixel_map.blocks]

    return Wire(
        encode=lambda pixels, pixel_map, number: stream.frame(universes(pixels, pixel_map), number),
        encode_end=lambda pixels, pixel_map, number: stream.end(universes(pixels, pixel_map), number),
        block_bytes=UNIVERSE_SLOTS,
        first_block=first_universe,
        max_rate_hz=rate_hz,
    )
