"""Pointing: its core and its service."""

import logging
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.geometry.one_euro import OneEuro
from pointit.schemas import BodyMeasures, ImuSample, PointingOffset, UserPose, UserProfile
from pointit.schemas.topics import HEALTH, IMU, POSE, PROFILE, RAY
from pointit.services.pointing import service
from pointit.services.pointing.pointer import Freshness, Pointer
from pointit.services.pointing.service import Pointing, PointingConfig
from tests.support import there
from tests.support.bench import Bench, ManualClock, memory_bench, repeated, until
from tests.unit.schemas.strategies import messages

MS = 1_000_000
UP = PointingOffset(rung="pitch", elevation=(math.radians(3.0), 0.0, 0.0, 0.0, 0.0, 0.0), sigma_rad=0.02)


def sample(azimuth_rad: float, stamp_ns: int, device_time_ns: int | None = None) -> ImuSample:
    return ImuSample(
        stamp_ns=stamp_ns,
        orientation_xyzw=rotation.from_azimuth_elevation(azimuth_rad, -0.1),
        device_time_ns=device_time_ns,
    )


def test_the_offset_is_added_before_the_filter_and_told() -> None:
    pointer = Pointer(UserProfile(stamp_ns=0, offset=UP), one_euro=OneEuro())
    rays = [pointer.ray(sample(azimuth, at), at) for azimuth, at in ((0.3, 0), (0.4, 20 * MS))]
    first, second = rays
    assert first is not None
    assert second is not None
    assert first.raw_direction is not None
    assert vector.elevation(first.direction) == pytest.approx(
        vector.elevation(first.raw_direction) + math.radians(3.0)
    )
    assert first.elevation_correction_rad == pytest.approx(math.radians(3.0))
    assert first.elevation_sigma_rad == 0.02
    assert 0.3 < vector.azimuth(second.direction) < 0.4
    # filtered after it was corrected: both ends of the filter's step lie as high
    assert vector.elevation(second.direction) == pytest.approx(vector.elevation(first.direction), abs=1e-3)


def test_new_profile_resets_the_filter() -> None:
    pointer = Pointer(one_euro=OneEuro())
    assert pointer.ray(sample(0.0, 0), 0) is not None
    pointer.set_profile(UserProfile(stamp_ns=0, offset=UP))
    ray = there(pointer.ray(sample(0.5, 20 * MS), 20 * MS))
    assert vector.azimuth(ray.direction) == pytest.approx(0.5)


def test_repeats_do_not_hold_the_filter_back() -> None:
    """A repeat is not taken for a halt: the same movement with repeats comes out the same."""
    plain = Pointer(one_euro=OneEuro())
    repeating = Pointer(one_euro=OneEuro())
    for index in range(50):
        at = index * 20 * MS
        azimuth = 0.02 * index
        expected = there(plain.ray(sample(azimuth, at, at), at))
        found = repeating.ray(sample(azimuth, at, at), at)
        assert repeating.ray(sample(azimuth, at + 10 * MS, at), at + 10 * MS) is None
        assert (repeating.verdict, found) == ("repeated", expected)


def test_rays_are_numbered_without_gaps() -> None:
    pointer = Pointer()
    rays = [pointer.ray(sample(0.0, 0, at), 0) for at in (1, 1, 2, 3)]
    assert [ray.seq for ray in rays if ray is not None] == [1, 2, 3]


S = 1_000_000_000
NOW_NS = 1_700_000_000 * S


def still(stamp_ns: int, device_time_ns: int | None = None) -> ImuSample:
    return ImuSample(stamp_ns=stamp_ns, orientation_xyzw=rotation.IDENTITY, device_time_ns=device_time_ns)


def test_stale_and_older_samples_are_refused() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(still(1_000_000_000), 1_300_000_000) == "stale"
    assert freshness.classify(still(1_000_000_000), 1_100_000_000) == "fresh"
    assert freshness.classify(still(900_000_000), 1_000_000_000) == "stale"
    assert (freshness.count, freshness.stale) == (3, 2)


def test_one_sample_from_the_future_is_refused_and_spoils_none() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(still(NOW_NS), NOW_NS) == "fresh"
    assert freshness.classify(still(NOW_NS + 3600 * S), NOW_NS) == "stale"
    assert freshness.classify(still(2**63 - 1), NOW_NS) == "stale"
    assert freshness.classify(still(NOW_NS + S // 50), NOW_NS + S // 50) == "fresh"
    assert freshness.stale == 2


def test_only_the_device_time_proves_a_repeat() -> None:
    freshness = Freshness(0.2)
    same = [freshness.classify(still(NOW_NS + k), NOW_NS + k) for k in range(5)]  # the same orientation
    assert same == ["fresh"] * 5
    told = [freshness.classify(still(NOW_NS + 9, 77), NOW_NS + 9) for _ in range(3)]
    assert told == ["fresh", "repeated", "repeated"]
    assert (freshness.repeated, freshness.stale, freshness.restarts) == (2, 0, 0)


def test_repeat_with_a_newer_stamp_leaves_the_next_sample_fresh() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(still(NOW_NS, 0), NOW_NS) == "fresh"
    assert freshness.classify(still(NOW_NS + 30, 0), NOW_NS + 30) == "repeated"
    assert freshness.classify(still(NOW_NS + 20, 20), NOW_NS + 30) == "fresh"


def test_a_restarted_device_is_taken_and_counted() -> None:
    freshness = Freshness(0.2)
    times = (60 * S, 60 * S + 20, 5, 25, 25, 45)
    verdicts = [freshness.classify(still(NOW_NS + k, at), NOW_NS + k) for k, at in enumerate(times)]
    assert (verdicts, freshness.restarts) == (["fresh", "fresh", "fresh", "fresh", "repeated", "fresh"], 1)


def test_samples_that_overtook_each_other_are_no_restart() -> None:
    freshness = Freshness(0.2)
    times = (S, S + 40_000_000, S + 20_000_000, S + 60_000_000)
    verdicts = [freshness.classify(still(NOW_NS + k, at), NOW_NS + k) for k, at in enumerate(times)]
    assert (verdicts, freshness.restarts, freshness.stale) == (["fresh", "fresh", "stale", "fresh"], 0, 1)


@given(st.lists(st.integers(1, S), max_size=30), st.lists(st.integers(0, 29), max_size=30))
def test_every_news_is_fresh_once_however_often_it_is_said(steps: list[int], again: list[int]) -> None:
    freshness = Freshness(0.2)
    device_ns = 0
    for index, step in enumerate(steps):
        device_ns += step
        now_ns = NOW_NS + device_ns
        said = 1 + again.count(index)
        verdicts = [freshness.classify(still(now_ns, device_ns), now_ns) for _ in range(said)]
        assert verdicts == ["fresh", *["repeated"] * (said - 1)]
    assert freshness.count == len(steps) + freshness.repeated


@given(messages(UserProfile), st.lists(messages(ImuSample), min_size=1, max_size=3), st.floats(-10.0, 10.0))
def test_any_profile_and_samples_give_valid_rays(
    profile: UserProfile, samples: list[ImuSample], yaw_rad: float
) -> None:
    """Nobody else checks them: in tests they are validated."""
    pointer = Pointer(profile, one_euro=OneEuro())
    pointer.set_yaw(yaw_rad)
    for each in samples:
        assert pointer.ray(each, each.stamp_ns) is not None or pointer.verdict != "fresh"


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
        old_ns = here.clock.now_ns() - 7 * S
        async with repeated(0.05, lambda: here.point(stamp_ns=old_ns)):
            await here.warned("is 7.0 s old")

        future_ns = here.clock.now_ns() + 3600 * S
        async with repeated(0.05, lambda: here.point(stamp_ns=future_ns)):
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


async def test_ray_is_withheld_while_the_profile_may_still_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(service, "PROFILE_WAIT_S", 60.0)
    async with room(profile=None) as here:
        await here.point()
        assert here.rays == []
        await here.know(TALL)
        await here.point()
        assert [round(ray.origin_m[2], 6) for ray in here.rays] == [1.81]


async def test_pointing_uses_common_measures_and_warns_until_a_profile_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(service, "PROFILE_WAIT_S", 0.0)
    async with room(profile=None) as here:
        await here.warned("no profile of anna")
        await here.point()
        await until(lambda: bool(here.rays), what="a ray")
        assert here.rays[0].origin_m[2] == pytest.approx(1.64)
        await here.know(COMMON)
        await until(lambda: not here.health[-1].warnings, what="the warning to go")


async def test_offset_comes_with_the_profile_and_depends_on_the_pose() -> None:
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
