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
class _Pace:
    quickest_s: float
    came_s: float
    """Arrival of the last message, s (monotonic)."""
    late_since_s: float | None = None
    """Arrival of the first of the late messages in a row, s. None if the last message was in time."""
    in_time_s: float = 0.0
    """Arrival of the last message in time, s (monotonic), while later ones are late."""
    min_s: float = 0.0
    max_s: float = 0.0
    """Largest lateness since then, s."""


class LateMessageFilter:
    """Drops messages of one topic that are delayed by more than `LATE_S`, by name."""

    def __init__(self) -> None:
        self.refused = 0
        """Number of late messages dropped."""
        self.by_s = 0.0
        """Delay of the last one dropped relative to the fastest, s."""
        self._paces: dict[str, _Pace] = {}

    def accepts(self, name: str, age_s: float, now_s: float) -> bool:
        """Return True if a message of `name` comes in time.

        `age_s`: arrival minus stamp, s; the two clocks may differ. `now_s`: arrival, s (monotonic).
        """
        pace = self._paces.get(name)
        if pace is None:
            self._paces[name] = _Pace(age_s, now_s)
            return True
        silent_s, pace.came_s = now_s - pace.came_s, now_s
        # without `min`: its call would cost as much as the rest of this function
        usual_s = pace.quickest_s + (FOLLOWS * silent_s if silent_s < GAP_S else MAX_FOLLOWED_SILENCE_S)
        if age_s <= usual_s + LATE_S and silent_s <= FORGOTTEN_S:
            pace.quickest_s = usual_s
            if age_s < usual_s:
                pace.quickest_s = age_s
            pace.late_since_s = None
            return True
        if pace.late_since_s is None:
            pace.in_time_s = now_s - silent_s
        if now_s - pace.in_time_s > FORGOTTEN_S or self._is_steady(pace, age_s, now_s, silent_s):
            self._paces[name] = _Pace(age_s, now_s)
            return True
        self.refused += 1
        self.by_s = age_s - pace.quickest_s
        return False

    @staticmethod
    def _is_steady(pace: _Pace, age_s: float, now_s: float, silent_s: float) -> bool:
        min_s, max_s = min(pace.min_s, age_s), max(pace.max_s, age_s)
        if pace.late_since_s is None or silent_s > STALL_S or max_s - min_s > SPREAD_S:
            pace.late_since_s, pace.min_s, pace.max_s = now_s, age_s, age_s
            return False
        pace.min_s, pace.max_s = min_s, max_s
        return now_s - pace.late_since_s >= STEADY_S


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
        newest.stamp_ns, newest.came_s = stamp_ns, now_s
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
        by = f"{abs(self.ahead_s) * 1e3:.0f} ms" if abs(self.ahead_s) < 1 else f"{abs(self.ahead_s):.1f} s"
        way = "ahead of" if self.ahead_s > 0 else "behind"
        unless = "" if self.ahead_s > 0 else ", unless its link alone has this delay"
        what = (
            "samples that cross the two are refused as too old or of the future"
            if self.exceeds_limit
            else "latency figures of what crosses the two are wrong by as much"
        )
        clock = f"the clock of machine {self.host}"
        clock = f"the services of {self.claimant} say that {clock}" if self.claimant else clock
        return f"{clock} is {by} {way} the clock of {here}{unless}: {what}"


class ClockSkewMonitor:
    """Estimates clock skew by host from the stamps and arrival times of reports.

    A person's services may forge both: what only one person's say of a machine is their claim, and of the
    machines of others nothing.
    """

    def __init__(self, here: str, window_s: float = WINDOW_S) -> None:
        """Set the name of this machine, and the time for which a report counts."""
        self.here = here
        self._window_s = window_s
        self._late: dict[tuple[str, str], collections.deque[tuple[float, float]]] = {}
        """Arrivals of reports (s, monotonic) with their delays since their stamps (s), by host and person."""

    def on_report(self, host: str, stamp_ns: int, arrived_ns: int, now_s: float, person: str = "") -> None:
        """Add a report with its stamp and arrival (wall time, Unix ns). `now_s` is the monotonic time.

        `person`: whose service it is of, or `""`.
        """
        key = one_line(host, LONGEST_HOST), person
        late = self._late.get(key)
        if late is None:
            if len(self._late) >= MAX_HOSTS:
                self._late.pop(min(self._late, key=lambda name: self._late[name][-1][0]))
            late = self._late[key] = collections.deque(maxlen=4096)
        late.append((now_s, (arrived_ns - stamp_ns) / 1e9))

    def skews(self, now_s: float) -> Iterator[ClockSkew]:
        """Yield the machines whose clocks differ from this one's by `APART_S` and more."""
        for key, late in list(self._late.items()):
            while late and now_s - late[0][0] > self._window_s:
                late.popleft()
            if not late:
                del self._late[key]
        own = max(0.0, min((value for _, value in self._late.get((self.here, ""), ())), default=0.0))
        by_host: dict[str, list[ClockSkew]] = collections.defaultdict(list)
        for (host, person), late in sorted(self._late.items()):
            is_known = bool(person) and (host, "") in self._late  # a shared service tells it
            ahead_s = _ahead_s(sorted(value for _, value in late), own)
            if host != self.here and ahead_s and not is_known:
                by_host[host].append(ClockSkew(host=host, ahead_s=ahead_s, claimant=person))
        for skews in by_host.values():  # what two people say is no claim of one
            yield replace(skews[0], claimant="") if len(skews) > 1 else skews[0]


def _ahead_s(values: list[float], own_s: float) -> float:
    """Return by how much the clock with the sorted delays `values` is ahead, s, 0 if that is not sure."""
    behind_s = values[0] - own_s
    if values[0] <= -APART_S and len(values) >= MIN_AHEAD:
        return -values[0]
    return -behind_s if behind_s >= APART_S and _is_sure([value - own_s for value in values]) else 0.0


def _is_sure(values: list[float]) -> bool:
    """Return True if delays alone cannot explain the sorted `values`, s."""
    if len(values) < (MIN_REFUSED if values[0] >= REFUSED_S else MIN_STEADY):
        return False
    share = MANY_STEADY if len(values) >= MIN_BEHIND else STEADY
    return values[len(values) // 2] - values[0] <= share * values[0]
