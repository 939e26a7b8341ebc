"""Output to Art-Net nodes."""

from collections.abc import Sequence

from pydantic import Field

from pointit.runtime.service.surroundings import Surroundings
from pointit.services.led_driver.output.datagram_sender import Datagram, Destination
from pointit.services.led_driver.output.dmx.artnet_discovery import find_nodes
from pointit.services.led_driver.output.dmx.artnet_protocol import (
    MAX_PORT_ADDRESS,
    PORT,
    dmx_packet,
    sync_packet,
)
from pointit.services.led_driver.output.dmx.stream import RATE_HZ, Universe, pixels_wire
from pointit.services.led_driver.output.network_output import NetworkOutput
from pointit.services.led_driver.outputs import LedOutput, OutputConfig


class ArtnetConfig(OutputConfig):
    """A node of Art-Net."""

    kind: str = Field(default="artnet", description="kind of controller")
    host: str = Field(default="", description="name or address of the node, or a broadcast address")
    port: int = Field(default=PORT, gt=0, le=65535, description="UDP port of the node")
    universe: int = Field(
        default=0,
        ge=0,
        le=MAX_PORT_ADDRESS,
        description="first port address (net · 256 + sub-net · 16 + universe): 170 RGB or 128 RGBW pixels",
    )
    sync: bool = Field(default=True, description="show several universes at once, by ArtSync")
    max_rate_hz: float = Field(
        default=RATE_HZ, gt=0, le=1000, description="maximum number of frames per second"
    )


class ArtnetStream:
    """Packets to one node, or to all of a network."""

    def __init__(self, host: str, port: int, *, sync: bool = True) -> None:
        """Prepare. `sync`: let several universes be shown at once."""
        self.destination = Destination(host=host, port=port, is_broadcast=True)
        self._sync = sync

    def frame(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`."""
        packets = [Datagram(dmx_packet(universe, number, slots)) for universe, slots in universes]
        if self._sync and len(packets) > 1:
            packets.append(Datagram(sync_packet()))
        return packets

    def end(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes` for the last time."""
        return self.frame(universes, number)


def make_artnet(config: ArtnetConfig, around: Surroundings) -> NetworkOutput:
    """Return the output; nothing is opened yet."""
    stream = ArtnetStream(config.host, config.port, sync=config.sync)
    wire = pixels_wire(stream, config.universe, config.max_rate_hz)
    return NetworkOutput(config, stream.destination, wire, around.health, config.host)


ARTNET = LedOutput(
    summary="Art-Net nodes: pixel controllers, DMX nodes",
    config=ArtnetConfig,
    make=make_artnet,
    argument="host",
    divided_by="universe",
    example="ADDRESS",
    discover=find_nodes,
)
