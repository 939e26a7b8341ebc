"""The eye-finger ray: by hand, by property, and through the service."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.schemas import BodyMeasures, ImuSample, UserProfile
from pointit.schemas.topics import HEALTH, IMU, PROFILE, RAY
from pointit.services.pointing.config import PointingConfig
from pointit.services.pointing.eye_finger import EyeFinger
from pointit.services.pointing.service import Pointing
from tests.support.bench import ManualClock, memory_bench, until

angles = st.floats(-math.pi, math.pi)
elevations = st.floats(-1.5, 1.5)


def sample(azimuth_rad: float, elevation_rad: float, stamp_ns: int = 0) -> ImuSample:
    return ImuSample(
        stamp_ns=stamp_ns,
        orientation_xyzw=rotation.from_azimuth_elevation(azimuth_rad, elevation_rad),
    )


def test_level_arm_points_down_from_the_eyes_over_the_finger() -> None:
    ray = EyeFinger().ray(sample(0.0, 0.0), 0)
    assert ray is not None
    assert ray.origin_m == (0.0, 0.0, 1.43 + 0.21)
    # the finger is 0.73 m ahead and 0.21 m below the eyes
    assert math.isclose(vector.elevation(ray.direction), math.atan2(-0.21, 0.73))
    assert math.isclose(vector.azimuth(ray.direction), 0.0)


@given(angles, elevations)
def test_the_ray_goes_through_the_fingertip(azimuth_rad: float, elevation_rad: float) -> None:
    ray = EyeFinger().ray(sample(azimuth_rad, elevation_rad), 0)
    assert ray is not None
    finger = vector.add((0.0, 0.0, 1.43), vector.scale(vector.direction(azimuth_rad, elevation_rad), 0.73))
    reach = vector.subtract(finger, ray.origin_m)
    assert vector.angle_between(reach, ray.direction) < 1e-7


@given(angles, elevations, angles)
def test_turning_the_person_turns_the_ray(azimuth_rad: float, elevation_rad: float, yaw_rad: float) -> None:
    ray = EyeFinger().ray(sample(azimuth_rad, elevation_rad), 0)
    turned = EyeFinger().ray(sample(azimuth_rad + yaw_rad, elevation_rad), 0)
    assert ray is not None
    assert turned is not None
    assert vector.angle_between(vector.turn(ray.direction, yaw_rad), turned.direction) < 1e-7


def test_stale_and_older_samples_make_no_ray() -> None:
    model = EyeFinger(stale_after_s=0.2)
    assert model.ray(sample(0, 0, stamp_ns=1_000_000_000), 1_300_000_000) is None
    assert model.ray(sample(0, 0, stamp_ns=1_000_000_000), 1_100_000_000) is not None
    assert model.ray(sample(0, 0, stamp_ns=900_000_000), 1_000_000_000) is None
    assert model.stale == 2


S = 1_000_000_000


def test_one_sample_from_the_future_makes_no_ray_and_spoils_none() -> None:
    model = EyeFinger(stale_after_s=0.2)
    now_ns = 1_700_000_000 * S
    assert model.ray(sample(0, 0, now_ns), now_ns) is not None
    assert model.ray(sample(0, 0, now_ns + 3600 * S), now_ns) is None
    assert model.ray(sample(0, 0, 2**63 - 1), now_ns) is None
    assert model.ray(sample(0, 0, now_ns + S // 50), now_ns + S // 50) is not None
    assert model.stale == 2


def test_a_clock_that_is_set_back_stops_nothing() -> None:
    model = EyeFinger(stale_after_s=0.2)
    now_ns = 1_700_000_000 * S
    assert model.ray(sample(0, 0, now_ns), now_ns) is not None
    back_ns = now_ns - 3600 * S
    assert model.ray(sample(0, 0, back_ns), back_ns) is not None
    assert model.ray(sample(0, 0, back_ns - S // 50), back_ns) is None


async def test_health_says_what_is_wrong_with_the_stamps() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays = bench.collect(RAY, "anna")
        health = bench.collect(HEALTH)
        bench.start(Pointing, user="anna")
        await bench.settle()
        bench.put(PROFILE, UserProfile(stamp_ns=0), "anna")
        await bench.settle()
        bench.put(IMU, sample(0, 0, clock.now_ns() + 3600 * S), "anna")
        await until(lambda: any("3600.0 s ahead of this" in text for h in health for text in h.warnings))
        bench.put(IMU, sample(0, 0, clock.now_ns() - 7 * S), "anna")
        await until(lambda: any("is 7.0 s old" in text for h in health for text in h.warnings))
        bench.put(IMU, sample(0, 0, clock.now_ns()), "anna")
        await bench.settle()
        assert len(rays) == 1


def test_the_left_shoulder_is_on_the_left() -> None:
    body = BodyMeasures(neck_to_shoulder_m=0.2)
    left = EyeFinger(UserProfile(stamp_ns=0, body=body, hand="left")).ray(sample(0, 0), 0)
    right = EyeFinger(UserProfile(stamp_ns=0, body=body, hand="right")).ray(sample(0, 0), 0)
    assert left is not None
    assert right is not None
    assert left.direction[1] > 0 > right.direction[1]


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
