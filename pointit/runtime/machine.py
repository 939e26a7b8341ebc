"""Clocks, names and random bytes of the machine and process that code runs on.

No other module asks the operating system for them. A simulation of several machines gives each its own, by
`using_machine`.
"""

import contextlib
import os
import secrets
import socket
import time
from collections.abc import Callable, Generator
from contextvars import ContextVar
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Clocks, names and random bytes of one process on one machine."""

    now_ns: Callable[[], int] = field(default_factory=lambda: time.time_ns)
    """Returns the time of the wall clock, Unix ns. It may be set, also back."""
    monotonic_ns: Callable[[], int] = field(default_factory=lambda: time.monotonic_ns)
    """Returns a time that only grows, ns."""
    elapsed_s: Callable[[], float] = field(default_factory=lambda: time.perf_counter)
    """Returns a time that only grows, with the finest steps, s. For durations of work."""
    host_name: str = field(default_factory=socket.gethostname)
    """Name of the machine."""
    process_id: int = field(default_factory=os.getpid)
    """Id of the process."""
    random_bytes: Callable[[int], bytes] = secrets.token_bytes
    """Returns so many random bytes, for names that nobody else has. Secrets are never taken from here."""

    def monotonic_s(self) -> float:
        """Return the time of `monotonic_ns` in s."""
        return self.monotonic_ns() / 1e9

    def random_name(self, length_bytes: int) -> str:
        """Return a name that nobody else has, of two hexadecimal digits for each byte."""
        return self.random_bytes(length_bytes).hex()


_used: ContextVar[Machine | None] = ContextVar("machine", default=None)


def this_machine() -> Machine:
    """Return the machine and process of the caller."""
    return _used.get() or Machine()


@contextlib.contextmanager
def using_machine(machine: Machine) -> Generator[None]:
    """Use `machine` in this block and in all tasks that it starts."""
    previous = _used.set(machine)
    try:
        yield
    finally:
        _used.reset(previous)
