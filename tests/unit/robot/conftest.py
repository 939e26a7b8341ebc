"""Robots whose connection can be broken in every way, in the real service."""

from dataclasses import replace
from typing import Any

import pytest

from pointit.services.robot.drivers.sim_driver import SIM
from pointit.services.robot.robot_driver import ROBOTS, RobotPlugin
from tests.unit.robot.flight import FaultyDriver


@pytest.fixture
def drivers(monkeypatch: pytest.MonkeyPatch) -> list[FaultyDriver]:
    """Replace the driver sim. Return the drivers that are made from now on."""
    made: list[FaultyDriver] = []

    def make(*args: Any) -> FaultyDriver:
        made.append(FaultyDriver(*args))
        return made[-1]

    def get(_name: str) -> RobotPlugin:
        return replace(SIM, make=make)

    monkeypatch.setattr(ROBOTS, "get", get)
    return made
