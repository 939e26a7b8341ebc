"""Checks of drivers of robots, and the harness that their author gives."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
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
    RobotPlugin,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
)
from pointit.schemas import RobotKind
from pointit.testing import requirements
from pointit.testing.devices import FakeDevice
from pointit.testing.trial import CheckFailedError, DeviceHarness, Suite, Trial, absent, called, connected

__all__ = [
    "MAX_POSE_AGE_S",
    "REPORTS",
    "ROBOT_SUITE",
    "SLOWEST_HZ",
    "STILL_MPS",
    "RobotHarness",
    "RobotTrial",
    "cancels",
    "command_returns_at_once",
    "config_errors",
    "follows",
    "goes_where_sent",
    "newest_wins",
    "notices_loss",
    "odd_commands",
    "parameters",
    "reports",
    "stops",
    "stops_at_end",
    "takes_off_and_lands",
    "tells_loss",
    "waits_for_robot",
]


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


ROBOT_SUITE = Suite[RobotHarness]()
MAX_POSE_AGE_S = 2.0
"""Greatest age of a pose when it is reported, s."""
REPORTS = 10
SLOWEST_HZ = 5.0
"""Least rate of reports: they are promised at 10 Hz, and other processes may take time meanwhile, Hz."""


@ROBOT_SUITE.check("Operators see the summary and the parameters in `pointit plugin list` and in helps")
async def parameters(harness: RobotHarness) -> None:
    """Has a summary of one line, and a description for each parameter."""
    requirements.require_parameters(harness.plugin)


@ROBOT_SUITE.check("Raise pointit.plugins.ConfigError from `make`, with one sentence; connect in `run`")
async def config_errors(harness: RobotHarness) -> None:
    """Refuses parameters that cannot work, with ConfigError and nothing else, and opens nothing yet."""
    await requirements.config_errors(harness)


@ROBOT_SUITE.check("Report from the robot's own messages, or poll it, at 10 Hz, with the surroundings' clock")
async def reports(harness: RobotHarness) -> None:
    """Reports where the robot is, with finite values and times of the clock, 10 times a second."""
    async with connected(harness.trial()) as trial:
        for _ in range(REPORTS):
            await trial.exchange()
        for now_ns, report in trial.reports:
            numbers = (*report.position_m, report.yaw_rad, *report.velocity_mps)
            if not all(map(math.isfinite, numbers)):
                raise CheckFailedError(f"it reported {report}, which has a value that is no number")
            age_s = (now_ns - report.stamp_ns) / NS_PER_S
            if not -0.1 <= age_s <= MAX_POSE_AGE_S:
                raise CheckFailedError(f"the stamp of a report was {age_s:.1f} s old by the given clock")
        span_s = (trial.reports[-1][0] - trial.reports[0][0]) / NS_PER_S
        if span_s * SLOWEST_HZ > len(trial.reports):
            raise CheckFailedError(f"{len(trial.reports)} reports came in {span_s:.1f} s")
        if trial.reports[-1][1].is_flying:
            raise CheckFailedError("a robot on the ground was reported to fly")
        trial.health.require_in_loop()


@ROBOT_SUITE.check("Report OrderStatus(order, 'done') when the robot is there, and not before")
async def goes_where_sent(harness: RobotHarness) -> None:
    """Goes along a path to its end, and says when it is done."""
    async with connected(harness.trial()) as trial:
        await trial.rise()
        order = trial.next()
        trial.tell(FollowPath(order, (trial.place(0.5), trial.place(0.5, 0.5))))
        await trial.done(order, "it was sent along two points")
        trial.require_near(trial.place(0.5, 0.5))
        await trial.still("its path was done")


@ROBOT_SUITE.check("Drop the order before, here and at the robot, and report it as cancelled if at all")
async def newest_wins(harness: RobotHarness) -> None:
    """Obeys the newest command; the one before is over."""
    async with connected(harness.trial()) as trial:
        await trial.rise()
        first = trial.next()
        trial.tell(FollowPath(first, (trial.place(harness.far_m),)))
        await trial.exchange()
        await trial.go(trial.place(0.0, 0.6))
        if "done" in trial.states(first):
            raise CheckFailedError("an order that was replaced was reported as done")


@ROBOT_SUITE.check("Send the robot's own command to stop, before anything else that waits to be sent")
async def stops(harness: RobotHarness) -> None:
    """Stops on request, and does nothing further."""
    async with connected(harness.trial()) as trial:
        await trial.rise()
        order = trial.next()
        trial.tell(FollowPath(order, (trial.place(harness.far_m),)))
        await trial.moving()
        trial.tell(Stop(trial.next()))
        await trial.still("it was told to stop")
        if "done" in trial.states(order):
            raise CheckFailedError("an order that was stopped was reported as done")
        await trial.go(trial.place(trial.reports[-1][1].position_m[0] + 0.5))


@ROBOT_SUITE.check(
    "Take each Follow as the place to be at, and stay there when no further one comes",
    lambda harness: harness.follows,
)
async def follows(harness: RobotHarness) -> None:
    """Follows a place that moves, and stays at the last one."""
    async with connected(harness.trial()) as trial:
        await trial.rise()
        for step in range(20):
            trial.tell(Follow(trial.next(), trial.place(0.03 * step)))
            await asyncio.sleep(0.02)
        target = trial.place(0.57)
        await trial.until(
            lambda: math.dist(trial.reports[-1][1].position_m, target) < harness.near_m,
            f"it was to follow to {target}, and did not get there",
        )
        await trial.still("no further place came")


@ROBOT_SUITE.check(
    "Set is_flying from the first rise to the touch-down, and say done when it hovers, or stands",
    lambda harness: harness.kind == "quadrotor",
)
async def takes_off_and_lands(harness: RobotHarness) -> None:
    """Takes off and lands, and says whether it flies."""
    async with connected(harness.trial()) as trial:
        await trial.rise()
        if not trial.reports[-1][1].is_flying:
            raise CheckFailedError("it had taken off and was not reported to fly")
        order = trial.next()
        trial.tell(Land(order, (0.5, 0.0, 0.0)))
        await trial.done(order, "it was told to land")
        if trial.reports[-1][1].is_flying:
            raise CheckFailedError("it had landed and was reported to fly")
        trial.require_near((0.5, 0.0, 0.0))


@ROBOT_SUITE.check("Report OrderStatus(order, 'refused', reason) for what the robot cannot do")
async def odd_commands(harness: RobotHarness) -> None:
    """Survives commands that make no sense: without points, no numbers, twice, when it is not the time."""
    nowhere = (math.nan, math.inf, 0.0)
    async with connected(harness.trial()) as trial:
        for _ in range(2):
            trial.tell(Stop(trial.next()))
            trial.tell(Land(trial.next()))
            trial.tell(Land(trial.next(), nowhere))
            trial.tell(FollowPath(trial.next(), ()))
            trial.tell(FollowPath(trial.next(), (nowhere,)))
            trial.tell(Follow(trial.next(), nowhere))
            trial.tell(TakeOff(trial.next(), math.nan))
            await trial.exchange("commands made no sense")
        place = trial.reports[-1][1].position_m
        if not all(map(math.isfinite, place)) or math.dist(place, (0.0, 0.0, 0.0)) > harness.near_m:
            raise CheckFailedError(f"commands made no sense, and it went to {place}")
        await trial.rise()
        await trial.go(trial.place(0.4))


def notices_loss(harness: RobotHarness) -> bool:
    """Return True if the driver can notice that its robot has vanished."""
    return harness.device is not FakeDevice and harness.example().is_connected


@ROBOT_SUITE.check(
    "Connect in a loop, and forget in `run` what was ordered before the robot was there", notices_loss
)
async def waits_for_robot(harness: RobotHarness) -> None:
    """Waits for a robot that is not there yet, and does nothing that was ordered meanwhile."""
    async with absent(harness.trial()) as trial:
        trial.tell(FollowPath(trial.next(), (trial.place(harness.far_m),)))
        await trial.plug()
        for _ in range(10):
            await trial.exchange()
        if trial.speed_mps() > STILL_MPS:
            raise CheckFailedError("the robot came, and moved by what was ordered before")


@ROBOT_SUITE.check("Report LinkLost(reason), with what to do, as soon as the connection ends", notices_loss)
async def tells_loss(harness: RobotHarness) -> None:
    """Tells that the robot is gone, and reports again when it is back."""
    async with connected(harness.trial()) as trial:
        for _ in range(2):
            trial.losses.clear()
            await trial.device.unplug()
            await trial.until(lambda: bool(trial.losses), "the robot vanished and no LinkLost said so")
            if not trial.losses[-1].reason.strip():
                raise CheckFailedError("the reason of LinkLost is empty")
            await trial.plug("the robot came back")


@ROBOT_SUITE.check(
    "Send the robot's command to stop in `finally` of `run`, and wait until it has left",
    lambda harness: harness.is_moving is not None,
)
async def stops_at_end(harness: RobotHarness) -> None:
    """Stops the robot when it ends."""
    is_moving = harness.is_moving
    if is_moving is None:
        return
    async with connected(harness.trial()) as trial:
        await trial.rise()
        trial.tell(FollowPath(trial.next(), (trial.place(harness.far_m),)))
        await trial.moving()
        await trial.end()
        await trial.until(lambda: not is_moving(trial.device), "the driver ended and the robot went on")


@ROBOT_SUITE.check(
    "Await only what can be cancelled, do not catch CancelledError, and limit the last command"
)
async def cancels(harness: RobotHarness) -> None:
    """Ends within 1 s of being cancelled."""
    await requirements.cancels(harness)


@ROBOT_SUITE.check("Keep the newest command alone; a queue grows while the robot is away", alone=True)
async def command_returns_at_once(harness: RobotHarness) -> None:
    """Takes commands while the robot is away, at once, and keeps none of them waiting."""
    loop = asyncio.get_running_loop()
    async with absent(harness.trial()) as trial:
        began_s = loop.time()
        for _ in range(1000):
            trial.tell(FollowPath(trial.next(), (trial.place(1.0),)))
        if loop.time() - began_s > 1.0:
            raise CheckFailedError(f"1000 commands took {loop.time() - began_s:.1f} s")
        await trial.plug()


ROBOT_SUITE.add(
    requirements.does_not_block,
    "Call nothing that waits, such as `time.sleep` or a blocking write: use asyncio's streams, or a thread",
    alone=True,
)
ROBOT_SUITE.add(requirements.leaves_nothing, requirements.CLOSE, alone=True)
