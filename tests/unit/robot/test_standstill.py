"""A robot that was told to stop and moves."""

import pytest

from pointit.schemas import NS_PER_S
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.current_order import StandstillMonitor
from pointit.services.robot.robot_driver import RobotReport


@pytest.mark.parametrize(("speed_mps", "is_told"), [(0.0, False), (0.09, False), (0.12, True)])
def test_a_robot_may_seem_to_creep_by_0_2_m_in_2_s_and_no_faster(speed_mps: float, *, is_told: bool) -> None:
    monitor = StandstillMonitor(RobotConfig(), "rover")
    told = [
        monitor.is_left(
            RobotReport(stamp_ns=tick * NS_PER_S // 50, position_m=(speed_mps * tick / 50, 0.0, 0.0)),
            tick * NS_PER_S // 50,
        )
        for tick in range(50 * 30)
    ]
    assert any(told) == is_told
    assert bool(monitor.problem) == is_told
