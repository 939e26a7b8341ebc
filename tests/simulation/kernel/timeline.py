"""The simulation's true time, and the trace of what happened."""

import asyncio
import collections
import contextvars
import hashlib
import random
from collections.abc import Callable

TRACE_LINES = 600
"""Number of newest lines that are kept for the report of a breach."""
OUTSIDE = contextvars.Context()
"""Context of callbacks that belong to no process: links, faults, checks."""


class Timeline:
    """True time of a simulation, callbacks outside of all processes, random generators, and the trace."""

    def __init__(self, loop: asyncio.AbstractEventLoop, seed: int) -> None:
        """Begin at time 0 on `loop`."""
        self.loop = loop
        self.seed = seed
        self.trace = collections.deque[str](maxlen=TRACE_LINES)
        self.full_trace: list[str] | None = None
        """All lines, if they are wanted."""
        self.lines = 0
        self._digest = hashlib.sha256()
        self._began_s = loop.time()

    @property
    def now_s(self) -> float:
        """Return the true time, s."""
        return self.loop.time() - self._began_s

    @property
    def digest(self) -> str:
        """Return a digest of the trace so far. Two runs with equal digests were the same run."""
        return self._digest.hexdigest()[:16]

    def random(self, purpose: str) -> random.Random:
        """Return a generator for one purpose, so that a fault that is left out changes no other draws."""
        return random.Random(f"{self.seed} {purpose}")

    def call_at(
        self, at_s: float, callback: Callable[..., object], *args: object, context: contextvars.Context
    ) -> None:
        """Call back at the true time `at_s`."""
        self.loop.call_at(self._began_s + at_s, callback, *args, context=context)

    def after(self, delay_s: float, callback: Callable[..., object], *args: object) -> None:
        """Call back outside of all processes."""
        self.call_at(self.now_s + delay_s, callback, *args, context=OUTSIDE)

    def note(self, kind: str, text: str) -> None:
        """Add a line to the trace."""
        line = f"{self.now_s:10.4f} {kind:9} {text}"
        self.lines += 1
        self._digest.update(line.encode())
        self.trace.append(line)
        if self.full_trace is not None:
            self.full_trace.append(line)
