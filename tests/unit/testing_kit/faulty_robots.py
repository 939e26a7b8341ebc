"""Robot drivers with one fault each, made from the simulated one, and the check that must catch it."""

import math
from dataclasses import replace

from pointit.plugins import (
    Command,
    Follow,
    FollowPath,
    OrderStatus,
    Report,
    ReportItem,
    RobotReport,
    Stop,
    TakeOff,
)
from pointit.services.robot.drivers.sim_driver import SimDriver
from pointit_lab.devices.contracts.robots import TestSimulatedRobot
from tests.unit.testing_kit.faults import CaughtBy

caught_by = CaughtBy(TestSimulatedRobot)


class _Changed(SimDriver):
    """Reports what `changed` makes of it."""

    async def run(self, report: Report) -> None:
        def told(item: ReportItem) -> None:
            if (other := self.changed(item)) is not None:
                report(other)

        await super().run(told)

    def changed(self, item: ReportItem) -> ReportItem | None:
        return item


@caught_by("reports", "no number")
class ReportsNoNumber(_Changed):
    def changed(self, item: ReportItem) -> ReportItem | None:
        return replace(item, yaw_rad=math.nan) if isinstance(item, RobotReport) else item


@caught_by("reports", "stamp of a report was .* old")
class StampsByAnotherClock(_Changed):
    def changed(self, item: ReportItem) -> ReportItem | None:
        return replace(item, stamp_ns=1) if isinstance(item, RobotReport) else item


@caught_by("reports", "reports came in")
class ReportsSeldom(_Changed):
    count = 0

    def changed(self, item: ReportItem) -> ReportItem | None:
        self.count += 1
        return item if self.count % 50 == 0 or not isinstance(item, RobotReport) else None


@caught_by("goes_where_sent", "never done")
class NeverSaysDone(_Changed):
    def changed(self, item: ReportItem) -> ReportItem | None:
        is_done = isinstance(item, OrderStatus) and item.state == "done"
        return None if is_done else item


@caught_by("goes_where_sent", "no report said that it moves")
class KeepsTheFirst(SimDriver):
    busy = False

    def command(self, command: Command) -> None:
        if not (self.busy and isinstance(command, FollowPath)):
            super().command(command)
        self.busy = isinstance(command, FollowPath)


@caught_by("goes_where_sent", "did not stand still")
class DoesNotStop(SimDriver):
    def command(self, command: Command) -> None:
        if not isinstance(command, Stop):
            super().command(command)


@caught_by("follows", "did not get there")
class DoesNotFollow(SimDriver):
    def command(self, command: Command) -> None:
        if not isinstance(command, Follow):
            super().command(command)


@caught_by("takes_off_and_lands", "was not reported to fly")
class NeverFlies(_Changed):
    def changed(self, item: ReportItem) -> ReportItem | None:
        return replace(item, is_flying=False) if isinstance(item, RobotReport) else item


@caught_by("odd_commands", "`command` raised ValueError")
class RaisesForOddCommands(SimDriver):
    def command(self, command: Command) -> None:
        height_m = command.height_m if isinstance(command, TakeOff) else 0.0
        if math.isnan(height_m):
            raise ValueError("no height")
        super().command(command)


@caught_by("waits_for_robot", "nothing was reported")
class DrownsInCommands(SimDriver):
    waiting = 0

    def command(self, command: Command) -> None:
        self.waiting += 1
        super().command(command)

    async def run(self, report: Report) -> None:
        def told(item: ReportItem) -> None:
            if self.waiting < 1000:
                report(item)

        await super().run(told)
