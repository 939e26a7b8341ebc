"""Simulated time from ROS: a simulator's /clock becomes the site's."""

from typing import Any, NamedTuple

from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning, Taken
from pointit.schemas import NS_PER_S, ClockTick
from pointit.schemas.topics import CLOCK

TICK_NS = NS_PER_S
"""Interval of ticks, wall time: the site's clock runs on in between."""
FIRST_NS = NS_PER_S // 4
"""Wall time after which the speed is known well enough for the first tick."""
JUMP_NS = NS_PER_S // 2
"""Simulated time beyond the fastest clock's progress that counts as a step and is published at once."""

SLOWEST, FASTEST = 0.01, 100.0
"""Limits of the speed. A stopped clock creeps on: the site's time never stops."""


class _Sample(NamedTuple):
    wall_ns: int
    sim_ns: int


class SimTimeInput:
    """Publishes the time and speed of a simulation to the site."""

    def __init__(self) -> None:
        self._last: _Sample | None = None
        self._told = _Sample(0, 0)
        self._speed = 1.0
        self._wait_ns = FIRST_NS
        self._count = 0

    def __call__(self, value: Any, about: ConversionContext) -> Taken:
        """Convert a rosgraph_msgs/Clock."""
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
    """Return True if the simulated clock was stepped, or the wall clock was set back."""
    passed_ns, ran_ns = now.wall_ns - last.wall_ns, now.sim_ns - last.sim_ns
    return not 0 <= ran_ns <= JUMP_NS + passed_ns * FASTEST
