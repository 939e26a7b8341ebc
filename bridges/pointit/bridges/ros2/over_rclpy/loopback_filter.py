"""Filter for messages that we have sent ourselves, which rclpy delivers like any other message.

Only rclpy from Kilted on names a message's publisher; every one since Iron gives the time of publication. It
is taken inside `publish`, by the same clock as ours: a message with the bytes of one of ours, published while
we published, is ours.
"""

import collections
import math

REMEMBERED = 256
"""Maximum number of remembered messages of a topic; they come back within milliseconds."""
MAX_PADDING = 3
"""Maximum number of bytes that middlewares append on delivery."""
COARSE_NS = 1000
"""Resolution of times, which a middleware may cut down to microseconds."""


class LoopbackFilter:
    """Messages recently sent to one topic."""

    def __init__(self) -> None:
        self._sent: collections.deque[_Sent] = collections.deque(maxlen=REMEMBERED)

    def begin(self, cdr: bytes, now_ns: int) -> "_Sent":
        """Note a message that is about to be sent, at `now_ns` by the operating system's clock."""
        sent = _Sent(len(cdr), hash(cdr), now_ns)
        self._sent.append(sent)
        return sent

    def is_ours(self, cdr: bytes, source_ns: int) -> bool:
        """Return True if we published `cdr` at `source_ns`.

        If the time is unknown (0, before Iron), every message of ours matches once.
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
        """Infinite until it is known: the message may be back before `publish` returns."""
        self.is_back = False

    def is_in(self, cdr: bytes) -> bool:
        """Return True if `cdr` is this message, with or without padding."""
        return 0 <= len(cdr) - self.length <= MAX_PADDING and hash(cdr[: self.length]) == self.mark
