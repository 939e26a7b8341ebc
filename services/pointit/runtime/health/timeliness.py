"""Detection of messages that come too late to act on, because a bad link has delayed them; pure.

What TCP has to send again comes seconds after it was said, and all that was said meanwhile with it, in order.
Who acts on it acts where a person pointed seconds ago. How old a message is cannot be told of two machines'
clocks, how much later it comes than others before it can. A writer's clock that was set back, and a link
that has become slow for good, look the same at first, but then all that comes is late by as much: that is
believed.
"""

from dataclasses import dataclass

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import CURSOR, HOVER, IMU, OBJECTS, RAY

LATE_S = 0.3
"""Messages that come later than the quickest by more (s) are left out."""

STEADY_S = 1.5
"""A constant delay for this long (s) is accepted: a clock was set, or there is nothing newer."""

SPREAD_S = 0.2
"""By as much: all of it within this."""

FORGOTTEN_S = 20.0
"""If nothing came in time for this long (s), the measurement is reset."""

FOLLOWS = 0.05
"""The quickest of before counts less as time goes on, s per s: clocks run apart, and are slewed."""

GAP_S = 0.1
"""Time during which nothing came does not count for that, except so much."""

STALL_S = 0.5
"""The first message after a silence this long (s) may have been delayed and says nothing of earlier ones."""

STREAMS: frozenset[AnyTopic] = frozenset((IMU, RAY, CURSOR, HOVER, OBJECTS))
"""Topics each of whose names has one writer at a time, who stamps with one clock."""

OLD_NS = NS_PER_S // 2
"""Messages older than the newest by more are not merely late."""

STRAY_NS = 2 * NS_PER_S
"""A message ahead of the newest by more is a stray or of a clock that jumped: the newest stays."""

SILENT_S = 1.0
"""When nothing has gone on from the newest for so long, the clock was set, or the writer is another."""


@dataclass(slots=True)
class _Pace:
    """Lateness of the messages of one name."""

    quickest_s: float
    in_time_s: float
    """When one came in time."""
    came_s: float
    """When the last one came."""
    late_since_s: float | None = None
    """Since when all that comes is late."""
    least_s: float = 0.0
    most_s: float = 0.0
    """Largest lateness since then, s."""


class LateMessageFilter:
    """Follows the streams of one topic, by name."""

    def __init__(self) -> None:
        self.refused = 0
        """Messages that were left out."""
        self.by_s = 0.0
        """By how much the last of them came later than the quickest."""
        self._paces: dict[str, _Pace] = {}

    def accepts(self, name: str, age_s: float, now_s: float) -> bool:
        """Return True if a message of `name` comes in time.

        Args:
            name: whose.
            age_s: its arrival less its stamp; the two clocks may be apart.
            now_s: its arrival, monotonic.
        """
        pace = self._paces.get(name)
        if pace is None or now_s - pace.in_time_s > FORGOTTEN_S:
            self._paces[name] = _Pace(age_s, now_s, now_s)
            return True
        silent_s, pace.came_s = now_s - pace.came_s, now_s
        follows_s = FOLLOWS * min(silent_s, GAP_S)
        if age_s <= pace.quickest_s + follows_s + LATE_S:
            pace.quickest_s = min(age_s, pace.quickest_s + follows_s)
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


class OutOfOrderFilter:
    """Follows the streams of one topic, by name."""

    def __init__(self) -> None:
        self.refused = 0
        """Messages that were no news."""
        self._newest: dict[str, tuple[int, float]] = {}
        """By name: the newest stamp, and when it came."""

    def accepts(self, name: str, stamp_ns: int, now_s: float) -> bool:
        """Return True if a message of `name` is new. `now_s` is monotonic."""
        newest = self._newest.get(name)
        if newest is not None and now_s - newest[1] <= SILENT_S:
            ahead_ns = stamp_ns - newest[0]
            if ahead_ns < -OLD_NS:
                self.refused += 1
                return False
            if not 0 <= ahead_ns <= STRAY_NS:
                return True  # its reader decides; what is true for the others stays
        self._newest[name] = (stamp_ns, now_s)
        return True
