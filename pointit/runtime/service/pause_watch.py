"""Notices that this process stood still: it was stopped, or got no processor time."""

import asyncio
import math

BEAT_S = 0.25
"""Period in which the loop shows that it runs, s."""
MAX_PAUSE_S = 2.0
"""Maximum time without a beat that is no pause, s. Others take a process for dead after a lease of 3 s."""


class PauseWatch:
    """Watches the running loop between `start` and `stop`."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._beat_s = 0.0
        """Time of the last beat, s."""
        self._resumed_s = -math.inf
        """Time at which the last pause was noticed, s."""
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Watch from now on. Without effect if it watches already."""
        if self._timer is None:
            self._beat_s = self._loop.time()
            self._timer = self._loop.call_later(BEAT_S, self._beat)

    def stop(self) -> None:
        """Stop watching."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def has_paused_since(self, time_s: float) -> bool:
        """Return True if a pause has ended after `time_s` of the loop, at which it was watching."""
        # After a pause, the caller may run before the beat that is overdue.
        self._note_pause()
        return self._resumed_s > time_s

    def _beat(self) -> None:
        self._note_pause()
        self._timer = self._loop.call_later(BEAT_S, self._beat)

    def _note_pause(self) -> None:
        now_s = self._loop.time()
        if now_s - self._beat_s > MAX_PAUSE_S:
            self._resumed_s = now_s
        self._beat_s = now_s
