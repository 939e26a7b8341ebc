"""Effect on the pose of an IMU that was restarted, turned, or given a new yaw origin."""

import math

import pytest

from pointit.geometry import rotation
from pointit.schemas import NS_PER_S, ImuSample, PointAnchor, SetPose
from pointit.schemas.topics import HEALTH, IMU, LOCALIZATION, POINT_ANCHOR, POSE, SET_POSE
from pointit.services.localizer.tracking.yaw_origin import YawOrigin
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.localizer.test_localizer_drift import FIXED, LAMPS_FIRST, USER, Wearer, ready

S = NS_PER_S
FOUND = SetPose(
    position_m=(1.5, 1.2, 0.0),
    method="static_targets",
    covariance=(0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.001),
)


def sample(t_s: float, epoch: int = 0, device_s: float | None = None) -> ImuSample:
    return ImuSample(
        stamp_ns=round(t_s * S),
        orientation_xyzw=rotation.IDENTITY,
        yaw_epoch=epoch,
        device_time_ns=None if device_s is None else round(device_s * S),
    )


def test_what_the_samples_tell() -> None:
    origin = YawOrigin()
    assert origin.add(sample(0.0, 3, 50.0)) == ""  # the first one tells nothing
    assert origin.add(sample(0.1, 3, 49.5)) == ""  # out of order
    assert origin.add(sample(0.2, 3, 50.2)) == ""
    assert origin.add(sample(0.3, 4, 50.3)) == "set"
    assert origin.add(sample(0.4, 4, 1.0)) == "restarted"
    assert origin.add(sample(0.5, 4, 1.1)) == ""
    assert origin.add(sample(0.7, 0, None)) == "set"  # who counts was restarted
    assert origin.add(sample(0.8, 0, 900.0)) == ""


async def send(bench: Bench, clock: ManualClock, epoch: int, device_s: float | None = None) -> None:
    now_ns = clock.advance(0.05)
    bench.put(IMU, sample(now_ns / S, epoch, device_s).model_copy(update={"stamp_ns": now_ns}), USER)
    await bench.settle()


@pytest.mark.parametrize(("epoch", "device_s"), [(1, 10.1), (0, 1.0)], ids=["new origin", "restarted"])
async def test_the_yaw_is_unknown_and_it_is_said_until_something_tells_it(
    epoch: int, device_s: float
) -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench)
        await ready(bench, LAMPS_FIRST)
        await bench.bus.call(SET_POSE, FOUND, USER)
        await send(bench, clock, 0, 10.0)
        count = len(wearer.poses)
        await send(bench, clock, epoch, device_s)
        assert len(wearer.poses) == count + 1
        lost = wearer.poses[-1]
        assert math.sqrt(lost.covariance[8]) >= math.pi / 2
        assert lost.position_m == pytest.approx((1.5, 1.2, 0.0))
        await until(
            lambda: any("the IMU of anna was restarted or turned" in w for w in wearer.warnings),
            what="the warning",
        )
        (warning,) = wearer.warnings
        assert "`pointit person anchor anna`" in warning
        assert "`pointit person pose anna --facing" in warning
        await send(bench, clock, epoch, device_s + 0.1)
        assert len(wearer.poses) == count + 1  # once
        await bench.bus.call(SET_POSE, FOUND, USER)
        await until(lambda: not wearer.warnings, what="the warning to go")


async def test_a_fixed_pose_that_the_origin_is_aligned_with_stays() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        poses, reports = bench.collect(POSE, USER), bench.collect(HEALTH)
        await ready(bench, FIXED)
        await send(bench, clock, 0)
        await send(bench, clock, 1)
        assert len(poses) == 1
        seen = len(reports)
        await until(lambda: len(reports) > seen, what="a report")
        assert not reports[-1].warnings


async def test_pointing_that_goes_on_meanwhile_is_refused() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        progress = bench.collect(LOCALIZATION, USER)
        await ready(bench, FIXED)
        await send(bench, clock, 0)
        await bench.bus.call(POINT_ANCHOR, PointAnchor(), USER)
        await send(bench, clock, 1)
        assert progress[-1].phase == "refused"
        assert progress[-1].reason == "the IMU of anna was restarted or turned meanwhile; start again"
