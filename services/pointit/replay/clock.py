"""The time of a recording while it is replayed."""

import asyncio
import time

from pointit.schemas import NS_PER_S, ClockTick

MAX_BURST = 256
"""Entries that are put at once, at most, before the services get their turn, as queues are bounded."""


class RecordingClock:
    """Begins at a time of a recording and follows the running loop's time, which may be virtual."""

    def __init__(self, start_ns: int, speed: float = 1.0) -> None:
        """Begin now at `start_ns`, Unix ns, and run `speed` times as fast as the loop."""
        self.speed = speed
        self._start_ns = start_ns
        self._loop = asyncio.get_running_loop()
        self._began_s = self._loop.time()
        self._burst = 0
        """Number of calls of `wait_until` in a row that had nothing to wait for."""

    def now_ns(self) -> int:
        """Return the time in the recording, Unix ns."""
        return self._start_ns + round((self._loop.time() - self._began_s) * self.speed * NS_PER_S)

    def tick(self) -> ClockTick:
        """Return the tick by which other processes follow."""
        return ClockTick(stamp_ns=time.time_ns(), sim_ns=self.now_ns(), speed=self.speed)

    async def wait_until(self, time_ns: int) -> None:
        """Wait until the recording's time is `time_ns`.

        Return at once if it has passed, but let others run after `MAX_BURST` such calls.
        """
        left_s = (time_ns - self.now_ns()) / NS_PER_S / self.speed
        self._burst = 0 if left_s > 0.0 or self._burst >= MAX_BURST else self._burst + 1
        if self._burst == 0:
            await asyncio.sleep(max(left_s, 0.0))
