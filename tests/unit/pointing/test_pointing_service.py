"""The service: what it takes from the bus, what it says there."""

import logging
import math

import pytest

from pointit.geometry import rotation, vector
from pointit.schemas import BodyMeasures, ImuSample, PointingOffset, UserPose, UserProfile
from pointit.schemas.topics import HEALTH, IMU, POSE, PROFILE, RAY
from pointit.services.pointing.config import PointingConfig
from pointit.services.pointing.service import Pointing
from tests.support.bench import ManualClock, memory_bench, until

S = 1_000_000_000


def sample(
    azimuth_rad: float, elevation_rad: float, stamp_ns: int = 0, device_time_ns: int | None = None
) -> ImuSample:
    return ImuSample(
        stamp_ns=stamp_ns,
        orientation_xyzw=rotation.from_azimuth_elevation(azimuth_rad, elevation_rad),
        device_time_ns=device_time_ns,
    )


async def test_health_says_what_is_wrong_with_the_stamps() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays = bench.collect(RAY, "anna")
        health = bench.collect(HEALTH)
        bench.start(Pointing, user="anna")
        await bench.settle()
        bench.put(PROFILE, UserProfile(stamp_ns=0), "anna")
        await bench.settle()
        bench.put(IMU, sample(0, 0, clock.now_ns() - 7 * S), "anna")
        await until(lambda: any("is 7.0 s old" in text for h in health for text in h.warnings))
        bench.put(IMU, sample(0, 0, clock.now_ns() + 3600 * S), "anna")
        await until(lambda: any("3600.0 s ahead of this" in text for h in health for text in h.warnings))
        assert not rays

        def is_believed() -> bool:  # after a moment: the clock was set back
            bench.put(IMU, sample(0, 0, clock.now_ns()), "anna")
            return bool(rays)

        await until(is_believed)
        assert {ray.stamp_ns for ray in rays} == {clock.now_ns()}


async def test_the_service_uses_the_profile_and_keeps_the_stamp() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays = bench.collect(RAY, "anna")
        bench.start(Pointing, user="anna")
        await bench.settle()
        tall = BodyMeasures(footprint_to_neck_m=1.6)
        bench.put(PROFILE, UserProfile(stamp_ns=0, body=tall), "anna")
        await bench.settle()
        bench.put(IMU, sample(0.3, 0.0, clock.now_ns()), "anna")
        bench.put(IMU, sample(0.3, 0.0, clock.now_ns()), "ben")
        await bench.settle()
        assert [ray.stamp_ns for ray in rays] == [clock.now_ns()]
        assert math.isclose(rays[0].origin_m[2], 1.81)


async def test_no_ray_is_of_common_measures_while_the_profile_may_still_come() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays = bench.collect(RAY, "anna")
        bench.start(Pointing, PointingConfig(profile_wait_s=60.0), "anna")
        await bench.settle()
        bench.put(IMU, sample(0.3, 0.0, clock.now_ns()), "anna")
        await bench.settle()
        assert rays == []
        bench.put(PROFILE, UserProfile(stamp_ns=0, body=BodyMeasures(footprint_to_neck_m=1.6)), "anna")
        await bench.settle()
        bench.put(IMU, sample(0.3, 0.0, clock.now_ns()), "anna")
        await bench.settle()
        assert [round(ray.origin_m[2], 6) for ray in rays] == [1.81]


async def test_without_a_supervisor_it_goes_on_with_common_measures_and_says_so_until_one_comes() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays, health = bench.collect(RAY, "anna"), bench.collect(HEALTH)
        bench.start(Pointing, PointingConfig(profile_wait_s=0.0), "anna")
        await until(
            lambda: any("no profile of anna" in text for h in health for text in h.warnings),
            what="the warning",
        )
        bench.put(IMU, sample(0.3, 0.0, clock.now_ns()), "anna")
        await until(lambda: bool(rays), what="a ray")
        assert rays[0].origin_m[2] == pytest.approx(1.64)
        bench.put(PROFILE, UserProfile(stamp_ns=0), "anna")
        await until(lambda: not health[-1].warnings, what="the warning to go")


async def test_the_filter_is_as_configured_and_the_raw_ray_goes_beside_it() -> None:
    clock = ManualClock()
    for config, is_filtered in ((PointingConfig(), True), (PointingConfig(filter="off"), False)):
        async with memory_bench(clock) as bench:
            rays = bench.collect(RAY, "anna")
            bench.start(Pointing, config, "anna")
            await bench.settle()
            bench.put(PROFILE, UserProfile(stamp_ns=0), "anna")
            await bench.settle()
            for azimuth_rad in (0.0, 0.1):
                bench.put(IMU, sample(azimuth_rad, 0.0, clock.advance(0.02)), "anna")
                await bench.settle()
            raw = [ray.raw_direction for ray in rays]
            assert [round(vector.azimuth(each), 9) for each in raw if each] == [0.0, 0.1]
            assert (rays[1].direction != rays[1].raw_direction) is is_filtered
            assert 0.0 < vector.azimuth(rays[1].direction) <= 0.1


async def test_the_offset_comes_with_the_profile_and_bends_with_the_pose() -> None:
    clock = ManualClock()
    offset = PointingOffset(
        rung="polynomial",
        elevation=(math.radians(2.0), 0.0, 0.0, 0.0, 0.0, 0.0),
        azimuth=(0.0, 0.1, 0.0, 0.0, 0.0, 0.0),
        reference_rad=0.5,
        azimuth_range_rad=(-1.0, 1.0),
        sigma_rad=0.02,
    )
    async with memory_bench(clock) as bench:
        rays = bench.collect(RAY, "anna")
        bench.start(Pointing, PointingConfig(filter="off"), "anna")
        await bench.settle()
        bench.put(PROFILE, UserProfile(stamp_ns=0, offset=offset), "anna")
        await bench.settle()
        bench.put(IMU, sample(0.3, 0.0, clock.now_ns()), "anna")
        await bench.settle()
        bench.put(POSE, UserPose(stamp_ns=0, position_m=(1.0, 2.0, 0.0), yaw_rad=0.4), "anna")
        await bench.settle()
        bench.put(IMU, sample(0.3, 0.0, clock.now_ns()), "anna")
        await bench.settle()
    first, second = rays
    assert first.azimuth_correction_rad == 0.0
    assert first.elevation_correction_rad == pytest.approx(math.radians(2.0))
    assert second.azimuth_correction_rad == pytest.approx(0.1 * (0.3 + 0.4 - 0.5))
    assert second.elevation_sigma_rad == 0.02
    assert second.raw_direction is not None
    turned = vector.direction(
        vector.azimuth(second.raw_direction) + second.azimuth_correction_rad,
        vector.elevation(second.raw_direction) + second.elevation_correction_rad,
    )
    assert vector.angle_between(turned, second.direction) < 1e-12


async def test_repeats_make_no_ray_and_are_shown(caplog: pytest.LogCaptureFixture) -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays, health = bench.collect(RAY, "anna"), bench.collect(HEALTH)
        bench.start(Pointing, user="anna")
        await bench.settle()
        bench.put(PROFILE, UserProfile(stamp_ns=0), "anna")
        await bench.settle()
        for index in range(160):  # each second one repeats: three seconds
            bench.put(IMU, sample(0.0, 0.0, clock.advance(0.02), S + index // 2 * 20_000_000), "anna")
            await bench.settle()
        assert len(rays) == 80

        def shown(name: str) -> list[float]:
            return [figure.value for figure in health[-1].figures if figure.name == name]

        await until(lambda: shown("repeated samples") == [50.0], what="the share of repeats")
        assert health[-1].warnings == ()

        for _ in range(15):  # stuck: nothing new for 0.3 s
            bench.put(IMU, sample(0.0, 0.0, clock.advance(0.02), S + 79 * 20_000_000), "anna")
            await bench.settle()
        await until(lambda: any("device is stuck" in text for text in health[-1].warnings), what="stuck")

        for device_time_ns in (5, 20_000_005, 40_000_005):  # switched off and on
            bench.put(IMU, sample(0.0, 0.0, clock.advance(0.02), device_time_ns), "anna")
            await bench.settle()
        assert len(rays) == 83
        await until(
            lambda: shown("restarts of the wrist") == [1.0] and not health[-1].warnings, what="restart"
        )
    said = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(said) == 1
    assert "clock of the wrist went back" in said[0].message


async def test_a_finger_at_the_eyes_is_said() -> None:
    body = BodyMeasures(neck_to_eyes_m=0.73)
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays, health = bench.collect(RAY, "anna"), bench.collect(HEALTH)
        bench.start(Pointing, user="anna")
        await bench.settle()
        bench.put(PROFILE, UserProfile(stamp_ns=0, body=body), "anna")
        await bench.settle()
        bench.put(IMU, sample(0.0, math.pi / 2, clock.now_ns()), "anna")
        await until(lambda: bool(health) and any("at the eyes" in text for text in health[-1].warnings))
        assert rays == []
