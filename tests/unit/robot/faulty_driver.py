"""A simulated robot whose connection can be broken in every way, in the real service."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import pytest

from pointit.services.robot.drivers.sim.sim_driver import SIM, SimDriver
from pointit.services.robot.robot_driver import ROBOTS, Command, Report, ReportItem, RobotPlugin, RobotReport


class FaultyDriver(SimDriver):
    """A simulated robot. `change` replaces what it says, `is_deaf` loses what it is told."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.commands: list[Command] = []
        """All that it was told."""
        self.truth: RobotReport | None = None
        self.change: Callable[[ReportItem], Iterable[ReportItem]] = lambda item: (item,)
        self.is_deaf = False
        self.say: Report = lambda _item: None

    async def run(self, report: Report) -> None:
        """Report what `change` makes of the truth."""
        self.say = report

        def changed(item: ReportItem) -> None:
            if isinstance(item, RobotReport):
                self.truth = item
            for each in self.change(item):
                report(each)

        await super().run(changed)

    def command(self, command: Command) -> None:
        """Note the command and carry it out."""
        self.commands.append(command)
        if not self.is_deaf:
            super().command(command)


def use_faulty_driver(monkeypatch: pytest.MonkeyPatch) -> list[FaultyDriver]:
    """Replace the driver sim. Return the drivers that are made from now on."""
    made: list[FaultyDriver] = []

    def make(*args: Any) -> FaultyDriver:
        made.append(FaultyDriver(*args))
        return made[-1]

    def get(_name: str) -> RobotPlugin:
        return replace(SIM, make=make)

    monkeypatch.setattr(ROBOTS, "get", get)
    return made
