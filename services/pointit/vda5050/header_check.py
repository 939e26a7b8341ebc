"""Order of the messages of an AGV, by header id and timestamp."""

from pointit.vda5050.tolerant_model import COUNTS

LATE_IDS = 100
"""A header id that is behind the newest by at most this belongs to a message that comes late. One that is
farther behind is that of an AGV that has started to count again."""
LATE_S = 10.0
"""A message is not later than this, s. A timestamp that is farther back is that of a clock that was set."""
MAX_LATE = 2
"""Maximum number of messages in a row that are late by their header ids only. With the next one, the AGV has
started to count again."""


class HeaderCheck:
    """Recognizes messages of one topic that come late, or twice, as far as header id and timestamp tell."""

    def __init__(self) -> None:
        self._header_id: int | None = None
        """That of the newest message, or None if it states none."""
        self._stamp_s: float | None = None
        self._has_varied = False
        """True if the header id tells the newest message from the one before. A time may be in whole s."""
        self._late_count = 0

    def is_new(self, header_id: int | None, stamp_s: float | None = None) -> bool:
        """Return True unless the message is certainly late or a repetition.

        A counter that starts again, is constant or is missing never suppresses messages for long.

        Args:
            header_id: None if the message states none.
            stamp_s: its timestamp, Unix s, or None if it states none.
        """
        step, later_s = self._step(header_id), self._later_s(stamp_s)
        if self._is_late(step, later_s):
            self._late_count += 1
            if -LATE_S <= later_s < 0.0 or self._late_count <= MAX_LATE:
                return False
        self._has_varied = step != 0
        self._late_count = 0
        self._header_id, self._stamp_s = header_id, stamp_s
        return True

    def forget(self) -> None:
        """Accept any message next: the AGV, or the connection, is a new one."""
        self._header_id = self._stamp_s = None
        self._has_varied = False

    def _step(self, header_id: int | None) -> int:
        """Return the header id relative to that of the newest message, 0 if it does not tell."""
        if self._header_id is None or header_id is None:
            return 0
        return (header_id - self._header_id + COUNTS // 2) % COUNTS - COUNTS // 2

    def _later_s(self, stamp_s: float | None) -> float:
        return 0.0 if self._stamp_s is None or stamp_s is None else stamp_s - self._stamp_s

    def _is_late(self, step: int, later_s: float) -> bool:
        if step > 0 or step < -LATE_IDS or later_s > 0.0:
            return False
        return step < 0 or -LATE_S <= later_s < 0.0 or (later_s == 0.0 and self._has_varied)
