"""Simulated time from ROS: a simulator's /clock becomes the site's."""

from typing import Any, NamedTuple

from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning, Taken
from pointit.schemas import NS_PER_S, ClockTick
from pointit.schemas.topics import CLOCK

TICK_NS = NS_PER_S
"""Of the wall, from one tick to the next: the site runs on by itself in between."""
FIRST_NS = NS_PER_S // 4
"""After so long the speed is known well enough to be told for the first time."""
JUMP_NS = NS_PER_S // 2
"""Of simulated time, beyond what the fastest clock could have run: it was set, and that is told at once."""

SLOWEST, FASTEST = 0.01, 100.0
"""A clock that stands still creeps on: our time never stops."""


class _Sample(NamedTuple):
    wall_ns: int
    sim_ns: int


class SimTimeInput:
    """Tells the site the time of a simulation, and how fast it runs."""

    def __init__(self) -> None:
        self._last: _Sample | None = None
        self._told = _Sample(0, 0)
        self._speed = 1.0
        self._wait_ns = FIRST_NS
        self._count = 0

    def __call__(self, value: Any, about: ConversionContext) -> Taken:
        """Take a rosgraph_msgs/Clock."""
        now = _Sample(about.wall_ns, int(value.clock.sec) * NS_PER_S + int(value.clock.nanosec))
        if now.sim_ns < 0:
            return (
                ConversionWarning(f"/clock says {now.sim_ns / NS_PER_S:.1f} s: times before 0 are left out"),
            )
        last, self._last = self._last, now
        if last is None or _has_jumped(last, now):
            self._wait_ns = FIRST_NS
            return self._tick(now)
        passed_ns = now.wall_ns - self._told.wall_ns
        if passed_ns < self._wait_ns:
            return ()
        self._wait_ns = TICK_NS
        self._speed = min(max((now.sim_ns - self._told.sim_ns) / passed_ns, SLOWEST), FASTEST)
        return self._tick(now)

    def _tick(self, now: _Sample) -> Taken:
        self._told = now
        self._count += 1
        tick = ClockTick(stamp_ns=now.wall_ns, seq=self._count, sim_ns=now.sim_ns, speed=self._speed)
        return (BusOutput(CLOCK, "", tick),)


def _has_jumped(last: _Sample, now: _Sample) -> bool:
    """Return True if the time was set, or the wall's was set back."""
    passed_ns, ran_ns = now.wall_ns - last.wall_ns, now.sim_ns - last.sim_ns
    return not 0 <= ran_ns <= JUMP_NS + passed_ns * FASTEST
