"""Output to receivers of E1.31 (sACN): pixel controllers, WLED, DMX nodes."""

import ipaddress
import socket
import uuid
from collections.abc import Sequence
from typing import Self

from pydantic import Field, model_validator

from pointit.runtime.address_config import AddressConfig
from pointit.runtime.service.surroundings import Surroundings
from pointit.services.led_driver.output.datagram_sender import Datagram, Destination
from pointit.services.led_driver.output.dmx.e131_protocol import (
    DEFAULT_PRIORITY,
    END_PACKETS,
    MAX_UNIVERSE,
    MIN_UNIVERSE,
    PORT,
    E131Sender,
    data_packet,
    multicast_address,
)
from pointit.services.led_driver.output.dmx.stream import RATE_HZ, Universe, pixels_wire
from pointit.services.led_driver.output.network_output import NetworkOutput
from pointit.services.led_driver.outputs import LedOutput, OutputConfig

MULTICAST = "multicast"
"""Value of `host` that means the multicast group of each universe."""


class E131Config(AddressConfig, OutputConfig):
    """A receiver of E1.31 (sACN)."""

    kind: str = Field(default="e131", description="kind of controller")
    host: str = Field(
        default="", description="name or address of the receiver, HOST:PORT, or `multicast` for a network"
    )
    port: int = Field(default=PORT, gt=0, le=65535, description="UDP port of the receiver")
    interface: str = Field(
        default="", description="IPv4 address of this machine in the network that gets the multicast"
    )
    universe: int = Field(
        default=1, ge=MIN_UNIVERSE, le=MAX_UNIVERSE, description="first universe: 170 RGB or 128 RGBW pixels"
    )
    priority: int = Field(
        default=DEFAULT_PRIORITY, ge=0, le=200, description="priority; receivers obey the highest"
    )
    max_rate_hz: float = Field(
        default=RATE_HZ, gt=0, le=1000, description="maximum number of frames per second"
    )

    @model_validator(mode="after")
    def _has_interface(self) -> Self:
        check_interface(self.host, self.interface)
        return self


def check_interface(host: str, interface: str) -> None:
    """Check that multicast has an interface. Raises ValueError if not."""
    if interface:
        try:
            ipaddress.IPv4Address(interface)
        except ValueError as error:
            raise ValueError(
                f"interface: {interface!r} is not an IPv4 address of this machine, which multicast needs"
            ) from error
    elif host == MULTICAST:
        raise ValueError("interface: multicast needs the address of this machine in the lights' network")


class E131Stream:
    """Packets to one receiver, or to the groups of all."""

    def __init__(
        self, destination: Destination, first_universe: int, priority: int = DEFAULT_PRIORITY
    ) -> None:
        """Prepare. `destination`: its host may be `MULTICAST`."""
        self._is_multicast = destination.host == MULTICAST
        self.destination = destination
        if self._is_multicast:
            self.destination = Destination(host="", port=destination.port, interface=destination.interface)
        # the same after a restart, so that receivers do not merge a stream with its own past
        where = f"{socket.gethostname()} {destination.host} {first_universe}"
        self._sender = E131Sender(uuid.uuid5(uuid.NAMESPACE_DNS, where), "PointIt", priority)

    def frame(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`."""
        return self._packets(universes, number, ended=False)

    def end(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`, and end their streams."""
        packets = self._packets(universes, number, ended=False)
        for later in range(1, END_PACKETS + 1):
            packets += self._packets(universes, number + later, ended=True)
        return packets

    def _packets(self, universes: Sequence[Universe], number: int, *, ended: bool) -> list[Datagram]:
        return [
            Datagram(
                data_packet(self._sender, universe, number, slots, ended=ended),
                multicast_address(universe) if self._is_multicast else None,
            )
            for universe, slots in universes
        ]


def make_e131(config: E131Config, surroundings: Surroundings) -> NetworkOutput:
    """Return the output; nothing is opened yet."""
    destination = Destination(host=config.host, port=config.port, interface=config.interface)
    stream = E131Stream(destination, config.universe, config.priority)
    wire = pixels_wire(stream, config.universe, config.max_rate_hz)
    return NetworkOutput(config, stream.destination, wire, surroundings.health, config.host)


E131 = LedOutput(
    summary="receivers of E1.31 (sACN): pixel controllers, WLED, DMX nodes",
    config=E131Config,
    make=make_e131,
    argument="host",
    divided_by="universe",
    example="ADDRESS",
)
