"""Robots in the terminal view: who steers each, what it does, and why it stands."""

from typing import Any

import pytest

from pointit.cli.robots.robots_view import ROBOTS_DISPLAY
from pointit.launch.robots.robot_watcher import RobotMonitor, RobotWatcher
from pointit.launch.run.monitor import Monitor
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas import Cursor, RobotState
from pointit.schemas.topics import ROBOT_STATE, SERVICE_ALIVE
from tests.support.bench import until
from tests.unit.cli_run.drawn import monitor_of, shown


def robot(**fields: Any) -> RobotState:
    at = {"position_m": (1.0, 2.0, 0.84), "velocity_mps": (0.0, 0.0, 0.0), "yaw_rad": 0.0, "radius_m": 0.2}
    return RobotState.model_validate({"stamp_ns": 1, "kind": "quadrotor", "phase": "idle", **at, **fields})


def watched() -> tuple[Monitor, RobotMonitor]:
    """Return a monitor, and that of its robots."""
    monitor, robots = monitor_of(), RobotWatcher()
    monitor.watchers = [robots]
    return monitor, robots.monitor


def view(monitor: Monitor, width: int = 100) -> list[str]:
    return shown(monitor, width, parts=[ROBOTS_DISPLAY])


def rows(monitor: Monitor, width: int = 100) -> list[list[str]]:
    """Return the words of the lines that begin with a robot's name."""
    lines = [line.strip("│ ").split("  ") for line in view(monitor, width)]
    cells = [[cell.strip() for cell in line if cell.strip()] for line in lines]
    return [line for line in cells if line and line[0] in ("cart", "quad")]


def test_robots_are_listed_with_who_steers_them_and_where_to() -> None:
    monitor, robots = watched()
    robots.take(robot(phase="taking_off", user="anna", target_m=(3.04, -1.0, 0.2), battery=0.5), "quad")
    robots.take(robot(kind="ground", phase="stopped", reason="ben is too near; step back"), "cart")
    assert rows(monitor) == [
        ["cart", "-", "stopped", "-", "1.0, 2.0, 0.8 m", "-"],
        ["quad", "anna", "taking off", "3.0, -1.0 m", "1.0, 2.0, 0.8 m", "50%"],
    ]
    assert any("cart: ben is too near; step back" in line for line in view(monitor))


@pytest.mark.parametrize("width", [44, 60])
def test_a_narrow_terminal_shows_the_first_columns(width: int) -> None:
    monitor, robots = watched()
    robots.take(robot(phase="moving", user="anna", target_m=(3.0, -1.0, 0.2)), "quad")
    (line,) = (line for line in view(monitor, width) if "quad" in line)
    assert "anna" in line
    assert "moving" in line


def test_no_robot_takes_no_line() -> None:
    assert not any("steered by" in line for line in view(watched()[0]))


def test_one_persons_view_has_their_robot_and_free_ones() -> None:
    monitor, robots = watched()
    monitor.person = "anna"
    robots.take(robot(user="ben"), "cart")
    robots.take(robot(), "quad")
    assert [line[0] for line in rows(monitor)] == ["quad"]


def test_a_cursor_on_a_solid_names_it() -> None:
    monitor = monitor_of()
    monitor.cursors["anna"] = Cursor(stamp_ns=1, solid="plane", surface_id="floor", point_m=(0, 0, 0))
    assert any("plane floor" in line for line in shown(monitor))


def test_changes_are_told_once_whatever_their_figures() -> None:
    robots = RobotMonitor()
    states: tuple[dict[str, str], ...] = (
        {},
        {"user": "anna"},
        {"reason": "ben is 0.91 m away"},
        {"reason": "ben is 0.87 m away"},
        {},
    )
    assert [robots.take(robot(**fields), "quad") for fields in states] == [
        [],
        ["quad: anna steers it"],
        ["quad: nobody steers it", "quad: ben is 0.91 m away"],
        [],
        [],
    ]


async def test_a_robot_is_shown_as_long_as_its_service_runs() -> None:
    exchange = LocalBroker()
    bus, other = MemoryBus(exchange), MemoryBus(exchange)
    monitor, robots = watched()
    monitor.attach(bus)
    presence = other.announce(SERVICE_ALIVE, "robot.quad")
    for name in ("quad", "cart"):
        other.publisher(ROBOT_STATE, name).put(robot(user="anna"))
    await until(lambda: set(robots.states) == {"quad", "cart"})
    presence.close()
    await until(lambda: set(robots.states) == {"cart"})
    assert sorted(monitor.events) == ["cart: anna steers it", "quad: anna steers it"]
    monitor.detach()
    await bus.close()
    await other.close()
