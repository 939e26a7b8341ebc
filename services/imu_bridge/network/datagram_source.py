"""A wrist whose app sends datagrams to a port: one of its senders, checked, watched for silence.

No core: it waits for datagrams.
"""

import asyncio
import ipaddress
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence

from pydantic import Field

from pointit.geometry.vector import Vec3
from pointit.runtime.address_config import AddressConfig
from pointit.runtime.clock import Clock
from pointit.runtime.config.parameters import set_option
from pointit.runtime.service.plugin_guard import HealthSink
from pointit.services.imu_bridge.network.udp_server import Address, PortSource
from pointit.services.imu_bridge.sources import Disconnected, Item, RawReading, Reading, Reconnected
from pointit.services.imu_bridge.streams import ContentError, PassedOver, SensorChoice

REPLACED_S = 10.0
"""Time without a datagram after which another machine takes the place of one that nobody has named, s."""
RESTARTED_S = 3.0
"""Time without a datagram after which another port of its machine takes the place, as of an app that was
restarted, s."""
OTHERS_S = 5.0
"""Time for which another sender is named, s."""
MAX_OTHERS = 8
MAX_RIVALS = 64
ROAMING = 8
"""Number of other ports of its machine, while it is silent, that show a new port for each datagram."""

STEP_S = 0.5
LOST_S = 3.0
"""Time without a reading after which the sender is out of reach, s."""
BAD_S = 10.0
"""Time for which datagrams that cannot be read are reported, s."""


def vector(numbers: Sequence[float], scale: float = 1.0) -> Vec3:
    """Return the first three `numbers`, multiplied by `scale`.

    Raises:
        ContentError: If they are fewer, or one is not finite.
    """
    if len(numbers) < 3 or not all(map(math.isfinite, numbers[:3])):
        raise ContentError("has a vector that is not three finite numbers")
    x, y, z = numbers[:3]
    return (scale * x, scale * y, scale * z)


def _is_motion(item: Item) -> bool:
    return isinstance(item, Reading | RawReading)


class SenderChoice:
    """Chooses one of the senders, each an address and a port, and remembers the others."""

    def __init__(self, wanted: str = "", *, excludes_rivals: bool = False) -> None:
        """Use a sender at the IP address `wanted`, or the first if it is `""`.

        `excludes_rivals`: one that was heard side by side with the one in use never replaces it.
        """
        self._wanted = wanted
        self._excludes_rivals = excludes_rivals
        self.used: Address | None = None
        """Sender in use."""
        self._received_s = 0.0
        self._others: dict[Address, float] = {}
        self._ports: set[int] = set()
        """Other ports of its machine that were heard since it was."""
        self._roaming = ""
        """Machine that sends each datagram from another port, or `""`."""
        self._rivals: set[Address] = set()
        """Senders that were heard side by side with the one in use."""

    def name(self, address: Address) -> Address:
        """Return a sender's identity: `address`, or port 0 of a machine that always changes its port."""
        return (address[0], 0) if address[0] == self._roaming else address

    def is_used(self, address: Address) -> bool:
        """Return True if `address` is that of the sender in use."""
        return self.used is not None and self.name(address) == self.name(self.used)

    def may_use(self, address: Address, now_s: float, timeout_s: float = REPLACED_S) -> bool:
        """Return True if datagrams of `address` may be used; else remember it.

        Args:
            address: sender.
            now_s: the time, s.
            timeout_s: time for which the sender in use must have been silent, s. At most `RESTARTED_S` for
                its own machine.
        """
        is_beside = self.used is not None and address[0] == self.used[0]
        if is_beside:
            timeout_s = min(timeout_s, RESTARTED_S)
        is_free = self.used is None or self.is_used(address) or now_s - self._received_s > timeout_s

        # A free place is for the one that is named, or for any that was not heard side by side
        if not is_free:
            is_allowed = False
        elif self._wanted:
            is_allowed = address[0] == self._wanted
        else:
            is_allowed = not self._is_rival(address)
        if is_allowed:
            return True

        # A machine that sends each datagram from another port is one sender
        if is_beside:
            self._ports.add(address[1])
            if len(self._ports) == ROAMING:
                self._roaming = address[0]
                self._others = {}
                return True
        if address in self._others or len(self._others) < MAX_OTHERS:
            self._others[address] = now_s
        return False

    def use(self, address: Address, now_s: float) -> None:
        """Use `address`, which has sent something readable."""
        if self._excludes_rivals and address == self.used and len(self._rivals) < MAX_RIVALS:
            for rival in self._others:
                is_beside = rival[0] == address[0]
                self._rivals.add(rival if is_beside else (rival[0], 0))
        self.used = address
        self._received_s = now_s
        self._ports.clear()
        self._others.pop(address, None)

    def _is_rival(self, address: Address) -> bool:
        return address in self._rivals or (address[0], 0) in self._rivals

    def others(self, now_s: float) -> list[str]:
        """Return the other senders of the last seconds: their address, with the port if it is that in use."""
        self._others = {
            sender: heard_s for sender, heard_s in self._others.items() if now_s - heard_s < OTHERS_S
        }
        labels = {self.label(sender) for sender in self._others}
        return sorted(labels)

    def label(self, address: Address) -> str:
        """Return the IP address of a sender, with its port if another at this address is in use."""
        host, port = address
        if self.used is None or host != self.used[0]:
            return host
        if self.is_used(address):
            return host
        return f"{host}:{port}"


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
    sensor: str = Field(
        default="",
        description="the sensor that is used if several send: its IP address, the first if empty; or its "
        "name or number in messages, which are refused if empty",
    )

    @property
    def sensor_address(self) -> str:
        """Return `sensor` if it is an IP address, else `""`."""
        try:
            return str(ipaddress.ip_address(self.sensor))
        except ValueError:
            return ""

    @property
    def sensor_name(self) -> str:
        """Return `sensor` if it is a name in messages, else `""`."""
        return "" if self.sensor_address else self.sensor


class Decoder(ABC):
    """Reads the datagrams of one device, from its connection on."""

    problem: str = ""
    """Clause about the unreadable part of a partly readable datagram, or `""`. The owner resets it."""
    unused: str = ""
    """Clause about what arrives while there is no orientation, or `""`."""

    def __init__(self, sensors: SensorChoice) -> None:
        """Use one of the `sensors` that a sender names."""
        self.sensors = sensors
        self.passed_over = PassedOver()
        """Valid messages without anything that is read."""
        self.has_orientation = False
        """True if it has read an orientation or rates. The owner sets it."""

    @abstractmethod
    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the readings and events of a datagram that arrived at `stamp_ns`, if it has any.

        Raises:
            ContentError: If it cannot be read.
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
        port = set_option("imu-bridge", f"{name}.port", config.port % 65_535 + 1)
        remedy = f"end the program that has it, or use another port, here ({port}) and in the device's app"
        super().__init__(name, (config.host, config.port), clock, health, remedy=remedy)
        self._make_decoder = decoder
        self._decoders: dict[Address, Decoder] = {}
        """Decoders of the sender in use, or of those that have sent no reading yet."""
        self._senders = SenderChoice(config.sensor_address, excludes_rivals=True)
        self._is_chosen = config.sensor != ""
        self._sensors: dict[str, SensorChoice] = {}
        """Choices of senders by their IP address, which outlast a connection."""
        self._read_s: float | None = None
        """Time of the last reading, or None while out of reach."""
        self._bad_s: float | None = None
        self._bad_count = 0
        self._bad = ""

    async def _watch_sender(self) -> None:
        while True:
            self._report_warnings(asyncio.get_running_loop().time())
            await asyncio.sleep(STEP_S)

    def _is_used(self, address: Address) -> bool:
        return self._senders.is_used(address)

    def _process_datagram(self, data: bytes, address: Address, now_s: float) -> None:
        if not self._senders.may_use(address, now_s):
            return
        sender = self._senders.name(address)
        is_new = self._read_s is None or sender != self._senders.used
        decoder = self._decoders.get(sender) or self._new_decoder(sender)

        # Read it. A part that is unreadable is reported, and the rest used.
        items: Sequence[Item] = ()
        try:
            items = decoder.items(data, self._clock.now_ns())
        except ContentError as error:
            decoder.problem = str(error)
        if decoder.problem:
            self._bad_s = now_s
            self._bad = f"the last, from {address[0]}, {decoder.problem}"
            self._bad_count += 1
            decoder.problem = ""
        if not items:
            return

        # Use its sender, which the first items connect
        decoder.has_orientation = decoder.has_orientation or any(map(_is_motion, items))
        self._senders.use(sender, now_s)
        self._read_s = now_s
        if is_new:
            self._decoders = {sender: decoder}
            self._pass_on(Reconnected())
        for item in items:
            self._pass_on(item)

    def _unused_clause(self) -> str:
        """Return the clause about what arrives from a device that sends no orientation, or `""`."""
        for decoder in self._decoders.values():
            if decoder.unused and not decoder.has_orientation:
                return decoder.unused
        return ""

    def _new_decoder(self, sender: Address) -> Decoder:
        host = sender[0]
        decoder = self._make_decoder()
        if len(self._decoders) >= MAX_OTHERS:
            del self._decoders[next(iter(self._decoders))]
        if len(self._sensors) >= MAX_OTHERS:
            del self._sensors[next(iter(self._sensors))]
        decoder.sensors = self._sensors.setdefault(host, decoder.sensors)
        self._decoders[sender] = decoder
        return decoder

    def _report_warnings(self, now_s: float) -> None:
        used = self._senders.used
        host = "" if used is None else used[0]
        if self._bad_s is not None and now_s - self._bad_s > BAD_S:
            self._bad_s = None
            self._bad_count = 0

        # Several sensors in one stream: of the sender in use, or of those that may be used
        choices: Iterable[SensorChoice] = self._sensors.values()
        if host in self._sensors:
            choices = [self._sensors[host]]
        several = ""
        for choice in choices:
            several = several or choice.warning

        # The sender in use has fallen silent, unless a warning has the reason
        is_explained = several != "" or self._bad_s is not None
        if self._read_s is not None and now_s - self._read_s > LOST_S:
            self._read_s = None
            self._decoders.clear()
            reason = f"{host} sends nothing any more: check its app and its network"
            self._deliver(Disconnected("" if is_explained else reason))

        # a device out of reach is reported by `Disconnected`; one that sends its battery alone is not
        place = self._server.place
        unused = self._unused_clause()
        if unused:
            silence = f"UDP port {place} {unused}"
        else:
            silence = (
                f"no reading arrives at UDP port {place}: start the app and let it send to this machine"
                f"{self._only_here}"
            )
        sends_unused = unused != "" and self._read_s is not None
        is_known = host != "" and not sends_unused
        self._health.warn("silent", "" if is_known or is_explained else silence)
        self._health.warn("sensors", several)

        # Other senders matter only if none was named
        others = "" if self._is_chosen else ", ".join(self._senders.others(now_s))
        message = ""
        if others:
            message = (
                f"{others} sends to port {place}, too, and is not used: give the address of the wrist's by "
                f"{set_option('imu-bridge', f'{self._name}.sensor', 'ADDRESS')}, or another port in one of "
                f"the apps (one that was restarted is used after {RESTARTED_S:g} s)"
            )
        self._health.warn("others", message)
        message = ""
        if self._bad_s is not None:
            message = f"{self._bad_count} datagrams at port {place} could not be read; {self._bad}"
        self._health.warn("unreadable", message)
        self._warn_flood(host, now_s)
