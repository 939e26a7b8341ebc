"""Times of sensor frames by the clock of a watch."""

from collections.abc import Sequence

from pointit.services.imu_bridge.ble.touch_sdk.messages import Update

NS_PER_MS = 1_000_000
MAX_DELTA_MS = 10_000
"""Longest time between two frames that is believed, ms."""
MAX_UNIX_MS = 2**62 // NS_PER_MS


class FrameTimes:
    """Clock of one watch: its Unix time if it sends it, else the sum of its times between frames.

    The last frame of a message has the time of the message, each other one its distance before.
    """

    def __init__(self) -> None:
        self._newest_ms: int | None = None

    def read(self, update: Update) -> Sequence[int | None]:
        """Return the time of each frame of the next message, ns, or None if the watch sends no times."""
        deltas = [each.delta_ms if 0 < each.delta_ms <= MAX_DELTA_MS else 0 for each in update.frames]
        if not deltas:
            return ()
        before_ms = self._newest_ms
        if 0 < update.unix_ms < MAX_UNIX_MS:
            last_ms = update.unix_ms
        else:
            span_ms = sum(deltas) or (update.delta_ms if 0 < update.delta_ms <= MAX_DELTA_MS else 0)
            if not span_ms:
                return (None,) * len(deltas)
            last_ms = (before_ms or 0) + span_ms
        self._newest_ms = last_ms
        # A time of the message before is not reached again, unless the clock was set back.
        first_ms = before_ms if before_ms is not None and before_ms <= last_ms else 0
        return [max(last_ms - sum(deltas[index + 1 :]), first_ms) * NS_PER_MS for index in range(len(deltas))]
