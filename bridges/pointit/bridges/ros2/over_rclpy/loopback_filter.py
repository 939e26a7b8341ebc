"""Which of what comes from ROS we have sent ourselves: rclpy delivers it like any other message.

Only rclpy from Kilted on tells whose a message is; every one since Iron tells when it was published. That
time is taken inside `publish`, by the same clock as ours: of the same bytes, what was sent while we sent is
ours.
"""

import collections
import math

REMEMBERED = 256
"""Messages of one topic; they come back within milliseconds, of which this is far more."""
MOST_PADDING = 3
"""Bytes that middlewares add to what they deliver."""
COARSE_NS = 1000
"""A middleware may cut times down to microseconds."""


class LoopbackFilter:
    """What we have sent to one topic, not long ago."""

    def __init__(self) -> None:
        self._sent: collections.deque[_Sent] = collections.deque(maxlen=REMEMBERED)

    def begin(self, cdr: bytes, now_ns: int) -> "_Sent":
        """Take note, before it is sent, of what is sent at `now_ns` by the operating system's clock."""
        sent = _Sent(len(cdr), hash(cdr), now_ns)
        self._sent.append(sent)
        return sent

    def is_ours(self, cdr: bytes, source_ns: int) -> bool:
        """Return True if it was us who published `cdr` at `source_ns`.

        Where that is not known (0, before Iron), every message of ours is taken for ours once.
        """
        for sent in self._sent.copy():  # the loop appends meanwhile
            if source_ns:
                is_meant = sent.began_ns - COARSE_NS <= source_ns < sent.ended_ns
            else:
                is_meant = not sent.is_back
            if is_meant and sent.is_in(cdr):
                sent.is_back = True
                return True
        return False


class _Sent:
    """One message of ours."""

    __slots__ = ("began_ns", "ended_ns", "is_back", "length", "mark")

    def __init__(self, length: int, mark: int, began_ns: int) -> None:
        self.length = length
        self.mark = mark
        self.began_ns = began_ns
        self.ended_ns = math.inf
        """Until it is known: it may be back before `publish` returns."""
        self.is_back = False

    def is_in(self, cdr: bytes) -> bool:
        """Return True if `cdr` is this message, perhaps with padding behind it."""
        return 0 <= len(cdr) - self.length <= MOST_PADDING and hash(cdr[: self.length]) == self.mark
