"""The SlimeVR trackers that call: which one is used, which are answered, and which datagrams are late."""

from dataclasses import dataclass

from pointit.services.imu_bridge.network.sender_choice import REPLACED_S, SenderChoice
from pointit.services.imu_bridge.network.slimevr_protocol import Handshake, SlimevrDatagram
from pointit.services.imu_bridge.network.udp_server import Address

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
        firmware, place = self.handshake.firmware or "owoTrack", place or self.address[0]
        mac = self.handshake.mac
        return f"{mac} ({firmware} at {place})" if mac else f"{place} ({firmware})"

    def is_named(self, wanted: str) -> bool:
        """Return True if `wanted` is its MAC or its IP address."""
        return wanted in (self.handshake.mac, self.address[0])


@dataclass(frozen=True, slots=True)
class Admission:
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
        tracker = self._known.get(address)
        if tracker is None or tracker.handshake != handshake:
            tracker = SlimevrTracker(address, handshake, now_s, now_s, now_s)
            if address not in self._known and not self._has_room(tracker):
                return None
            self._known[address] = tracker
        tracker.newest_call_s = tracker.received_s = now_s
        if not self._may_be_used(tracker, now_s):
            tracker.is_answered = False
            return None
        used = self.used
        if used is tracker:
            self._senders.use(address, now_s)
        if used is not None and handshake.mac and handshake.mac == used.handshake.mac:
            tracker.number = used.number
        tracker.is_answered, tracker.has_sent = True, False
        tracker.called_s = now_s
        return tracker

    def admit(self, address: Address, datagram: SlimevrDatagram, now_s: float) -> Admission | None:
        """Return the use of a datagram, or None if it is late or not of the tracker in use."""
        tracker = self._known.get(address)
        if tracker is None or not tracker.is_answered:
            return None
        if not self._may_be_used(tracker, now_s):
            tracker.is_answered = False  # it misses the server, and calls again
            return None
        number, before = datagram.number, tracker.number
        is_first = not tracker.has_sent
        if number and not is_first and before - LATE <= number <= before:
            return None
        has_restarted = number < before and bool(number or is_first)
        is_reconnected = is_first or has_restarted or self.used is not tracker or self.is_lost
        keeps_yaw = number > before > 0 or (not is_first and not has_restarted and self.used is tracker)
        tracker.number = number or (0 if is_first else before)
        tracker.has_sent, tracker.received_s = True, now_s
        self.used, self.is_lost = tracker, False
        self._senders.use(address, now_s)
        return Admission(is_reconnected, is_reconnected and keeps_yaw)

    def step(self, now_s: float) -> bool:
        """Forget trackers that are gone. Return True if the one in use has just been lost."""
        for address, tracker in [*self._known.items()]:
            if tracker is not self.used and now_s - tracker.received_s > REPLACED_S:
                del self._known[address]
        if self.is_lost or self.used is None or now_s - self.used.received_s <= LOST_S:
            return False
        self.is_lost = True
        return True

    def answered(self, now_s: float) -> list[SlimevrTracker]:
        """Return the trackers that expect to hear from the server."""
        known = self._known.values()
        return [each for each in known if each.is_answered and now_s - each.received_s <= REPLACED_S]

    def others(self, now_s: float) -> list[str]:
        """Return the labels of trackers that have called for a while and that nobody answers."""
        return [
            tracker.label(self._senders.label(tracker.address))
            for tracker in self._known.values()
            if not tracker.is_answered
            and now_s - tracker.newest_call_s < CALLING_S
            and tracker.newest_call_s - tracker.called_s >= SILENT_S
        ]

    def _has_room(self, tracker: SlimevrTracker) -> bool:
        """Return True if `tracker` may be remembered. The one that is named always may."""
        if len(self._known) < MAX_CALLERS:
            return True
        if not (self._wanted and tracker.is_named(self._wanted)):
            return False
        rest = [each for each in self._known.values() if each is not self.used]
        del self._known[min(rest, key=lambda each: each.received_s).address]
        return True

    def _may_be_used(self, tracker: SlimevrTracker, now_s: float) -> bool:
        if self._wanted and not tracker.is_named(self._wanted):
            return False
        mac = tracker.handshake.mac
        is_same = self.used is not None and mac != "" and mac == self.used.handshake.mac
        return self._senders.may_use(tracker.address, now_s, SILENT_S if is_same else REPLACED_S)
