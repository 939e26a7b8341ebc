"""The clock of a NatNet server, in ticks, by echoes of it. Pure; time is an argument."""

from collections import deque
from typing import NamedTuple

from pointit.schemas import NS_PER_S

MAX_ECHOES = 20
"""Number of echoes that are compared."""
DRIFT = 50e-6
"""Assumed largest rate between two clocks. Quartz crystals differ by less."""


class _Echo(NamedTuple):
    offset_ns: float
    half_trip_ns: float
    received_ns: int

    def sigma_ns(self, now_ns: int) -> float:
        return self.half_trip_ns + DRIFT * abs(now_ns - self.received_ns)


class ServerClock:
    """Offset between a server's clock and the site's. The echo with the smallest uncertainty counts."""

    def __init__(self, clock_hz: int) -> None:
        """Begin without an offset. `clock_hz`: ticks per second."""
        self._ns_per_tick = NS_PER_S / clock_hz
        self._echoes: deque[_Echo] = deque(maxlen=MAX_ECHOES)
        self.steps = 0
        """Number of times that one of the clocks was set."""

    def add(self, sent_ns: int, received_ns: int, ticks: int) -> None:
        """Add an echo that was sent and received at these times of the site, with the server's ticks."""
        if received_ns < sent_ns:
            return
        middle_ns = (sent_ns + received_ns) / 2
        echo = _Echo(ticks * self._ns_per_tick - middle_ns, (received_ns - sent_ns) / 2, received_ns)
        best = self._best(received_ns)
        if best is not None and abs(echo.offset_ns - best.offset_ns) > (
            echo.half_trip_ns + best.sigma_ns(received_ns)
        ):  # half a round trip bounds the error of each, so that both are right of different clocks
            self.steps += 1
            self._echoes.clear()
        self._echoes.append(echo)

    def time_ns(self, ticks: int, now_ns: int) -> tuple[int, float] | None:
        """Return the site's time of `ticks`, and its 1 sigma in ns. None before the first echo."""
        best = self._best(now_ns)
        if best is None:
            return None
        return round(ticks * self._ns_per_tick - best.offset_ns), best.sigma_ns(now_ns) / 2

    def _best(self, now_ns: int) -> _Echo | None:
        return min(self._echoes, key=lambda echo: echo.sigma_ns(now_ns), default=None)
