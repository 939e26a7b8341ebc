"""A wrist whose app sends datagrams to a port, without any handshake: one sender, watched for silence."""

import asyncio
import ipaddress
from collections.abc import Callable, Sequence
from typing import Protocol

from pydantic import Field, field_validator

from pointit.runtime.clock import Clock
from pointit.runtime.config.config import Config
from pointit.runtime.health.surroundings import HealthSink
from pointit.services.imu_bridge.network.contents import DatagramError
from pointit.services.imu_bridge.network.udp_server import (
    ANY_HOST,
    LOOPBACK,
    Address,
    DatagramLimit,
    UdpServer,
)
from pointit.services.imu_bridge.reading import Deliver, Disconnected, Item, Reconnected

STEP_S = 0.5
LOST_S = 3.0
"""Time without a reading after which the sender is out of reach, s."""
REPLACED_S = 10.0
"""Time without a datagram after which another sender takes the place of one that nobody has named, s."""
OTHERS_S = 5.0
"""Time for which another sender is named, s."""
MOST_OTHERS = 8
BAD_S = 10.0
"""Time for which datagrams that cannot be read are told, s."""


class DatagramConfig(Config):
    """A sender of datagrams."""

    port: int = Field(
        ge=1, le=65535, description="UDP port to which the device sends; each person has another"
    )
    host: str = Field(
        default="127.0.0.1",
        description="address to listen at: 127.0.0.1 is this machine alone, 0.0.0.0 all of its networks; "
        "each program that can send there can move the wrist, since there are no passwords",
    )
    sender: str = Field(
        default="", description="IP address of the device; the first that sends something readable if empty"
    )

    @field_validator("sender")
    @classmethod
    def _ip(cls, value: str) -> str:
        try:
            return str(ipaddress.ip_address(value)) if value else ""
        except ValueError as error:
            raise ValueError("must be an IP address; leave it empty for the first that sends") from error


class Decoder(Protocol):
    """Reads the datagrams of one device, from its connection on."""

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the readings and events of a datagram that arrived at `stamp_ns`, if it has any.

        Raises:
            DatagramError: If it cannot be read.
        """
        ...


class SenderChoice:
    """Chooses one of the machines that send, and remembers the others."""

    def __init__(self, wanted: str = "") -> None:
        """Use the machine with the IP address `wanted`, or the first if it is `""`."""
        self._wanted = wanted
        self.used = ""
        """IP address of the machine in use, or `""`."""
        self._heard_s = 0.0
        self._others: dict[str, float] = {}

    def may_use(self, host: str, now_s: float) -> bool:
        """Return True if datagrams of `host` may be used; else remember it."""
        if self._wanted:
            allowed = host == self._wanted
        else:
            allowed = not self.used or host == self.used or now_s - self._heard_s > REPLACED_S
        if not allowed and (host in self._others or len(self._others) < MOST_OTHERS):
            self._others[host] = now_s
        return allowed

    def use(self, host: str, now_s: float) -> None:
        """Use `host`, which has sent something readable."""
        self.used, self._heard_s = host, now_s
        self._others.pop(host, None)

    def others(self, now_s: float) -> list[str]:
        """Return the other machines that have sent in the last seconds."""
        self._others = {host: s for host, s in self._others.items() if now_s - s < OTHERS_S}
        return sorted(self._others)


class DatagramSource:
    """Passes the readings of one sender on."""

    def __init__(
        self,
        name: str,
        config: DatagramConfig,
        decoder: Callable[[], Decoder],
        clock: Clock,
        health: HealthSink,
    ) -> None:
        """Read datagrams by a new `decoder` for each connection. `name` is the plug-in's."""
        self._name = name
        self._config = config
        self._make_decoder = decoder
        self._decoders: dict[str, Decoder] = {}
        """Decoders of the machine in use, or of those that have sent no reading yet."""
        self._clock = clock
        self._health = health
        self._senders = SenderChoice(config.sender)
        self._limit, self._limit_of_others = DatagramLimit(), DatagramLimit()
        remedy = f"end the program that has it, or set another {name}.port, here and in the device's app"
        self._server = UdpServer(config.host, config.port, health, self._on_datagram, remedy=remedy)
        self._read_s: float | None = None
        """Time of the last reading, or None while out of reach."""
        self._bad_s: float | None = None
        self._bad_count = 0
        self._bad = ""

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        self._deliver = deliver
        async with asyncio.TaskGroup() as group:
            group.create_task(self._server.run())
            while True:
                self._step(asyncio.get_running_loop().time())
                await asyncio.sleep(STEP_S)

    def _on_datagram(self, data: bytes, address: Address) -> None:
        now_s = asyncio.get_running_loop().time()
        host = address[0]
        limit = self._limit if host == self._senders.used else self._limit_of_others
        if not limit.admits(now_s) or not self._senders.may_use(host, now_s):
            return
        is_new = self._read_s is None or host != self._senders.used
        decoder = self._decoders.get(host)
        if decoder is None:
            if len(self._decoders) >= MOST_OTHERS:
                del self._decoders[next(iter(self._decoders))]
            decoder = self._decoders[host] = self._make_decoder()
        try:
            items = decoder.items(data, self._clock.now_ns())
        except DatagramError as error:
            self._bad_s, self._bad = now_s, f"the last, from {host}, {error}"
            self._bad_count += 1
            return
        if not items:
            return
        self._senders.use(host, now_s)
        self._read_s = now_s
        if is_new:
            self._decoders = {host: decoder}
            self._deliver(Reconnected())
        for item in items:
            self._deliver(item)

    def _step(self, now_s: float) -> None:
        """Notice that the sender fell silent, and tell what is wrong."""
        if self._read_s is not None and now_s - self._read_s > LOST_S:
            self._read_s = None
            self._decoders.clear()
            self._deliver(
                Disconnected(f"{self._senders.used} sends nothing any more: check its app and its network")
            )
        place = self._server.place
        missing = ""
        if not self._senders.used:  # later, `Disconnected` tells it
            only = (
                "; only this machine is heard there, set "
                f"{self._name}.host={ANY_HOST} for devices of the network"
                if self._config.host.startswith(LOOPBACK)
                else ""
            )
            missing = (
                f"no reading arrives at UDP port {place}: start the app and let it send to this machine{only}"
            )
        self._health.warn("silent", missing)
        others = ", ".join(self._senders.others(now_s))
        self._health.warn(
            "others",
            f"{others} sends to port {place}, too, and is not used: set {self._name}.sender"
            if others
            else "",
        )
        if self._bad_s is not None and now_s - self._bad_s > BAD_S:
            self._bad_s, self._bad_count = None, 0
        self._health.warn(
            "unreadable",
            f"{self._bad_count} datagrams at port {place} could not be read; {self._bad}"
            if self._bad_s is not None
            else "",
        )
        problem = self._limit.problem(now_s)
        self._health.warn("flood", f"{self._senders.used} {problem}" if problem else "")
