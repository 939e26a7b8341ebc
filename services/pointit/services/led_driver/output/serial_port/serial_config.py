"""Parameters of every controller on a serial port, and the duration of bytes on its wire."""

from pydantic import Field

from pointit.services.led_driver.outputs import OutputConfig

MAX_BAUD = 4_000_000
BITS_PER_BYTE = 10
"""Bits on the wire, with start and stop bit."""


class SerialOutputConfig(OutputConfig):
    """A controller on a serial port."""

    port: str = Field(
        "",
        description="path or name of the controller's port; /dev/serial/by-id/... survives plugging in again",
    )
    baud: int = Field(115200, gt=0, le=MAX_BAUD, description="bits per second")
    wanted_rate_hz: float = Field(
        25.0, gt=0, le=1000, description="frames per second below which a warning says what fits"
    )


def wire_time_s(size_bytes: int, baud: int) -> float:
    """Return the time until the last of `size_bytes` has left a wire of `baud` bits per second."""
    return size_bytes * BITS_PER_BYTE / baud
