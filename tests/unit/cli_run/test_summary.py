"""Poses at the time of localization in the summary, and their errors."""

import functools

import pytest

from pointit.cli.summary import true_yaw_deg
from pointit.launch.run.monitor import Monitor
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.schemas import Localization, UserPose
from pointit.schemas.topics import LOCALIZATION, POSE
from pointit.services.user_sim.config import UserSimConfig
from tests.support.bench import until
from tests.unit.cli_run.drawn import monitor_of

S = 1_000_000_000


def pose(stamp_s: float, x_m: float, sigma_m: float, method: str = "static_targets") -> UserPose:
    variance = sigma_m**2
    return UserPose.model_validate(
        {
            "stamp_ns": round(stamp_s * S),
            "position_m": (x_m, 0.0, 0.0),
            "yaw_rad": 0.1,
            "covariance": (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance),
            "method": method,
        }
    )


def solved(stamp_s: float, **more: object) -> Localization:
    return Localization.model_validate({"stamp_ns": round(stamp_s * S), "phase": "solved", **more})


def _has(monitor: Monitor, message: UserPose | Localization) -> bool:
    return message in (monitor.poses.get("anna"), monitor.localizations.get("anna"))


async def after(*told: UserPose | Localization) -> Monitor:
    """Return a monitor that was told this, in this order."""
    monitor = monitor_of()
    bus = MemoryBus(LocalBroker())
    monitor.attach(bus)
    poses, news = bus.publisher(POSE, "anna"), bus.publisher(LOCALIZATION, "anna")
    for message in told:
        if isinstance(message, UserPose):
            poses.put(message)
        else:
            news.put(message)
        await until(functools.partial(_has, monitor, message))
    await bus.close()
    return monitor


@pytest.mark.parametrize("pose_first", [True, False])
async def test_a_pose_is_kept_as_it_was_found_and_not_as_it_drifts(pose_first: bool) -> None:  # noqa: FBT001 - a parameter
    found, end = pose(9.9, 1.0, 0.2), solved(10.0)
    monitor = await after(*((found, end) if pose_first else (end, found)), pose(60.0, 1.0, 0.9))
    assert monitor.found["anna"] == pose(9.9, 1.0, 0.2)


async def test_who_is_found_again_is_found_there() -> None:
    monitor = await after(
        pose(9.9, 1.0, 0.2),
        solved(10.0),
        pose(60.0, 1.0, 0.9),
        Localization(stamp_ns=61 * S, phase="sampling"),
        pose(62.0, 1.0, 0.95),  # while they point
        pose(69.9, 3.0, 0.1),
        solved(70.0),
        pose(99.0, 3.0, 0.8),
    )
    assert monitor.found["anna"] == pose(69.9, 3.0, 0.1)
    monitor = await after(
        *(pose(9.9, 1.0, 0.2), solved(10.0), Localization(stamp_ns=61 * S, phase="sampling")),
        *(pose(62.0, 1.0, 0.95), solved(70.0), pose(69.9, 3.0, 0.1), pose(99.0, 3.0, 0.8)),
    )
    assert monitor.found["anna"] == pose(69.9, 3.0, 0.1)  # and not the one that was still there


async def test_an_anchor_finds_nobody_anew_and_who_was_told_was_not_found() -> None:
    monitor = await after(
        pose(9.9, 1.0, 0.2), solved(10.0), solved(20.0, purpose="anchor"), pose(20.0, 1.1, 0.3)
    )
    assert monitor.found["anna"] == pose(9.9, 1.0, 0.2)
    monitor = await after(pose(9.9, 1.0, 0.2), solved(10.0), pose(30.0, 2.0, 0.0, "fixed"))
    assert monitor.found == {}


def test_the_true_yaw_is_known_where_it_is_neither_drawn_nor_drifts() -> None:
    def true(**fields: object) -> float | None:
        return true_yaw_deg(UserSimConfig.model_validate(fields).model_dump())

    steady = {"yaw_rate_bias_sd_degps": 0.0}
    assert true(yaw_deg=20.0, wristband=steady) == 20.0
    assert true(yaw_deg=20.0, wristband={"yaw_drift_degpmin": 0.0}) == 20.0
    assert true(yaw_deg=20.0) is None
    assert true(yaw_deg=20.0, wristband={**steady, "yaw_drift_degpmin": 3.0}) is None
    assert true(yaw_deg=None, wristband=steady) is None
