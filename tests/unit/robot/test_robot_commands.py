"""`pointit robot list` and `stop`, on a bus in memory."""

import pytest
from click.testing import CliRunner

from pointit.cli.robots.robot import find_robots, rows, stop, stop_robots
from pointit.schemas import RobotPlan
from pointit.schemas.topics import ROBOT_PLAN
from tests.unit.robot.flight import ROBOT, Pilotage, flown


@flown()
async def test_a_robot_is_found_and_stopped_and_an_absent_one_is_said(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    bus = pilotage.bench.bus
    (row,) = rows(await find_robots(bus))
    assert (row["robot"], row["kind"], row["phase"], row["user"]) == (ROBOT, "quadrotor", "landed", "")
    assert (row["x_m"], row["reason"]) == (0.0, "")
    problems = await stop_robots(bus, [ROBOT, "nobody"], "a child runs there")
    assert list(problems) == ["nobody"]
    stopped = await pilotage.until(lambda state: bool(state.reason))
    assert "(a child runs there)" in stopped.reason


@flown()
async def test_a_robot_whose_process_was_killed_is_listed_as_lost(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    pilotage.bench.put(ROBOT_PLAN, RobotPlan(stamp_ns=1), "cart")  # as the keeper has it
    there, gone = sorted(rows(await find_robots(pilotage.bench.bus)), key=lambda row: row["phase"] == "lost")
    assert there["robot"] == ROBOT
    assert (gone["robot"], gone["phase"], gone["x_m"]) == ("cart", "lost", None)
    assert "process has ended" in str(gone["reason"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "name the robots to stop, or give --all"),
        ([ROBOT, "--all"], "give either the robots to stop or --all, not both"),
    ],
    ids=["none", "both"],
)
def test_robots_to_stop_are_named_or_all(arguments: list[str], message: str) -> None:
    result = CliRunner().invoke(stop, arguments)
    assert result.exit_code == 2
    assert message in result.output
