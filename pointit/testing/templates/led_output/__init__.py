"""A controller in the network that takes pixels as hexadecimal digits, a datagram a frame."""

from collections.abc import Sequence

from pydantic import Field

from pointit.plugins import Datagram, LedOutput, UdpOutput, UdpOutputConfig


class OutputParameters(UdpOutputConfig):
    """Address of the controller."""

    port: int = Field(default=4211, gt=0, le=65535, description="UDP port of the controller")


class HexadecimalOutput(UdpOutput):
    """Encodes frames as datagrams. The base sends and repeats them, and ends dark."""

    def encode(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        """Return the datagram that shows `pixels`: red, green, blue of each."""
        del number  # this protocol does not count frames
        return [Datagram(pixels.hex().encode() + b"\n")]


OUTPUT = LedOutput(
    summary="a controller in the network that takes pixels as hexadecimal digits",
    config=OutputParameters,
    make=HexadecimalOutput,
    argument="host",
)
