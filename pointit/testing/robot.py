"""The contract of drivers of robots."""

import asyncio
import math
import time
from typing import Any

from pointit.geometry.vector import Vec3
from pointit.plugins import (
    NS_PER_S,
    Command,
    Follow,
    FollowPath,
    Land,
    LinkLost,
    OrderStatus,
    ReportItem,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
)
from pointit.schemas import RobotKind
from pointit.testing.contract import called, promise, require
from pointit.testing.devices import FakeDevice
from pointit.testing.trial import DeviceContract, Trial

STILL_MPS = 0.05
"""A slower robot stands, m/s."""
MAX_POSE_AGE_S = 2.0
"""Maximum age of a pose when it is reported, s."""
REPORTS = 10
MIN_RATE_HZ = 5.0
"""Minimum rate of reports: they are promised at 10 Hz, and other processes may take time meanwhile, Hz."""
MAX_COMMANDS_S = 1.0
"""Maximum time that a thousand commands may take, s."""
NOWHERE = (math.nan, math.inf, 0.0)
DONE = "Report OrderStatus(order, 'done') when the robot is there, and not before, nor for a replaced order"


class RobotTrial(Trial):
    """One run of a robot driver, which is made at once."""

    def __init__(self, contract: "RobotContract") -> None:
        super().__init__(contract)
        self.contract = contract
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
        return 0.5 if self.contract.kind == "quadrotor" else 0.0

    def make(self, config: Any) -> Any:
        """Create a driver of a robot at the origin."""
        hover_m = self.height_m or 0.2
        spec = RobotSpec(
            name="checked",
            kind=self.contract.kind,
            start_m=(0.0, 0.0, 0.0),
            start_yaw_rad=0.0,
            radius_m=0.2,
            hover_m=hover_m,
            max_speed_mps=1.0,
            max_acceleration_mps2=1.0,
        )
        return self.contract.plugin.make(config, spec, self.surroundings)

    async def start(self) -> None:
        """Run the driver in the background."""
        self.task = asyncio.create_task(self.driver.run(self._report))

    async def exchange(self, situation: str = "the robot was connected") -> None:
        """Wait for a report that comes from now on."""
        count = len(self.reports)
        failure = f"{situation}, and nothing was reported"
        await self.until(lambda: len(self.reports) > count, failure)

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
        if self.contract.kind == "quadrotor":
            order = self.next()
            self.tell(TakeOff(order, self.height_m))
            await self.done(order, "it was told to take off")

    async def go(self, *path_m: Vec3) -> None:
        """Go along a path, and wait until the driver reports arrival."""
        order = self.next()
        self.tell(FollowPath(order, path_m))
        await self.done(order, f"it was sent to {path_m[-1]}")
        self.require_near(path_m[-1])

    async def go_far(self) -> int:
        """Begin to go to a place far away. Return the order."""
        order = self.next()
        start_m = self.reports[-1][1].position_m
        self.tell(FollowPath(order, (self.place(self.contract.far_m),)))

        def has_moved() -> bool:
            position_m = self.reports[-1][1].position_m
            return math.dist(start_m, position_m) > self.contract.near_m

        await self.until(has_moved, "it was sent far away, and no report said that it moves")
        return order

    async def done(self, order: int, situation: str) -> None:
        """Wait until an order is done."""
        failure = f"{situation}, and was never done"
        await self.until(lambda: "done" in self.states(order), failure, DONE)
        await self.exchange()

    async def still(self, situation: str) -> None:
        """Wait until the robot reports that it stands, and goes on standing."""
        failure = f"{situation}, and it did not stand still"
        await self.until(lambda: self.speed_mps() < STILL_MPS, failure)
        place = self.reports[-1][1].position_m
        for _ in range(5):
            await self.exchange()
        # a robot that only passed through standing still would be elsewhere by now
        moved_m = math.dist(place, self.reports[-1][1].position_m)
        require(moved_m <= self.contract.near_m, f"{situation}, and it went on after it had stood still")

    def speed_mps(self) -> float:
        """Return the last reported speed."""
        if not self.reports:
            return 0.0
        return math.hypot(*self.reports[-1][1].velocity_mps)

    def require_near(self, place_m: Vec3) -> None:
        """Raise CheckFailedError unless the robot is at a place."""
        away_m = math.dist(self.reports[-1][1].position_m, place_m)
        failure = f"it was said to be done {away_m:.2f} m away from {place_m}"
        require(away_m <= self.contract.near_m, failure, DONE)

    def _report(self, item: ReportItem) -> None:
        self.health.note_thread("report")
        if isinstance(item, RobotReport):
            self.reports.append((self.clock.now_ns(), item))
        elif isinstance(item, OrderStatus):
            self.statuses.append(item)
        else:
            self.losses.append(item)


class RobotContract(DeviceContract):
    """Promises of a robot driver, with a fake robot that replaces the real one and moves as ordered.

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
    shows_motion: bool = False
    """True if `is_moving` tells whether the fake robot moves."""

    def is_moving(self, device: Any) -> bool:
        """Return True if the given fake robot moves."""
        raise NotImplementedError

    def trial(self) -> RobotTrial:
        """Return a trial of the driver, which is made at once. Raises CheckFailedError if it cannot be."""
        return RobotTrial(self)

    @promise()
    async def test_reports(self) -> None:
        """Reports where the robot is, with finite values and times of the clock, 10 times a second."""
        remedy = "Report from the robot's messages, or poll it, at 10 Hz, with the surroundings' clock"
        async with self.trial() as trial:
            await trial.begin()
            for _ in range(REPORTS):
                await trial.exchange()
            for now_ns, report in trial.reports:
                numbers = (*report.position_m, report.yaw_rad, *report.velocity_mps)
                is_finite = all(map(math.isfinite, numbers))
                require(is_finite, f"it reported {report}, which has a value that is no number", remedy)
                age_s = (now_ns - report.stamp_ns) / NS_PER_S
                is_new = -0.1 <= age_s <= MAX_POSE_AGE_S
                require(is_new, f"the stamp of a report was {age_s:.1f} s old by the given clock", remedy)
            first_ns = trial.reports[0][0]
            last_ns = trial.reports[-1][0]
            span_s = (last_ns - first_ns) / NS_PER_S
            count = len(trial.reports)
            failure = f"{count} reports came in {span_s:.1f} s"
            require(span_s * MIN_RATE_HZ <= count, failure, remedy)
            require(not trial.reports[-1][1].is_flying, "a robot on the ground was reported to fly")

    @promise()
    async def test_goes_where_sent(self) -> None:
        """Goes along a path to its end, obeys the newest command alone, and stops on request."""
        async with self.trial() as trial:
            await trial.begin()
            await trial.rise()
            await trial.go(trial.place(0.5), trial.place(0.5, 0.5))
            await trial.still("its path was done")
            # An order that a newer one replaces is never done
            replaced = await trial.go_far()
            await trial.go(trial.place(0.0, 0.6))
            stopped = await trial.go_far()
            trial.tell(Stop(trial.next()))
            await trial.still("it was told to stop")
            done = "done" in trial.states(replaced) + trial.states(stopped)
            require(not done, "an order that was replaced or stopped was reported as done", DONE)
            x_m = trial.reports[-1][1].position_m[0]
            await trial.go(trial.place(x_m + 0.5))

    @promise(lambda self: self.follows)
    async def test_follows(self) -> None:
        """Follows a place that moves, and stays at the last one."""
        async with self.trial() as trial:
            await trial.begin()
            await trial.rise()
            for step in range(20):
                place_m = trial.place(0.03 * step)
                trial.tell(Follow(trial.next(), place_m))
                await asyncio.sleep(0.02)
            target = trial.place(0.57)

            def is_near() -> bool:
                return math.dist(trial.reports[-1][1].position_m, target) < self.near_m

            await trial.until(
                is_near,
                f"it was to follow to {target}, and did not get there",
                "Take each Follow as the place to be at, and stay there when no further one comes",
            )
            await trial.still("no further place came")

    @promise(lambda self: self.kind == "quadrotor")
    async def test_takes_off_and_lands(self) -> None:
        """Takes off and lands, and says whether it flies."""
        remedy = "Set is_flying from the first rise to the touch-down"
        async with self.trial() as trial:
            await trial.begin()
            await trial.rise()
            require(trial.reports[-1][1].is_flying, "it had taken off and was not reported to fly", remedy)
            order = trial.next()
            trial.tell(Land(order, (0.5, 0.0, 0.0)))
            await trial.done(order, "it was told to land")
            require(not trial.reports[-1][1].is_flying, "it had landed and was reported to fly", remedy)
            trial.require_near((0.5, 0.0, 0.0))

    @promise()
    async def test_odd_commands(self) -> None:
        """Survives commands that make no sense: without points, no numbers, twice, at the wrong time."""
        async with self.trial() as trial:
            await trial.begin()
            for _ in range(2):
                trial.tell(Stop(trial.next()))
                trial.tell(Land(trial.next()))
                trial.tell(Land(trial.next(), NOWHERE))
                trial.tell(FollowPath(trial.next(), ()))
                trial.tell(FollowPath(trial.next(), (NOWHERE,)))
                trial.tell(Follow(trial.next(), NOWHERE))
                trial.tell(TakeOff(trial.next(), math.nan))
                await trial.exchange("commands made no sense")
            place = trial.reports[-1][1].position_m
            away_m = math.dist(place, (0.0, 0.0, 0.0))
            require(
                away_m <= self.near_m,  # not if it is no number
                f"commands made no sense, and it went to {place}",
                "Report OrderStatus(order, 'refused', reason) for what the robot cannot do",
            )
            await trial.rise()
            await trial.go(trial.place(0.4))

    @promise()
    async def test_waits_for_robot(self) -> None:
        """Takes commands at once while the robot is away, forgets them when it comes, and tells its loss."""
        async with self.trial() as trial:
            await trial.begin(is_plugged=False)
            began_s = time.monotonic()
            for _ in range(1000):
                path_m = (trial.place(self.far_m),)
                trial.tell(FollowPath(trial.next(), path_m))
            took_s = time.monotonic() - began_s
            require(took_s <= MAX_COMMANDS_S, f"1000 commands took {took_s:.1f} s", "Keep the newest alone")
            await trial.plug()
            if type(trial.device) is FakeDevice or not trial.device.is_connected:
                return
            for _ in range(10):
                await trial.exchange()
            is_still = trial.speed_mps() <= STILL_MPS
            require(is_still, "the robot came, and moved by what was ordered before", "Forget it in `run`")
            # The loss that counts is the one that comes now
            trial.losses.clear()
            await trial.device.unplug()
            remedy = "Report LinkLost(reason), with what to do, as soon as the connection ends"
            await trial.until(
                lambda: bool(trial.losses), "the robot vanished and no LinkLost said so", remedy
            )
            require(trial.losses[-1].reason.strip(), "the reason of LinkLost is empty", remedy)
            await trial.plug("the robot came back")

    @promise(lambda self: self.shows_motion)
    async def test_stops_at_end(self) -> None:
        """Stops the robot when it ends."""
        async with self.trial() as trial:
            await trial.begin()
            await trial.rise()
            await trial.go_far()
            await trial.end()
            remedy = "Send the robot's command to stop in `finally` of `run`, and wait until it has left"
            failure = "the driver ended and the robot went on"
            await trial.until(lambda: not self.is_moving(trial.device), failure, remedy)
