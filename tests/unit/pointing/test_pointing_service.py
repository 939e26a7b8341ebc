"""The service: what it takes from the bus, what it says there."""

import logging
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from pointit.geometry import rotation, vector
from pointit.schemas import BodyMeasures, ImuSample, PointingOffset, UserPose, UserProfile
from pointit.schemas.topics import HEALTH, IMU, POSE, PROFILE, RAY
from pointit.services.pointing.service import Pointing, PointingConfig
from tests.support.bench import Bench, ManualClock, memory_bench, until

S = 1_000_000_000
COMMON = UserProfile(stamp_ns=0)
TALL = UserProfile(stamp_ns=0, body=BodyMeasures(footprint_to_neck_m=1.6))


class Room:
    """Anna's service on a bench, and what it publishes."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench = bench
        self.clock = clock
        self.rays = bench.collect(RAY, "anna")
        self.health = bench.collect(HEALTH)

    async def know(self, profile: UserProfile) -> None:
        self.bench.put(PROFILE, profile, "anna")
        await self.bench.settle()

    async def point(
        self,
        azimuth_rad: float = 0.3,
        elevation_rad: float = 0.0,
        *,
        stamp_ns: int | None = None,
        device_time_ns: int | None = None,
        user: str = "anna",
    ) -> None:
        """Send a sample, stamped now unless stated."""
        orientation = rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)
        stamp_ns = self.clock.now_ns() if stamp_ns is None else stamp_ns
        sample = ImuSample(stamp_ns=stamp_ns, orientation_xyzw=orientation, device_time_ns=device_time_ns)
        self.bench.put(IMU, sample, user)
        await self.bench.settle()

    async def warned(self, text: str) -> None:
        await until(lambda: any(text in warning for h in self.health for warning in h.warnings), what=text)


@asynccontextmanager
async def room(
    config: PointingConfig | None = None, profile: UserProfile | None = COMMON
) -> AsyncGenerator[Room]:
    """Yield a room whose service has `profile`, if any."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        here = Room(bench, clock)
        bench.start(Pointing, config, "anna")
        await bench.settle()
        if profile is not None:
            await here.know(profile)
        yield here


async def test_health_says_what_is_wrong_with_the_stamps() -> None:
    async with room() as here:
        await here.point(stamp_ns=here.clock.now_ns() - 7 * S)
        await here.warned("is 7.0 s old")
        await here.point(stamp_ns=here.clock.now_ns() + 3600 * S)
        await here.warned("3600.0 s ahead of this")
        assert not here.rays
        await here.point()
        assert {ray.stamp_ns for ray in here.rays} == {here.clock.now_ns()}


async def test_the_service_uses_the_profile_and_keeps_the_stamp() -> None:
    async with room(profile=TALL) as here:
        await here.point()
        await here.point(user="ben")
        assert [ray.stamp_ns for ray in here.rays] == [here.clock.now_ns()]
        assert math.isclose(here.rays[0].origin_m[2], 1.81)


async def test_no_ray_is_of_common_measures_while_the_profile_may_still_come() -> None:
    async with room(PointingConfig(profile_wait_s=60.0), None) as here:
        await here.point()
        assert here.rays == []
        await here.know(TALL)
        await here.point()
        assert [round(ray.origin_m[2], 6) for ray in here.rays] == [1.81]


async def test_without_a_supervisor_it_goes_on_with_common_measures_and_says_so_until_one_comes() -> None:
    async with room(PointingConfig(profile_wait_s=0.0), None) as here:
        await here.warned("no profile of anna")
        await here.point()
        await until(lambda: bool(here.rays), what="a ray")
        assert here.rays[0].origin_m[2] == pytest.approx(1.64)
        await here.know(COMMON)
        await until(lambda: not here.health[-1].warnings, what="the warning to go")


async def test_the_offset_comes_with_the_profile_and_bends_with_the_pose() -> None:
    offset = PointingOffset(
        rung="polynomial",
        elevation=(math.radians(2.0), 0.0, 0.0, 0.0, 0.0, 0.0),
        azimuth=(0.0, 0.1, 0.0, 0.0, 0.0, 0.0),
        reference_rad=0.5,
        azimuth_range_rad=(-1.0, 1.0),
        sigma_rad=0.02,
    )
    async with room(PointingConfig(filter="off"), UserProfile(stamp_ns=0, offset=offset)) as here:
        await here.point()
        here.bench.put(POSE, UserPose(stamp_ns=0, position_m=(1.0, 2.0, 0.0), yaw_rad=0.4), "anna")
        await here.bench.settle()
        await here.point()
    first, second = here.rays
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
    async with room() as here:
        health = here.health

        async def send(device_time_ns: int) -> None:
            here.clock.advance(0.02)
            await here.point(device_time_ns=device_time_ns)

        def shown(name: str) -> list[float]:
            return [figure.value for figure in health[-1].figures if figure.name == name]

        for index in range(160):  # each second one repeats: three seconds
            await send(S + index // 2 * 20_000_000)
        assert len(here.rays) == 80
        await until(lambda: shown("repeated samples") == [50.0], what="the share of repeats")
        assert health[-1].warnings == ()
        for _ in range(15):  # stuck: nothing new for 0.3 s
            await send(S + 79 * 20_000_000)
        await here.warned("device is stuck")
        for device_time_ns in (5, 20_000_005, 40_000_005):  # switched off and on
            await send(device_time_ns)
        assert len(here.rays) == 83
        await until(
            lambda: shown("restarts of the wrist") == [1.0] and not health[-1].warnings, what="restart"
        )
    said = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(said) == 1
    assert "clock of the wrist went back" in said[0].message


async def test_a_finger_at_the_eyes_is_said() -> None:
    async with room(profile=UserProfile(stamp_ns=0, body=BodyMeasures(neck_to_eyes_m=0.73))) as here:
        await here.point(0.0, math.pi / 2)
        await here.warned("at the eyes")
        assert here.rays == []
