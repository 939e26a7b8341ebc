"""Which messages of a stream are news: a recording that is played beside it is not; pure.

Of a person's samples, rays and cursors, and of a tracker's objects, only the newest counts; what is older by
its stamp is out of date, and comes of somebody who plays a recording, or of a second writer. But clocks are
set back, and writers are replaced by others on machines whose clocks are behind: then nobody says anything
newer any more, and after a moment all begins anew.
"""

from pointit.runtime.bus import AnyTopic
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import CURSOR, HOVER, IMU, OBJECTS, RAY

STREAMS: frozenset[AnyTopic] = frozenset((IMU, RAY, CURSOR, HOVER, OBJECTS))
"""Topics each of whose names has one writer at a time, who stamps with one clock."""

OLD_NS = NS_PER_S // 2
"""What is older than the newest by more is not merely late."""

STRAY_NS = 2 * NS_PER_S
"""What is ahead of the newest by more is of a clock that jumped, or a stray: nobody is too old for it yet."""

SILENT_S = 1.0
"""When nothing has gone on from the newest for so long, the clock was set, or the writer is another."""


class Order:
    """Follows the streams of one topic, by name."""

    def __init__(self) -> None:
        self.refused = 0
        """Messages that were no news."""
        self._newest: dict[str, tuple[int, float]] = {}
        """By name: the newest stamp, and when it came."""

    def admits(self, name: str, stamp_ns: int, now_s: float) -> bool:
        """Return whether a message of `name` is news; `now_s` is monotonic."""
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
