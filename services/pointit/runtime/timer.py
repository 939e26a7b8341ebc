"""A timer of the event loop that can be started again and again."""

import asyncio
from collections.abc import Callable


class Timer:
    """Calls back once, some time after it was started. Of several starts the earliest end counts."""

    def __init__(
        self,
        call_later: Callable[[float, Callable[[], None]], asyncio.TimerHandle],
        callback: Callable[[], None],
    ) -> None:
        """Create without starting.

        Args:
            call_later: schedules a call after some seconds: `ServiceBus.call_later` or the loop's.
            callback: called at the end, when the timer may be started again.
        """
        self._call_later = call_later
        self._callback = callback
        self._handle: asyncio.TimerHandle | None = None

    @property
    def is_running(self) -> bool:
        """Return True if it was started and neither has ended nor was cancelled."""
        return self._handle is not None

    def start(self, wait_s: float) -> None:
        """Call back after `wait_s` of wall time, unless it will do so earlier."""
        if self._handle is not None:
            if self._handle.when() <= asyncio.get_running_loop().time() + wait_s:
                return
            self._handle.cancel()
        self._handle = self._call_later(wait_s, self._end)

    def cancel(self) -> None:
        """Call back no longer."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def _end(self) -> None:
        self._handle = None
        self._callback()
