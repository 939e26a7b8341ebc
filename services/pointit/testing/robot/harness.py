"""Harness of a robot driver, given by its author, and one run of the driver."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pointit.geometry.vector import Vec3
from pointit.plugins import (
    Command,
    FollowPath,
    LinkLost,
    OrderStatus,
    ReportItem,
    RobotPlugin,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
)
from pointit.schemas import RobotKind
from pointit.testing.check import CheckFailedError, called
from pointit.testing.trial import DeviceHarness, Trial

STILL_MPS = 0.05
"""A slower robot stands, m/s."""


@dataclass(frozen=True, kw_only=True)
class RobotHarness(DeviceHarness[RobotPlugin]):
    """A robot driver with a fake robot that replaces the real one and moves as ordered.

    The fake robot is a `FakeDevice` that is created at the origin. Between `plug` and `unplug`, tasks of it
    may report and move.
    """

    kind: RobotKind = "ground"
    """Kind of the fake robot."""
    follows: bool = True
    """False if the driver refuses `Follow`."""
    near_m: float = 0.2
    """Distance at which the robot counts as arrived, m."""
    far_m: float = 30.0
    """A place that it does not reach within seconds, m."""
    is_moving: Callable[[Any], bool] | None = None
    """Returns True if the given fake robot moves. None if that cannot be seen."""

    def trial(self) -> "RobotTrial":
        """Return a trial of the driver, which is made at once. Raises CheckFailedError if it cannot be."""
        return RobotTrial(self)


class RobotTrial(Trial):
    """One run of a robot driver, which is made at once."""

    def __init__(self, harness: RobotHarness) -> None:
        super().__init__(harness)
        self.harness = harness
        self.reports: list[tuple[int, RobotReport]] = []
        """Reports with the time of their arrival, ns."""
        self.statuses: list[OrderStatus] = []
        self.losses: list[LinkLost] = []
        self._count = 0
        with called("make"):
            self.driver = self.make(self.config)

    @property
    def height_m(self) -> float:
        """Return the height in which the robot moves."""
        return 0.5 if self.harness.kind == "quadrotor" else 0.0

    def make(self, config: Any) -> Any:
        """Create a driver of a robot at the origin."""
        spec = RobotSpec(
            name="checked",
            kind=self.harness.kind,
            start_m=(0.0, 0.0, 0.0),
            start_yaw_rad=0.0,
            radius_m=0.2,
            hover_m=self.height_m or 0.2,
            max_speed_mps=1.0,
            max_acceleration_mps2=1.0,
        )
        return self.harness.plugin.make(config, spec, self.surroundings)

    async def start(self) -> None:
        """Run the driver in the background."""
        self.task = asyncio.create_task(self.driver.run(self._report))

    async def exchange(self, situation: str = "the robot was connected") -> None:
        """Wait for a report that comes from now on."""
        before = len(self.reports)
        await self.until(lambda: len(self.reports) > before, f"{situation}, and nothing was reported")

    async def live(self) -> None:
        """Move and stop the robot. Disconnect and reconnect it, if the driver can notice that."""
        await self.rise()
        self.tell(FollowPath(self.next(), (self.place(0.5),)))
        await self.exchange()
        self.tell(Stop(self.next()))
        if self.device.is_connected:
            await self.replug()

    def place(self, x_m: float, y_m: float = 0.0) -> Vec3:
        """Return a place to go to."""
        return (x_m, y_m, self.height_m)

    def next(self) -> int:
        """Return the number of the next command."""
        self._count += 1
        return self._count

    def tell(self, command: Command) -> None:
        """Send the driver a command.

        Raises:
            CheckFailedError: If it raises.
        """
        with called("command"):
            self.driver.command(command)

    def states(self, order: int) -> list[str]:
        """Return the reported states of an order, in turn."""
        return [status.state for status in self.statuses if status.order == order]

    async def rise(self) -> None:
        """Start a quadrotor's take-off."""
        if self.harness.kind == "quadrotor":
            order = self.next()
            self.tell(TakeOff(order, self.height_m))
            await self.done(order, "it was told to take off")

    async def go(self, place_m: Vec3) -> None:
        """Go to a position, and wait until the driver reports arrival."""
        order = self.next()
        self.tell(FollowPath(order, (place_m,)))
        await self.done(order, f"it was sent to {place_m}")
        self.require_near(place_m)

    async def done(self, order: int, situation: str) -> None:
        """Wait until an order is done."""
        await self.until(lambda: "done" in self.states(order), f"{situation}, and was never done")
        await self.exchange()

    async def moving(self) -> None:
        """Wait until the robot reports that it moves."""
        await self.until(
            lambda: self.speed_mps() > STILL_MPS, "it was sent far away, and no report said that it moves"
        )

    async def still(self, situation: str) -> None:
        """Wait until the robot reports that it stands, and goes on standing."""
        await self.until(lambda: self.speed_mps() < STILL_MPS, f"{situation}, and it did not stand still")
        place = self.reports[-1][1].position_m
        for _ in range(5):
            await self.exchange()
        if math.dist(place, self.reports[-1][1].position_m) > self.harness.near_m:
            raise CheckFailedError(f"{situation}, and it went on after it had stood still")

    def speed_mps(self) -> float:
        """Return the last reported speed."""
        return math.hypot(*self.reports[-1][1].velocity_mps) if self.reports else 0.0

    def require_near(self, place_m: Vec3) -> None:
        """Raise CheckFailedError unless the robot is at a place."""
        away_m = math.dist(self.reports[-1][1].position_m, place_m)
        if away_m > self.harness.near_m:
            raise CheckFailedError(f"it was said to be done {away_m:.2f} m away from {place_m}")

    def _report(self, item: ReportItem) -> None:
        self.health.note_thread("report")
        if isinstance(item, RobotReport):
            self.reports.append((self.clock.now_ns(), item))
        elif isinstance(item, OrderStatus):
            self.statuses.append(item)
        else:
            self.losses.append(item)
