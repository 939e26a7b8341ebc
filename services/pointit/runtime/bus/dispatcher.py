"""The one wake-up of an event loop that drains all buffers: a chain of services on one loop takes one."""

import asyncio
import collections
import math
import threading
import time
from typing import Protocol

MAX_ROUNDS = 16
"""Hops of a chain handled in one wake-up before other tasks of the loop get their turn."""
LOG_PERIOD_S = 1.0
"""At most one log line per topic and kind of trouble in this time; one per handler that fails."""


class Drainable(Protocol):
    """A buffer that is filled on any thread and drained in the loop, such as `Mailbox`."""

    def drain(self) -> None:
        """Handle what is there."""
        ...


class Dispatcher:
    """Drains marked mailboxes in its event loop, with one wake-up for all of them."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.thread = threading.get_ident()
        """Id of the loop's thread."""
        self.ready: collections.deque[Drainable] = collections.deque()
        """Buffers to be drained. Who adds one calls `wake` then, unless the loop `is_awake`."""
        self.is_awake = False
        """True if the loop looks at `ready` before it sleeps."""
        self._closed = False
        self._log_lock = threading.Lock()
        self._logged_s: dict[tuple[str, str], float] = {}

    @property
    def is_closed(self) -> bool:
        """Return True if nothing is drained any more."""
        return self._closed

    def should_log(self, key: str, what: str) -> bool:
        """Return True if a log line on `what` about the topic `key` is due. Any thread."""
        now_s = time.monotonic()
        with self._log_lock:
            if now_s - self._logged_s.get((key, what), -math.inf) < LOG_PERIOD_S:
                return False
            self._logged_s[key, what] = now_s
            return True

    def schedule(self, mailbox: Drainable) -> None:
        """Have `mailbox` drained soon; from any thread."""
        self.ready.append(mailbox)
        if not self.is_awake:
            self.wake()

    def wake(self) -> None:
        """Have the loop look at `ready` soon; from any thread."""
        self.is_awake = True
        is_here = threading.get_ident() == self.thread
        try:
            (self._loop.call_soon if is_here else self._loop.call_soon_threadsafe)(self._drain_all)
        except RuntimeError:  # the loop is closed: a late callback of a foreign thread
            self._closed = True

    def close(self) -> None:
        """Drain nothing any more."""
        self._closed = True
        self.ready.clear()

    def _drain_all(self) -> None:
        ready = self.ready
        try:
            rounds, left = MAX_ROUNDS, len(ready)  # cheaper than a `range` for each round
            while ready and not self._closed:
                if not left:
                    rounds, left = rounds - 1, len(ready)
                    if not rounds:
                        break
                left -= 1
                ready.popleft().drain()
        finally:
            # A thread that added between the last look and this line saw us awake: look again afterwards.
            self.is_awake = False
            if ready and not self._closed:
                self.wake()
