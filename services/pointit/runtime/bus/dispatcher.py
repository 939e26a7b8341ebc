"""Wake-up of an event loop that drains all buffers. A chain of services on one loop needs one wake-up."""

import asyncio
import collections
import math
import threading
import time
from typing import Protocol

MAX_ROUNDS = 16
"""Maximum number of hops in a chain per wake-up. Then other tasks of the loop run."""
LOG_PERIOD_S = 1.0
"""Minimum interval of log lines per topic and kind of problem, and per failing handler, s."""


class Drainable(Protocol):
    """A buffer that any thread fills and the loop drains, such as `Mailbox`."""

    def drain(self) -> None:
        """Handle all queued items."""
        ...


class Dispatcher:
    """Drains scheduled mailboxes in its event loop, with one wake-up for all of them."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.thread = threading.get_ident()
        """Id of the loop's thread."""
        self.ready: collections.deque[Drainable] = collections.deque()
        """Buffers to drain. A caller that adds one must then call `wake`, unless the loop `is_awake`."""
        self.is_awake = False
        """True if the loop will check `ready` before it sleeps."""
        self.is_closed = False
        self._log_lock = threading.Lock()
        self._logged_s: dict[tuple[str, str], float] = {}

    def should_log(self, key: str, problem: str) -> bool:
        """Return True if a log line on `problem` about the topic `key` is due. Any thread."""
        now_s = time.monotonic()
        with self._log_lock:
            if now_s - self._logged_s.get((key, problem), -math.inf) < LOG_PERIOD_S:
                return False
            self._logged_s[key, problem] = now_s
            return True

    def schedule(self, mailbox: Drainable) -> None:
        """Schedule `mailbox` to be drained. Any thread."""
        self.ready.append(mailbox)
        if not self.is_awake:
            self.wake()

    def wake(self) -> None:
        """Wake the loop to check `ready`. Any thread."""
        self.is_awake = True
        is_here = threading.get_ident() == self.thread
        try:
            (self._loop.call_soon if is_here else self._loop.call_soon_threadsafe)(self._drain_all)
        except RuntimeError:  # the loop is closed: this is a late callback of another thread
            self.is_closed = True

    def close(self) -> None:
        """Stop draining."""
        self.is_closed = True
        self.ready.clear()

    def _drain_all(self) -> None:
        ready = self.ready
        try:
            rounds, left = MAX_ROUNDS, len(ready)  # cheaper than a `range` for each round
            while ready and not self.is_closed:
                if not left:
                    rounds, left = rounds - 1, len(ready)
                    if not rounds:
                        break
                left -= 1
                ready.popleft().drain()
        finally:
            # A thread that added a buffer since the last check saw `is_awake`: check again.
            self.is_awake = False
            if ready and not self.is_closed:
                self.wake()
