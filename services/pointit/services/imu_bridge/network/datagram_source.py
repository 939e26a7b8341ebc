"""A wrist whose app sends datagrams to a port, without any handshake: one sender, watched for silence."""

import asyncio
import ipaddress
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from pydantic import Field, field_validator

from pointit.runtime.address_config import AddressConfig
from pointit.runtime.clock import Clock
from pointit.runtime.service.surroundings import HealthSink
from pointit.services.imu_bridge.network.datagram_values import DatagramError
from pointit.services.imu_bridge.network.port_source import PortSource
from pointit.services.imu_bridge.network.sender_choice import MAX_OTHERS, RESTARTED_S, SenderChoice
from pointit.services.imu_bridge.network.udp_server import Address
from pointit.services.imu_bridge.reading import Disconnected, Item, Reconnected
from pointit.services.imu_bridge.streams.sensor_choice import SensorChoice

STEP_S = 0.5
LOST_S = 3.0
"""Time without a reading after which the sender is out of reach, s."""
BAD_S = 10.0
"""Time for which datagrams that cannot be read are told, s."""


class DatagramConfig(AddressConfig):
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

    sensor: str = Field(
        default="",
        description="the sensor that is used if several send: its IP address, or its name or number in their "
        "messages; the first if empty",
    )

    @field_validator("sender")
    @classmethod
    def _ip(cls, value: str) -> str:
        try:
            return str(ipaddress.ip_address(value)) if value else ""
        except ValueError as error:
            raise ValueError("must be an IP address; leave it empty for the first that sends") from error

    @property
    def sensor_address(self) -> str:
        """Return `sensor` if it is an IP address, else `sender`."""
        try:
            return str(ipaddress.ip_address(self.sensor))
        except ValueError:
            return self.sender

    @property
    def sensor_name(self) -> str:
        """Return `sensor` if it is a name in messages, else `""`."""
        return "" if self.sensor_address != self.sender else self.sensor


class Decoder(ABC):
    """Reads the datagrams of one device, from its connection on."""

    uncertainty: str = ""
    """Sentence about guesses of its format and the parameters that replace them, or `""`."""
    problem: str = ""
    """Clause about the unreadable part of a partly readable datagram, or `""`. The owner resets it."""
    unused: str = ""
    """Clause about what arrives while there is no orientation, or `""`."""

    def __init__(self, sensors: SensorChoice) -> None:
        """Use one of the `sensors` that a sender names."""
        self.sensors = sensors

    @abstractmethod
    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the readings and events of a datagram that arrived at `stamp_ns`, if it has any.

        Raises:
            DatagramError: If it cannot be read.
        """


class DatagramSource(PortSource):
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
        remedy = f"end the program that has it, or set another {name}.port, here and in the device's app"
        super().__init__(name, (config.host, config.port), clock, health, remedy=remedy)
        self._make_decoder = decoder
        self._decoders: dict[Address, Decoder] = {}
        """Decoders of the sender in use, or of those that have sent no reading yet."""
        self._senders = SenderChoice(config.sensor_address, excludes_rivals=True)
        self._is_chosen = config.sensor != "" or config.sender != ""
        self._sensors: dict[str, SensorChoice] = {}
        """Choices of senders by their IP address, which outlast a connection."""
        self._read_s: float | None = None
        """Time of the last reading, or None while out of reach."""
        self._bad_s: float | None = None
        self._bad_count = 0
        self._bad = ""

    async def _watch(self) -> None:
        while True:
            self._step(asyncio.get_running_loop().time())
            await asyncio.sleep(STEP_S)

    def _is_used(self, address: Address) -> bool:
        return self._senders.is_used(address)

    def _take(self, data: bytes, address: Address, now_s: float) -> None:
        if not self._senders.may_use(address, now_s):
            return
        sender = self._senders.name(address)
        is_new = self._read_s is None or sender != self._senders.used
        decoder = self._decoders.get(sender) or self._new_decoder(sender)
        items: Sequence[Item] = ()
        try:
            items = decoder.items(data, self._clock.now_ns())
        except DatagramError as error:
            decoder.problem = str(error)
        if decoder.problem:
            self._bad_s, self._bad = now_s, f"the last, from {address[0]}, {decoder.problem}"
            self._bad_count += 1
            decoder.problem = ""
        if not items:
            return
        self._senders.use(sender, now_s)
        self._read_s = now_s
        if is_new:
            self._decoders = {sender: decoder}
            self._pass_on(Reconnected())
        for item in items:
            self._pass_on(item)

    def _new_decoder(self, sender: Address) -> Decoder:
        host, decoder = sender[0], self._make_decoder()
        if len(self._decoders) >= MAX_OTHERS:
            del self._decoders[next(iter(self._decoders))]
        if len(self._sensors) >= MAX_OTHERS:
            del self._sensors[next(iter(self._sensors))]
        decoder.sensors = self._sensors.setdefault(host, decoder.sensors)
        self._decoders[sender] = decoder
        return decoder

    def _step(self, now_s: float) -> None:
        used = self._senders.used
        host = "" if used is None else used[0]
        if self._read_s is not None and now_s - self._read_s > LOST_S:
            self._read_s = None
            self._decoders.clear()
            self._deliver(Disconnected(f"{host} sends nothing any more: check its app and its network"))
        place = self._server.place
        missing = f"no reading arrives at UDP port {place}: start the app and let it send to this machine"
        unused = next((each.unused for each in self._decoders.values() if each.unused), "")
        missing = f"UDP port {place} {unused}" if unused else f"{missing}{self._only_here}"
        self._health.warn("silent", "" if host else missing)  # later, `Disconnected`
        choices = [self._sensors[host]] if host in self._sensors else self._sensors.values()
        self._health.warn("sensors", next((each.warning for each in choices if each.warning), ""))
        others = "" if self._is_chosen else ", ".join(self._senders.others(now_s))
        self._health.warn(
            "others",
            f"{others} sends to port {place}, too, and is not used: set {self._name}.sensor to the address "
            "of the one on the wrist, or another port in one of the apps (one that was restarted is used "
            f"after {RESTARTED_S:g} s)"
            if others
            else "",
        )
        decoder = None if used is None else self._decoders.get(used)
        self._health.warn("order", "" if decoder is None else decoder.uncertainty)
        if self._bad_s is not None and now_s - self._bad_s > BAD_S:
            self._bad_s, self._bad_count = None, 0
        self._health.warn(
            "unreadable",
            f"{self._bad_count} datagrams at port {place} could not be read; {self._bad}"
            if self._bad_s is not None
            else "",
        )
        self._warn_flood(host, now_s)
