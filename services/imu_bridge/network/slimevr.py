"""SlimeVR trackers: ESP32 boards, owoTrack, Joy-Con, and all that speaks as they do; and their search.

No core: it waits for datagrams.
"""

import asyncio
import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import Field, field_validator

from pointit.runtime.address_config import AddressConfig
from pointit.runtime.clock import Clock
from pointit.runtime.config.parameters import set_option
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.service.plugin_guard import HealthSink
from pointit.schemas import Feedback
from pointit.services.imu_bridge.network import slimevr_protocol as protocol
from pointit.services.imu_bridge.network.datagram_source import REPLACED_S, SenderChoice
from pointit.services.imu_bridge.network.slimevr_protocol import Handshake, SlimevrDatagram
from pointit.services.imu_bridge.network.udp_server import ANY_HOST, Address, PortSource, receive_shared
from pointit.services.imu_bridge.sources import (
    Battery,
    Disconnected,
    ImuSource,
    Item,
    Press,
    Reading,
    Reconnected,
    Signal,
)
from pointit.services.imu_bridge.streams import PassedOver

MAX_CALLERS = 16
"""Trackers that are remembered at the same time; further ones are ignored."""
SILENT_S = 1.0
"""Time without a datagram after which a tracker may be answered at another address."""
LOST_S = 3.0
"""Time without a datagram after which a tracker is out of reach. Trackers wait as long for the server."""
CALLING_S = 5.0
"""Time after its last handshake for which a tracker counts as calling."""
LATE = 100
"""Numbers by which a datagram may be late. A tracker whose numbers fall by more was restarted."""

KEEP_ALIVE = 0
"""Kind of the packets without content by which a tracker shows that it is there."""
TAKEN = (
    "end the program that has it, such as a SlimeVR server, or use another port, here "
    f"({set_option('imu-bridge', 'slimevr.port', protocol.PORT + 1)}) and in the tracker's app"
)
MAX_FOUND = 64
BAD_S = 10.0
"""Time for which packets that cannot be read are reported, s."""
STEP_S = 0.4
"""Period of heartbeats, s. Trackers drop a server that is silent for 3 s; it also sends pings."""
_MAC = re.compile(r"[0-9A-F]{2}(:[0-9A-F]{2}){5}\Z")


@dataclass(slots=True)
class SlimevrTracker:
    """A tracker that called."""

    address: Address
    handshake: Handshake
    called_s: float
    """Time of its first handshake without an answer, s."""
    newest_call_s: float
    received_s: float
    is_answered: bool = False
    has_sent: bool = False
    """True if it has sent a datagram since its handshake."""
    number: int = 0
    """Number of its newest datagram, or 0 if it counts none."""

    @property
    def identity(self) -> str:
        """Return its MAC, or its IP address if it has none of its own."""
        return self.handshake.mac or self.address[0]

    def label(self, place: str = "") -> str:
        """Return its MAC if it has one of its own, its firmware and its `place`, for people."""
        firmware = self.handshake.firmware or "owoTrack"
        place = place or self.address[0]
        mac = self.handshake.mac
        return f"{mac} ({firmware} at {place})" if mac else f"{place} ({firmware})"

    def is_named(self, wanted: str) -> bool:
        """Return True if `wanted` is its MAC or its IP address."""
        return wanted in (self.handshake.mac, self.address[0])


@dataclass(frozen=True, slots=True)
class AdmittedDatagram:
    """Verdict on a datagram of the tracker in use."""

    is_reconnected: bool = False
    """True if it is the first one after a loss or a handshake."""
    keeps_yaw: bool = False
    """True if the numbers ran on, so that the tracker was not restarted meanwhile."""


class SlimevrTrackers:
    """Chooses the tracker of one person among those that call."""

    def __init__(self, wanted: str = "") -> None:
        """Use the tracker with the MAC or IP address `wanted`, or the first that sends if it is `""`."""
        self._wanted = wanted
        self._known: dict[Address, SlimevrTracker] = {}
        self._senders = SenderChoice()
        self.used: SlimevrTracker | None = None
        """The tracker whose datagrams are used, or None."""
        self.is_lost = True
        """True if there is none, or if it is out of reach."""

    def called(self, address: Address, handshake: Handshake, now_s: float) -> SlimevrTracker | None:
        """Return the tracker if it is to be answered, else None."""
        # Remember who calls. Another handshake at an address is another tracker.
        tracker = self._known.get(address)
        if tracker is None or tracker.handshake != handshake:
            tracker = SlimevrTracker(address, handshake, now_s, now_s, now_s)
            if address not in self._known and not self._has_room(tracker):
                return None
            self._known[address] = tracker
        tracker.newest_call_s = tracker.received_s = now_s

        # Answer the one that may be used. The same board at a new address counts on from its last number.
        if not self._may_be_used(tracker, now_s):
            tracker.is_answered = False
            return None
        used = self.used
        if used is tracker:
            self._senders.use(address, now_s)
        if used is not None and handshake.mac:
            if handshake.mac == used.handshake.mac:
                tracker.number = used.number
        tracker.is_answered = True
        tracker.has_sent = False
        tracker.called_s = now_s
        return tracker

    def admit(self, address: Address, datagram: SlimevrDatagram, now_s: float) -> AdmittedDatagram | None:
        """Return the use of a datagram, or None if it is late or not of the tracker in use."""
        tracker = self._known.get(address)
        if tracker is None or not tracker.is_answered:
            return None
        if not self._may_be_used(tracker, now_s):
            tracker.is_answered = False  # it misses the server, and calls again
            return None

        # Drop late ones. A number that falls by more is that of a tracker that was restarted.
        number = datagram.number
        previous = tracker.number
        is_first = not tracker.has_sent
        is_late = number != 0 and previous - LATE <= number <= previous
        if is_late and not is_first:
            return None

        # One without a number says nothing of a restart, unless it is the first
        is_counted = number != 0 or is_first
        has_restarted = is_counted and number < previous
        runs_on = not is_first and not has_restarted
        goes_on = runs_on and self.used is tracker
        is_reconnected = not goes_on or self.is_lost
        keeps_yaw = number > previous > 0 or goes_on

        # A datagram without a number leaves the last one
        if is_counted:
            tracker.number = number
        tracker.has_sent = True
        tracker.received_s = now_s
        self.used = tracker
        self.is_lost = False
        self._senders.use(address, now_s)
        return AdmittedDatagram(is_reconnected, is_reconnected and keeps_yaw)

    def step(self, now_s: float) -> bool:
        """Forget trackers that are gone. Return True if the one in use has just been lost."""
        for address, tracker in [*self._known.items()]:
            if tracker is not self.used and now_s - tracker.received_s > REPLACED_S:
                del self._known[address]
        used = self.used
        if self.is_lost or used is None:
            return False
        if now_s - used.received_s <= LOST_S:
            return False
        self.is_lost = True
        return True

    def answered(self, now_s: float) -> list[SlimevrTracker]:
        """Return the trackers that expect to hear from the server."""
        trackers: list[SlimevrTracker] = []
        for tracker in self._known.values():
            is_within_reach = now_s - tracker.received_s <= REPLACED_S
            if tracker.is_answered and is_within_reach:
                trackers.append(tracker)
        return trackers

    def others(self, now_s: float) -> list[str]:
        """Return the labels of trackers that have called for a while and that nobody answers."""
        labels: list[str] = []
        for tracker in self._known.values():
            if tracker.is_answered:
                continue
            is_calling = now_s - tracker.newest_call_s < CALLING_S
            waiting_s = tracker.newest_call_s - tracker.called_s
            if is_calling and waiting_s >= SILENT_S:
                labels.append(tracker.label(self._senders.label(tracker.address)))
        return labels

    def _has_room(self, tracker: SlimevrTracker) -> bool:
        """Return True if `tracker` may be remembered. The one that is named always may."""
        if len(self._known) < MAX_CALLERS:
            return True
        if not (self._wanted and tracker.is_named(self._wanted)):
            return False
        unused = [known for known in self._known.values() if known is not self.used]
        oldest = min(unused, key=lambda known: known.received_s)
        del self._known[oldest.address]
        return True

    def _may_be_used(self, tracker: SlimevrTracker, now_s: float) -> bool:
        if self._wanted and not tracker.is_named(self._wanted):
            return False
        mac = tracker.handshake.mac
        has_mac_in_use = self.used is not None and mac == self.used.handshake.mac
        timeout_s = REPLACED_S
        if mac and has_mac_in_use:  # the same board, at another address
            timeout_s = SILENT_S
        return self._senders.may_use(tracker.address, now_s, timeout_s)


async def discover(seconds: float) -> Sequence[FoundDevice]:
    """Return the trackers that call, without an answer to any. Those connected to a server do not call.

    Raises:
        ConfigError: If the port is taken by a program that does not share it.
    """
    devices: dict[str, FoundDevice] = {}

    def on_datagram(data: bytes, address: Address) -> None:
        if len(devices) >= MAX_FOUND:
            return
        datagram = protocol.decode(data)
        handshake = None if datagram is None else datagram.packet
        if not isinstance(handshake, protocol.Handshake):
            return
        tracker = SlimevrTracker(address, handshake, 0.0, 0.0, 0.0)
        details = {"ip": address[0], "firmware": handshake.firmware, "board": float(handshake.board)}
        label = f"{tracker.label()}; {set_option('imu-bridge', 'slimevr.host', ANY_HOST)}"
        devices[tracker.identity] = FoundDevice(tracker.identity, label, details)

    await receive_shared(protocol.PORT, seconds, on_datagram, remedy=TAKEN)
    return [devices[identity] for identity in sorted(devices)]


class SlimevrConfig(AddressConfig):
    """A SlimeVR tracker."""

    tracker: str = Field(
        default="",
        description="its MAC address (AA:BB:CC:DD:EE:FF) or IP address; the first that calls if empty",
    )
    sensor: int = Field(
        default=0, ge=0, le=254, description="number of the sensor, for trackers that have several"
    )
    host: str = Field(
        default="127.0.0.1",
        description="address to listen at: 127.0.0.1 is this machine alone, 0.0.0.0 all of its networks; "
        "each program that can send there can move the wrist, since the protocol has no passwords",
    )
    port: int = Field(
        default=protocol.PORT,
        ge=1,
        le=65535,
        description="UDP port; boards always call at 6969 and people share it, while apps that are told an "
        "address (owoTrack) need another port for each person of this machine",
    )

    @field_validator("tracker")
    @classmethod
    def _address(cls, value: str) -> str:
        mac = value.upper().replace("-", ":")
        if not value or _MAC.match(mac):
            return mac
        try:
            return str(ipaddress.ip_address(value))
        except ValueError as error:
            raise ValueError(
                "must be a MAC address like AA:BB:CC:DD:EE:FF or an IP address; leave it empty for the first "
                "tracker that calls"
            ) from error


class SlimevrSource(PortSource):
    """Answers the tracker of one person, and passes its readings on."""

    def __init__(self, config: SlimevrConfig, clock: Clock, health: HealthSink) -> None:
        super().__init__("slimevr", (config.host, config.port), clock, health, remedy=TAKEN, is_shared=True)
        self._config = config
        self._trackers = SlimevrTrackers(config.tracker)
        self._battery: Battery | None = None
        self._sensors: set[int] = set()
        self.passed_over = PassedOver()
        """Packets of other kinds than those that are read."""
        self._pinged_s = 0.0
        self._pings = 0
        self._unreadable = 0
        self._unreadable_s = 0.0

    def cue(self, cue: Feedback) -> None:
        """Make the phone or watch vibrate."""
        used = self._trackers.used
        if used is None or self._trackers.is_lost:
            return
        if not used.handshake.is_owotrack:
            return
        on_s = 0.0
        for number, duration_ms in enumerate(cue.haptic_ms):
            if number % 2 == 0:  # on
                data = protocol.vibration(duration_ms / 1000)
                asyncio.get_running_loop().call_later(on_s, self._send, data, used)
            on_s += duration_ms / 1000

    async def _watch_sender(self) -> None:
        """Keep the connection alive and report warnings."""
        while True:
            now_s = asyncio.get_running_loop().time()
            if self._trackers.step(now_s) and self._trackers.used is not None:
                self._sensors.clear()
                self._health.set_metric("round trip", None)
                self._deliver(
                    Disconnected(
                        f"the SlimeVR tracker {self._trackers.used.label()} is out of reach: bring it "
                        "nearer, or charge it"
                    )
                )

            # Keep those alive that are answered, and measure the way there and back
            self._pings += 1
            self._pinged_s = now_s
            answered = self._trackers.answered(now_s)
            self._server.disconnect_others([tracker.address for tracker in answered])
            for tracker in answered:
                self._send(protocol.HEARTBEAT_DATAGRAM, tracker)
                self._send(protocol.ping(self._pings), tracker)
            self._report_warnings(now_s)
            await asyncio.sleep(STEP_S)

    def _is_used(self, address: Address) -> bool:
        used = self._trackers.used
        return used is not None and used.address == address

    def _process_datagram(self, data: bytes, address: Address, now_s: float) -> None:
        datagram = protocol.decode(data)
        if datagram is None:
            return

        # A call is answered, if its tracker is the one in use
        if isinstance(datagram.packet, protocol.Handshake):
            tracker = self._trackers.called(address, datagram.packet, now_s)
            if tracker is not None:
                self._server.connect(address)
                self._send(protocol.HANDSHAKE_ANSWER, tracker)
            return

        # All else counts only from the tracker in use
        admission = self._trackers.admit(address, datagram, now_s)
        used = self._trackers.used
        if admission is None or used is None:
            return
        if admission.is_reconnected:
            self._pass_on(Reconnected(keeps_yaw=admission.keeps_yaw))
            self._battery = None
        if not datagram.is_readable:
            self._unreadable += 1
            self._unreadable_s = now_s
        elif datagram.packet is None and datagram.kind != KEEP_ALIVE:
            self.passed_over.add(f"kind {datagram.kind}")
        item = self._process_packet(datagram.packet, used, now_s)
        if item is not None:
            self._pass_on(item)

    def _process_packet(
        self, packet: protocol.Packet | None, used: SlimevrTracker, now_s: float
    ) -> Item | None:
        stamp_ns = self._clock.now_ns()
        match packet:
            case protocol.Rotation(sensor, orientation_xyzw):
                self._sensors.add(sensor)
                return Reading(stamp_ns, orientation_xyzw) if sensor == self._config.sensor else None
            case protocol.SlimevrButton(gesture):
                return Press(stamp_ns, gesture)
            case Battery():
                previous = self._battery
                self._battery = packet
                return packet if packet != previous else None
            case Signal():
                return packet
            case _:
                self._answer_packet(packet, used, now_s)
                return None

    def _answer_packet(self, packet: protocol.Packet | None, used: SlimevrTracker, now_s: float) -> None:
        match packet:
            case protocol.SensorInfo(sensor, status):
                self._send(protocol.sensor_answer(packet), used)
                if sensor == self._config.sensor:
                    self._warn_sensor("reports an error" if status == 2 else "")
            case protocol.SensorFault(sensor, number):
                if sensor in (self._config.sensor, protocol.WHOLE_TRACKER):
                    self._warn_sensor(f"reports the error {number}")
            case protocol.FlagsRequest():
                self._send(protocol.FLAGS_ANSWER, used)
            case protocol.Pong(number) if number == self._pings:
                self._health.set_metric("round trip", 1000 * (now_s - self._pinged_s), "ms")
            case _:
                pass

    def _send(self, data: bytes, tracker: SlimevrTracker) -> None:
        self._server.send(data, tracker.address)

    def _warn_sensor(self, clause: str) -> None:
        message = ""
        if clause:
            message = f"the tracker's sensor {self._config.sensor} {clause}: switch it off and on"
        self._health.warn("sensor", message)

    def _report_warnings(self, now_s: float) -> None:
        # The wanted tracker does not call, or others do
        others = ", ".join(self._trackers.others(now_s))
        calling = ""
        if others:
            calling = (
                f"; these call and are not assigned: {others} (slimevr.tracker names one; another person's "
                "app needs another slimevr.port)"
            )
        missing = ""
        if self._trackers.used is None:  # later, `Disconnected` reports it
            wanted = self._config.tracker or "any SlimeVR tracker"
            missing = (
                f"nothing from {wanted} at UDP port {self._server.place}: switch it on and give its app the "
                f"address of this machine and a port that no other person's app has{self._only_here}"
            )
        self._health.warn("tracker", f"{missing}{calling}".removeprefix("; "))

        # It sends, but not the rotations of the configured sensor
        sensors = sorted(self._sensors)
        message = ""
        if sensors and self._config.sensor not in self._sensors:
            option = set_option("imu-bridge", "slimevr.sensor", sensors[0])
            numbers = ", ".join(map(str, sensors))
            message = f"the tracker has no sensor {self._config.sensor}, but {numbers}: {option}"
        self._health.warn("number", message)
        sends_none = not self._sensors and not self._trackers.is_lost
        message = ""
        if sends_none and self.passed_over.count > 0:
            message = (
                f"the tracker sends packets without a rotation ({self.passed_over.text}): update its firmware"
            )
        self._health.warn("kinds", message)

        # It sends what cannot be read
        if now_s - self._unreadable_s > BAD_S:
            self._unreadable = 0
        message = ""
        if self._unreadable:
            message = (
                f"{self._unreadable} packets of the tracker are cut off or have numbers without sense, such "
                "as NaN: update its firmware"
            )
        self._health.warn("unreadable", message)
        self._warn_flood("the tracker", now_s)


SLIMEVR = ImuSource(
    summary="a SlimeVR tracker: ESP32 boards, owoTrack on phones and watches, Joy-Con",
    config=SlimevrConfig,
    make=lambda config, around: SlimevrSource(config, around.clock, around.health),
    argument="tracker",
    argument_optional=True,
    example="AA:BB:CC:DD:EE:FF",
    discover=discover,
)
