"""A wrist that sends its orientation by UDP: a wire format, its decoder and the plug-in, in 40 lines."""

import struct
from collections.abc import Sequence

from pydantic import Field

from pointit.services.imu_bridge.network.datagram_source import DatagramConfig, DatagramSource, Decoder
from pointit.services.imu_bridge.sources import ImuSource, Item, Reading
from pointit.services.imu_bridge.streams import ContentError, SensorChoice, unit_rotation

DATAGRAM = struct.Struct("<Iffff")
"""Time of the device in ms, then w, x, y, z of world_from_sensor."""


class WristConfig(DatagramConfig):
    """A device that sends these datagrams."""

    port: int = Field(default=46100, ge=1, le=65535, description="UDP port to which the device sends")


class WristDecoder(Decoder):
    """Reads the datagrams of one device."""

    def __init__(self, config: WristConfig) -> None:
        super().__init__(SensorChoice("my_wrist.sensor", config.sensor))

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the reading of a datagram. Raises `ContentError` if it is none."""
        if len(data) != DATAGRAM.size:
            raise ContentError(f"has {len(data)} bytes, {DATAGRAM.size} were expected")
        time_ms, *wxyz = DATAGRAM.unpack(data)
        rotation = unit_rotation(wxyz, "wxyz")
        return [Reading(stamp_ns, rotation, time_ms * 1_000_000)]


MY_WRIST = ImuSource(
    summary="a wrist that sends its orientation by UDP",
    config=WristConfig,
    make=lambda config, context: DatagramSource(
        "my_wrist", config, lambda: WristDecoder(config), context.clock, context.health
    ),
    argument="port",
    argument_optional=True,
    example="46100",
)
