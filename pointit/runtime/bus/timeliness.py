"""Timing of messages: stamps in the future, order, lateness and clock skew. Pure functions.

The clocks of two machines are not comparable, but a message arrives after it was stamped. After packet loss,
TCP delivers a burst of old messages in order. Acting on them would act where a person pointed seconds ago. So
lateness is measured relative to the fastest recent message of the same writer. A delay that stays constant
for `STEADY_S` is accepted: its clock was set back, or the link has become slow for good.

A stamp in the future proves that the writer's clock is ahead. One in the past means that it is behind or that
the message took long. Delays vary, so the fastest of many reports counts, less what reports of this machine
to itself take. A link that delays everything by `APART_S` and more looks like a clock that is behind.
"""

import collections
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from pointit.schemas import NS_PER_S
from pointit.schemas.text import one_line
from pointit.schemas.topics import CURSOR, HOVER, IMU, OBJECTS, RAY, Topic

STREAMS: frozenset[Topic[Any]] = frozenset((IMU, RAY, CURSOR, HOVER, OBJECTS))
"""Topics with one writer at a time per name, which stamps with one clock."""

# Future

MAX_AHEAD_NS = NS_PER_S
"""Maximum lead of a stamp over this clock, ns. A larger one would make all later messages look late."""

# Order

OLD_NS = NS_PER_S // 2
"""Age relative to the newest message, ns, above which a message is out of order. Below, it is only late."""
MAX_LEAD_NS = 2 * NS_PER_S
"""Maximum lead of a new newest message over the last, ns. Beyond it, the clock may have jumped."""
SILENT_S = 1.0
"""If no message has followed the newest for this long (s), the clock was set or the writer changed."""

# Lateness

LATE_S = 0.3
"""Maximum delay relative to the fastest recent message, s. Later messages are dropped."""
STEADY_S = 1.5
"""A delay that is constant for this long (s) is accepted."""
SPREAD_S = 0.2
"""Maximum spread of delays that counts as constant, s."""
FORGOTTEN_S = 20.0
"""The reference delay is reset if every message was late for this long (s)."""
FOLLOWS = 0.05
"""Rate at which the reference delay grows, s/s, to follow clocks that drift and are slewed."""
GAP_S = 0.1
"""Maximum silence that contributes to that growth, s."""
MAX_FOLLOWED_SILENCE_S = FOLLOWS * GAP_S
STALL_S = 0.5
"""After a silence this long (s), the measurement of a constant delay starts again."""

# Clock skew

APART_S = 0.05
"""Clock skew from which latencies between machines are unreliable, s."""
REFUSED_S = 1.0
"""Clock skew from which samples are refused as too old or from the future, s."""
WINDOW_S = 20.0
"""Time for which the fastest report counts, s. A corrected clock is recognised after that time."""
MIN_AHEAD = 2
"""Number of reports needed to call a clock ahead."""
MIN_BEHIND = 8
"""Number of reports from which `MANY_STEADY` applies."""
MIN_STEADY = 3
MIN_REFUSED = 2
"""Numbers of steady reports needed to call a clock behind. The second applies from a skew of `REFUSED_S`."""
STEADY = 0.25
MANY_STEADY = 1.0
"""Reports are steady if half of them differ from the fastest by less than this share of its delay. Delays
under load are not: the fastest of many is late, and half of them much later."""
MAX_HOSTS = 256
"""Maximum number of machines, which bounds memory."""
LONGEST_HOST = 64
"""Maximum characters of a machine's name that are compared and shown, since unknown peers may write it."""
REMEDY = "synchronize both by NTP: `timedatectl set-ntp true`, or chrony on a site without internet"


@dataclass(slots=True)
class _Delay:
    """Delays of the messages of one name. All times are monotonic, s."""

    fastest_s: float
    """Reference: delay of the fastest recent message, which follows clocks that drift."""
    last_arrival_s: float
    late_since_s: float | None = None
    """Arrival of the first of the late messages in a row. None if the last message was in time."""
    last_in_time_s: float = 0.0
    """Arrival of the last message in time, while later ones are late."""
    min_late_s: float = 0.0
    max_late_s: float = 0.0
    """Range of the delays since `late_since_s`."""


class LateMessageFilter:
    """Drops messages of one topic that are delayed by more than `LATE_S`, by name."""

    def __init__(self) -> None:
        self.refused = 0
        """Number of late messages dropped."""
        self.by_s = 0.0
        """Delay of the last one dropped relative to the fastest, s."""
        self._delays: dict[str, _Delay] = {}

    def accepts(self, name: str, age_s: float, now_s: float) -> bool:
        """Return True if a message of `name` comes in time.

        `age_s`: arrival minus stamp, s; the two clocks may differ. `now_s`: arrival, s (monotonic).
        """
        delay = self._delays.get(name)
        if delay is None:
            self._delays[name] = _Delay(age_s, now_s)
            return True
        silent_s = now_s - delay.last_arrival_s
        delay.last_arrival_s = now_s

        # The reference grows with time, at most over a gap. Without `min`: its call would cost as much as the
        # rest of this function.
        if silent_s < GAP_S:
            reference_s = delay.fastest_s + FOLLOWS * silent_s
        else:
            reference_s = delay.fastest_s + MAX_FOLLOWED_SILENCE_S

        if age_s <= reference_s + LATE_S and silent_s <= FORGOTTEN_S:
            delay.fastest_s = reference_s
            if age_s < reference_s:
                delay.fastest_s = age_s
            delay.late_since_s = None
            return True

        # It is late. A delay that has been constant, or late for very long, is the new reference.
        if delay.late_since_s is None:
            delay.last_in_time_s = now_s - silent_s
        is_forgotten = now_s - delay.last_in_time_s > FORGOTTEN_S
        if is_forgotten or self._is_steady(delay, age_s, now_s, silent_s):
            self._delays[name] = _Delay(age_s, now_s)
            return True
        self.refused += 1
        self.by_s = age_s - delay.fastest_s
        return False

    @staticmethod
    def _is_steady(delay: _Delay, age_s: float, now_s: float, silent_s: float) -> bool:
        """Return True if the late messages of the last `STEADY_S` had the same delay."""
        min_s = min(delay.min_late_s, age_s)
        max_s = max(delay.max_late_s, age_s)
        has_changed = silent_s > STALL_S or max_s - min_s > SPREAD_S
        if delay.late_since_s is None or has_changed:
            delay.late_since_s = now_s
            delay.min_late_s = age_s
            delay.max_late_s = age_s
            return False
        delay.min_late_s = min_s
        delay.max_late_s = max_s
        return now_s - delay.late_since_s >= STEADY_S


@dataclass(slots=True)
class NewestMessage:
    """The newest message of a name."""

    stamp_ns: int
    came_s: float
    """Arrival, s (monotonic)."""


class OutOfOrderFilter:
    """Drops messages of one topic that are older than the newest by more than `OLD_NS`, by name."""

    def __init__(self) -> None:
        self.refused = 0
        """Number of out-of-order messages dropped."""
        self.newest: dict[str, NewestMessage] = {}
        """By name. `accepts` is not needed for a message that is ahead by up to `MAX_LEAD_NS`."""

    def accepts(self, name: str, stamp_ns: int, now_s: float) -> bool:
        """Return True if a message of `name` is in order. `now_s` is its arrival (monotonic)."""
        newest = self.newest.get(name)
        if newest is None:
            self.newest[name] = NewestMessage(stamp_ns, now_s)
            return True
        ahead_ns = stamp_ns - newest.stamp_ns
        if not 0 <= ahead_ns <= MAX_LEAD_NS and now_s - newest.came_s <= SILENT_S:
            if ahead_ns < -OLD_NS:
                self.refused += 1
                return False
            return True  # only this reader rejects it; the entry of the others stays
        newest.stamp_ns = stamp_ns
        newest.came_s = now_s
        return True

    def active_names(self, since_s: float) -> set[str]:
        """Return the names whose newest message came after `since_s` (monotonic)."""
        return {name for name, newest in self.newest.items() if newest.came_s > since_s}


@dataclass(frozen=True, kw_only=True)
class ClockSkew:
    """Difference between a machine's clock and this one's."""

    host: str
    ahead_s: float
    """Lower bound if positive. If negative, the clock is behind by at most this."""
    claimant: str = ""
    """The person whose services alone say that they run there, or `""`."""

    @property
    def exceeds_limit(self) -> bool:
        """Return True if samples are refused because of it."""
        return abs(self.ahead_s) >= REFUSED_S

    def sentence(self, here: str) -> str:
        """Return a description of the difference, as seen from the machine `here`."""
        amount_s = abs(self.ahead_s)
        amount = f"{amount_s:.1f} s"
        if amount_s < 1:
            amount = f"{amount_s * 1e3:.0f} ms"
        direction = "ahead of"
        exception = ""
        if self.ahead_s <= 0:
            direction = "behind"
            exception = ", unless only its link is delayed"
        effect = "latencies measured between the two are wrong by as much"
        if self.exceeds_limit:
            effect = "samples between the two are refused as too old or from the future"
        clock = f"the clock of machine {self.host}"
        if self.claimant:
            clock = f"the services of {self.claimant} say that {clock}"
        return f"{clock} is {amount} {direction} the clock of {here}{exception}: {effect}"


class ClockSkewMonitor:
    """Estimates clock skew by host from the stamps and arrival times of reports.

    A person's services may forge both: what only one person's say of a machine is their claim, and of the
    machines of others nothing.
    """

    def __init__(self, here: str, window_s: float = WINDOW_S) -> None:
        """Set the name of this machine, and the time for which a report counts."""
        self.here = here
        self._window_s = window_s
        self._reports: dict[tuple[str, str], collections.deque[tuple[float, float]]] = {}
        """Arrivals of reports (s, monotonic) with their delays since their stamps (s), by host and person."""

    def on_report(self, host: str, stamp_ns: int, arrived_ns: int, now_s: float, person: str = "") -> None:
        """Add a report with its stamp and arrival (wall time, Unix ns). `now_s` is the monotonic time.

        `person`: whose service it is of, or `""`.
        """
        key = one_line(host, LONGEST_HOST), person
        reports = self._reports.get(key)
        if reports is None:
            if len(self._reports) >= MAX_HOSTS:
                self._forget_most_silent()
            reports = collections.deque(maxlen=4096)
            self._reports[key] = reports
        delay_s = (arrived_ns - stamp_ns) / 1e9
        reports.append((now_s, delay_s))

    def skews(self, now_s: float) -> Iterator[ClockSkew]:
        """Yield the machines whose clocks differ from this one's by `APART_S` and more."""
        self._forget_old(now_s)
        own_s = max(0.0, min(self._delays_s(self.here, ""), default=0.0))

        # A person's claim counts for machines of which no shared service reports.
        skews_of: dict[str, list[ClockSkew]] = collections.defaultdict(list)
        for host, person in sorted(self._reports):
            if host == self.here:
                continue
            if person and (host, "") in self._reports:
                continue
            ahead_s = _ahead_s(sorted(self._delays_s(host, person)), own_s)
            if ahead_s:
                skews_of[host].append(ClockSkew(host=host, ahead_s=ahead_s, claimant=person))
        for skews in skews_of.values():
            if len(skews) > 1:  # what two people say is no claim of one
                yield replace(skews[0], claimant="")
            else:
                yield skews[0]

    def _delays_s(self, host: str, person: str) -> list[float]:
        reports = self._reports.get((host, person), ())
        return [delay_s for _, delay_s in reports]

    def _forget_old(self, now_s: float) -> None:
        for key, reports in list(self._reports.items()):
            while reports and now_s - reports[0][0] > self._window_s:
                reports.popleft()
            if not reports:
                del self._reports[key]

    def _forget_most_silent(self) -> None:
        def last_arrival_s(key: tuple[str, str]) -> float:
            return self._reports[key][-1][0]

        del self._reports[min(self._reports, key=last_arrival_s)]


def _ahead_s(delays_s: list[float], own_s: float) -> float:
    """Return by how much the clock with the sorted `delays_s` is ahead, s, 0 if that is not sure."""
    fastest_s = delays_s[0]
    if fastest_s <= -APART_S and len(delays_s) >= MIN_AHEAD:
        return -fastest_s
    behind_s = fastest_s - own_s
    if behind_s < APART_S:
        return 0.0
    excess_s = [delay_s - own_s for delay_s in delays_s]
    return -behind_s if _is_sure(excess_s) else 0.0


def _is_sure(excess_s: list[float]) -> bool:
    """Return True if delays alone cannot explain the sorted `excess_s` over this machine's own."""
    count = len(excess_s)
    fastest_s = excess_s[0]
    needed = MIN_REFUSED if fastest_s >= REFUSED_S else MIN_STEADY
    if count < needed:
        return False
    share = MANY_STEADY if count >= MIN_BEHIND else STEADY
    median_s = excess_s[count // 2]
    return median_s - fastest_s <= share * fastest_s
