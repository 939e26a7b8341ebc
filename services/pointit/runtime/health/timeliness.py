"""Filters that drop late and out-of-order messages; pure.

After packet loss, TCP delivers a burst of old messages in order. Acting on them would act where a person
pointed seconds ago. The clocks of two machines are not comparable, so lateness is measured relative to the
fastest recent message of the same writer. A delay that stays constant for `STEADY_S` is accepted: its
clock was set back, or the link has become slow for good.
"""

from dataclasses import dataclass

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import CURSOR, HOVER, IMU, OBJECTS, RAY

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

STALL_S = 0.5
"""After a silence this long (s), the measurement of a constant delay starts again."""

STREAMS: frozenset[AnyTopic] = frozenset((IMU, RAY, CURSOR, HOVER, OBJECTS))
"""Topics with one writer at a time per name, which stamps with one clock."""

OLD_NS = NS_PER_S // 2
"""Messages older than the newest by more (ns) are out of order. Younger ones are merely late."""

STRAY_NS = 2 * NS_PER_S
"""A message ahead of the newest by more (ns) does not become the newest: its clock may have jumped."""

SILENT_S = 1.0
"""If no message has followed the newest for this long (s), the clock was set or the writer changed."""


@dataclass(slots=True)
class _Pace:
    """Lateness of the messages of one name."""

    quickest_s: float
    in_time_s: float
    """Arrival of the last message in time, s (monotonic)."""
    came_s: float
    """Arrival of the last message, s (monotonic)."""
    late_since_s: float | None = None
    """Arrival of the first of the late messages in a row, s. None if the last message was in time."""
    least_s: float = 0.0
    most_s: float = 0.0
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

        Args:
            name: the name in the key.
            age_s: arrival minus stamp, s. The two clocks may differ.
            now_s: arrival, s (monotonic).
        """
        pace = self._paces.get(name)
        if pace is None or now_s - pace.in_time_s > FORGOTTEN_S:
            self._paces[name] = _Pace(age_s, now_s, now_s)
            return True
        silent_s, pace.came_s = now_s - pace.came_s, now_s
        usual_s = pace.quickest_s + FOLLOWS * min(silent_s, GAP_S)
        if age_s <= usual_s + LATE_S:
            pace.quickest_s = min(age_s, usual_s)
            pace.in_time_s, pace.late_since_s = now_s, None
            return True
        if self._is_steady(pace, age_s, now_s, silent_s):
            self._paces[name] = _Pace(age_s, now_s, now_s)
            return True
        self.refused += 1
        self.by_s = age_s - pace.quickest_s
        return False

    @staticmethod
    def _is_steady(pace: _Pace, age_s: float, now_s: float, silent_s: float) -> bool:
        least_s, most_s = min(pace.least_s, age_s), max(pace.most_s, age_s)
        if pace.late_since_s is None or silent_s > STALL_S or most_s - least_s > SPREAD_S:
            pace.late_since_s, pace.least_s, pace.most_s = now_s, age_s, age_s
            return False
        pace.least_s, pace.most_s = least_s, most_s
        return now_s - pace.late_since_s >= STEADY_S


@dataclass(slots=True)
class _Newest:
    """The newest message of one name."""

    stamp_ns: int
    came_s: float
    """Arrival, s (monotonic)."""


class OutOfOrderFilter:
    """Drops messages of one topic that are older than the newest by more than `OLD_NS`, by name."""

    def __init__(self) -> None:
        self.refused = 0
        """Number of out-of-order messages dropped."""
        self._newest: dict[str, _Newest] = {}

    def accepts(self, name: str, stamp_ns: int, now_s: float) -> bool:
        """Return True if a message of `name` is in order. `now_s` is its arrival (monotonic)."""
        newest = self._newest.get(name)
        if newest is None:
            self._newest[name] = _Newest(stamp_ns, now_s)
            return True
        ahead_ns = stamp_ns - newest.stamp_ns
        if not 0 <= ahead_ns <= STRAY_NS and now_s - newest.came_s <= SILENT_S:
            if ahead_ns < -OLD_NS:
                self.refused += 1
                return False
            return True  # its reader decides; what is true for the others stays
        newest.stamp_ns, newest.came_s = stamp_ns, now_s
        return True
