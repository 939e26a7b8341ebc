"""Bounded queues of incoming requests. The loop handles each queue for a slice of time per turn."""

import asyncio
import collections
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Generic, TypeVar

log = logging.getLogger(__name__)

T = TypeVar("T")

MAX_WAITING = 512
"""Length of one queue, twice what one request answers at a time. Further items are rejected."""
SLICE_S = 0.001
"""So long a line works in one turn of the loop before everybody else gets theirs."""
SHOWN_S = 5.0
"""So long it is said that somebody was turned away, after the last of them."""
LOG_PERIOD_S = 1.0


class OverflowCounter:
    """Counts rejections by full queues, for all queues of a process and from any thread."""

    def __init__(self) -> None:
        """Begin with none."""
        self._lock = threading.Lock()
        self._count = 0
        self._key = ""
        self._last_s = self._logged_s = -math.inf

    def add(self, key: str, now_s: float) -> None:
        """Count one who asked for `key` at `now_s`, monotonic."""
        with self._lock:
            self._count += 1
            self._key, self._last_s = key, now_s
            if now_s - self._logged_s < LOG_PERIOD_S:
                return
            self._logged_s = now_s
        log.warning("%s", self.problem(now_s))

    def problem(self, now_s: float) -> str:
        """Return a message for `SHOWN_S` after a rejection, else `""`."""
        with self._lock:
            if now_s - self._last_s > SHOWN_S:
                return ""
            many = f"{self._count} questions were turned away, the last"
            return (
                f"{many if self._count > 1 else '1 question was turned away,'} for {self._key}, as more than "
                f"{MAX_WAITING} waited: find out who on this site asks so much, and end that"
            )


class BoundedWorkQueue(Generic[T]):
    """Takes items on any thread and works on them in the loop that it was made in, one after another."""

    def __init__(self, key: str, work: Callable[[T], Iterable[object]], turned_away: OverflowCounter) -> None:
        """Begin empty.

        Args:
            key: what the items ask for, for people.
            work: handles an item in small steps, one each time the iterator goes on; runs in the loop.
            turned_away: counts what found no room.
        """
        self._key = key
        self._work = work
        self._turned_away = turned_away
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._waiting: collections.deque[T] = collections.deque()
        self._steps: Iterator[object] | None = None
        """Remaining steps of the item in progress."""
        self._is_awake = False

    def offer(self, item: T) -> bool:
        """Take `item`, or return that there is no room for it; from any thread.

        Raises:
            RuntimeError: the loop is gone.
        """
        with self._lock:
            has_room = len(self._waiting) < MAX_WAITING
            if has_room:
                if not self._is_awake:
                    self._loop.call_soon_threadsafe(self._turn)
                    self._is_awake = True
                self._waiting.append(item)
        if not has_room:
            self._turned_away.add(self._key, time.monotonic())
        return has_room

    def _turn(self) -> None:
        until_s = time.monotonic() + SLICE_S
        while True:
            if self._steps is None:
                with self._lock:
                    if not self._waiting:
                        self._is_awake = False
                        return
                    item = self._waiting.popleft()
                self._steps = iter(self._work(item))
            try:
                next(self._steps)
            except StopIteration:
                self._steps = None
            except Exception:
                self._steps = None
                log.exception("a question for %s could not be answered", self._key)
            if time.monotonic() >= until_s:
                break
        self._loop.call_soon(self._turn)
