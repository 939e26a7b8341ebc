"""Parameters of controllers on a serial port, and the duration of bytes on its wire."""

from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from pointit.runtime.config.config import Config
from pointit.services.led_driver.outputs import OutputConfig, Segment, validated_order

CHANNELS = 64
Board = Literal["v1", "v2", "v3"]
MAX_BAUD = 4_000_000
BITS_PER_BYTE = 10
"""Bits on the wire, with start and stop bit."""


class SerialOutputConfig(OutputConfig):
    """A controller on a serial port."""

    port: str = Field(
        default="",
        description="path or name of the controller's port; /dev/serial/by-id/... survives plugging in again",
    )
    baud: int = Field(default=115200, gt=0, le=MAX_BAUD, description="bits per second")
    wanted_rate_hz: float = Field(
        default=25.0, gt=0, le=1000, description="frames per second below which a warning says what fits"
    )


def wire_time_s(size_bytes: int, baud: int) -> float:
    """Return the time until the last of `size_bytes` has left a wire of `baud` bits per second."""
    return size_bytes * BITS_PER_BYTE / baud


class ChannelConfig(Config):
    """Connection of a strip to its controller."""

    channel: int = Field(ge=0, le=63, description="board number (0-7) times 8 plus port (0-7)")
    order: str = Field(
        default="GRB", description="order of the colours on the LEDs' wire: GRB, RGB, GRBW ..."
    )

    _order = field_validator("order")(validated_order)


class ExpanderConfig(SerialOutputConfig):
    """A serial LED expander (UPXL: ElectroMage, Pixelblaze)."""

    kind: str = Field(default="expander", description="kind of controller")
    baud: int = Field(default=2_000_000, gt=0, le=4_000_000, description="bits per second")
    board: Board = Field(
        default="v2", description="generation of the board: v1, v2, v3 drive 240, 800, 1600 pixels a channel"
    )
    channels: dict[str, ChannelConfig] = Field(
        default={},
        description="connections by strip id; strips in the map's order on channels 0, 1, 2 ... if empty. "
        "Parts of strips are in `segments`, whose `universe` is the channel",
    )

    @field_validator("segments")
    @classmethod
    def _equally_wide(cls, segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
        return segments  # in place of the base's: each channel may have a width of its own

    def strip_ids(self) -> frozenset[str]:
        """Return the ids of the strips that it shows, empty for all of the map."""
        return super().strip_ids() | self.channels.keys()

    @model_validator(mode="after")
    def _one_strip_a_channel(self) -> Self:
        if self.channels and self.segments:
            raise ValueError("use `channels` or `segments`, not both")
        if any(segment.universe not in range(CHANNELS) for segment in self.segments):
            raise ValueError(f"segments: each needs its channel, 0 to {CHANNELS - 1}, as `universe`")
        taken: dict[int, str] = {}
        for strip_id, channel in self.channels.items():
            other = taken.setdefault(channel.channel, strip_id)
            if other != strip_id:
                raise ValueError(
                    f"channels: strips {other!r} and {strip_id!r} share channel {channel.channel}"
                )
        return self
