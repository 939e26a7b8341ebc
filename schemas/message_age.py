"""Ages of messages from outside, by the retain flag of their broker and by their stamps. Pure.

A broker hands a retained message to each new subscriber, also one of yesterday. All readers of retained
messages and of stamps of other clocks ask here how old a message is, and compare that with their own limit.
`docs/reference/ages.md` has the limits.
"""

import math
from dataclasses import dataclass

from pointit.schemas.base import NS_PER_S

MAX_AHEAD_NS = NS_PER_S
"""Maximum lead of the stamp of a retained message over the reader's clock, ns."""
CONFIRMED_NS = NS_PER_S
"""Time for which a sender's clock must run with a constant error before that error is believed, ns."""
STEADY_NS = NS_PER_S // 2
"""Maximum decrease of the age of such messages, ns. A queue that is delivered late catches up faster."""


def message_age_ns(stamp_ns: int | None, now_ns: int, *, is_retained: bool = False) -> float:
    """Return the age of a message on arrival, ns, `math.inf` if it is unknown.

    It is negative if the message is stamped ahead of the reader's clock. A message that arrives as it is sent
    and has no stamp is new. A retained one may be of any age: without a stamp, or with a stamp ahead of the
    reader's clock by more than `MAX_AHEAD_NS`, its age is unknown.

    Args:
        stamp_ns: the sender's time, Unix ns, or None if the message states none.
        now_ns: time of arrival, Unix ns.
        is_retained: True if the broker had stored the message.
    """
    if stamp_ns is None:
        return math.inf if is_retained else 0
    age_ns = now_ns - stamp_ns
    if is_retained and age_ns < -MAX_AHEAD_NS:
        return math.inf
    return age_ns


@dataclass
class _ClockError:
    """Age of the messages of a sender whose clock seems to be wrong."""

    since_ns: int
    """Arrival of the first of them, Unix ns."""
    age_ns: float
    """Smallest age since then, ns."""


class SenderClock:
    """Tells messages of now from old ones of one sender, whose clock may be wrong.

    A message that seems old as it arrives has waited, such as between two brokers, or its sender's clock is
    behind. An old *press* must not be carried out, and a person whose phone is an hour slow must still be
    able to press. What tells the two apart is what follows: with a wrong clock the ages of all messages stay
    the same, and a queue that empties has younger and younger ones. So a sender is believed once the ages of
    its messages have stayed the same for `CONFIRMED_NS`.

    >>> S = 1_000_000_000
    >>> clock = SenderClock(max_age_ns=2 * S)
    >>> clock.age_ns(0, 60 * S, is_retained=False) / S  # it seems to be a minute old
    60.0
    >>> clock.age_ns(30 * S, 90 * S, is_retained=False)  # the next one, too: the clock is slow
    0
    """

    def __init__(self, max_age_ns: int) -> None:
        """Begin without messages. `max_age_ns`: age above which a message is old."""
        self._max_age_ns = max_age_ns
        self._ended_ns: int | None = None
        """Stamp of the message by which the sender has left, or None."""
        self._error: _ClockError | None = None

    def start(self) -> None:
        """Note that the sender has said that it is here now: its clock may be another one."""
        self._ended_ns = None
        self._error = None

    def end(self, stamp_ns: int | None) -> None:
        """Note that the sender has left by a message stamped `stamp_ns`: what it said before then is old."""
        self._ended_ns = stamp_ns
        self._error = None

    def age_ns(self, stamp_ns: int | None, now_ns: int, *, is_retained: bool) -> float:
        """Return the age of a message of the sender, ns, at least 0: 0 for one of now, `math.inf` if unknown.

        Args:
            stamp_ns: as of `message_age_ns`.
            now_ns: as of `message_age_ns`.
            is_retained: as of `message_age_ns`.
        """
        age_ns = message_age_ns(stamp_ns, now_ns, is_retained=is_retained)
        has_ended = False
        if stamp_ns is not None and self._ended_ns is not None:
            has_ended = stamp_ns <= self._ended_ns
        if is_retained:
            return math.inf if has_ended else max(age_ns, 0)
        if age_ns <= self._max_age_ns and not has_ended:
            self.start()
            return 0
        # Old by its stamp. A sender whose messages are all as old has a wrong clock.
        if self._has_clock_error(age_ns, now_ns):
            return 0
        return max(age_ns, self._max_age_ns + 1)

    def _has_clock_error(self, age_ns: float, now_ns: int) -> bool:
        """Return True if messages that seem old are not: the error of the sender's clock is constant."""
        error = self._error
        late_ns = 0.0 if error is None else age_ns - error.age_ns
        # the first bound is for a queue that catches up, the second for a clock that is set back
        is_changed = late_ns < -STEADY_NS or late_ns > self._max_age_ns
        if error is None or is_changed:
            self._error = _ClockError(since_ns=now_ns, age_ns=age_ns)
            return False
        error.age_ns = min(error.age_ns, age_ns)  # follows a clock that drifts
        return now_ns - error.since_ns >= CONFIRMED_NS
