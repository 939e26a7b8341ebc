"""Properties of the drift filter for any input."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftFilter, DriftPose, DriftSettings, Fix
from pointit.services.localizer.drift.state import DriftState
from tests.unit.localizer.person import EYES_M, angles, yaw_difference

EYES = (0.0, 0.0, EYES_M)
metres = st.floats(-20.0, 20.0)
places = st.tuples(metres, metres, st.floats(0.0, 3.0))
times = st.integers(0, 2**62) | st.integers(0, 600 * NS_PER_S)
sigmas = st.floats(0.0, 100.0)

Step = tuple[Any, ...]

steps: st.SearchStrategy[Step] = st.one_of(
    st.tuples(st.just("anchor"), times, places, angles, st.floats(-1.5, 1.5), st.floats(0.0, 1.0)),
    st.tuples(st.just("heading"), times, angles, angles, sigmas),
    st.tuples(st.just("still"), times, st.floats(-1.0, 1.0), sigmas, st.booleans()),
    st.tuples(st.just("predict"), times),
    st.tuples(st.just("reset"), times, metres, metres, angles, sigmas),
    st.tuples(st.just("lose"), times, st.booleans()),
)


def some_fix(x: float, y: float, yaw: float, sigma: float, stamp_ns: int) -> Fix:
    half = np.array([[sigma, 0.0, 0.0], [0.5, 0.2, 0.0], [0.1, sigma, 0.05]])
    return Fix(x_m=x, y_m=y, yaw_rad=yaw, covariance=half @ half.T, stamp_ns=stamp_ns)


def apply(drift: DriftFilter, step: Step) -> None:
    match step:
        case ("anchor", stamp_ns, target, azimuth, elevation, spread):
            ray = vector.direction(azimuth, elevation)
            drift.update_anchor(stamp_ns, target, EYES, ray, spread_rad=spread)
        case ("heading", stamp_ns, wall, azimuth, sigma):
            drift.update_heading(stamp_ns, wall, vector.direction(azimuth, 0.0), sigma)
        case ("still", stamp_ns, rate, sigma, raised):
            drift.update_rest_rate(stamp_ns, rate, sigma, is_raised=raised)
        case ("predict", stamp_ns):
            drift.predict(stamp_ns)
        case ("reset", stamp_ns, x, y, yaw, sigma):
            drift.reset(some_fix(x, y, yaw, sigma, stamp_ns))
        case ("lose", stamp_ns, restarted):
            drift.reset_yaw(stamp_ns, is_restarted=restarted)
        case _:
            raise AssertionError(step)


def test_it_starts_as_uncertain_of_the_imu_as_its_settings_say() -> None:
    trust = DriftSettings(rate_sigma_radps=0.002, creep_sigma_radps=0.0005)
    _, covariance = DriftState(some_fix(0.0, 0.0, 0.0, 0.1, 0), trust).moments()
    assert np.sqrt(np.diagonal(covariance)[3:]) == pytest.approx([0.002, 0.0005])


def check(pose: DriftPose, whole: NDArray[np.float64]) -> None:
    values = (pose.x_m, pose.y_m, pose.yaw_rad, pose.yaw_rate_radps, pose.yaw_rate_sigma_radps)
    assert all(map(math.isfinite, values))
    assert np.all(np.isfinite(whole))
    assert np.array_equal(whole, whole.T)
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-12))
    assert np.all(np.diag(whole) >= 0.0)
    assert np.linalg.eigvalsh(whole / np.outer(scale, scale))[0] >= -1e-6
    assert pose.yaw_sigma_rad <= math.pi + 1e-9
    assert abs(pose.yaw_rad) <= math.pi


@settings(max_examples=150)
@example([("predict", 76830445), ("heading", 0, 0.0, 0.0, 4.9e-55), ("reset", 0, 0.0, 0.0, 0.0, 6.0)], 0.0)
@example([("heading", 0, 0.0, 0.0, 1e-200)] * 3, 0.0)
@given(st.lists(steps, max_size=12), sigmas)
def test_whatever_happens_the_covariance_stays_one(happened: list[Step], sigma: float) -> None:
    drift = DriftFilter(some_fix(0.0, 0.0, 0.0, sigma, 0))
    for step in happened:
        apply(drift, step)
        check(drift.at(0), drift._state.moments()[1])
    check(drift.at(2**62), drift._state.moments()[1])


@given(st.lists(st.floats(20.0, 120.0), min_size=1, max_size=6), st.floats(-0.4, 0.4), st.integers(0, 999))
def test_the_yaw_gets_surer_by_an_anchor_and_less_sure_in_between(
    pauses: list[float], rate_degps: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    spread = np.diag([0.1, 0.1, math.radians(3.0)]) ** 2
    drift = DriftFilter(Fix(x_m=0.0, y_m=0.0, yaw_rad=0.0, covariance=spread, stamp_ns=0))
    at_s = 0.0
    for pause in pauses:
        last = drift.at(round(at_s * NS_PER_S)).yaw_sigma_rad
        for part in (0.2, 0.5, 1.0):
            now = drift.predict(round((at_s + part * pause) * NS_PER_S)).yaw_sigma_rad
            assert now > last
            last = now
        at_s += pause
        around, yaw = rng.uniform(-math.pi, math.pi), math.radians(rate_degps) * at_s
        target = (3.0 * math.cos(around), 3.0 * math.sin(around), 0.5)
        ray = vector.direction(around - yaw, math.atan2(0.5 - EYES_M, 3.0))
        assert drift.update_anchor(round(at_s * NS_PER_S), target, EYES, ray).accepted
        assert drift.at(round(at_s * NS_PER_S)).yaw_sigma_rad < last


World = Callable[[Vec3], Vec3]


def history(
    world: World, yaw: Callable[[float], float], hand: float, seed: int
) -> tuple[list[tuple[object, ...]], DriftPose]:
    """Return the filter's results for anchors in that world; `hand` is -1 if {H} is mirrored."""
    rng = np.random.default_rng(seed)
    # isotropic, so that it is the same in every world
    covariance = np.diag([0.15**2, 0.15**2, math.radians(3.0) ** 2])
    x, y, _ = world((0.3, -0.2, 0.0))
    drift = DriftFilter(Fix(x_m=x, y_m=y, yaw_rad=yaw(0.5), covariance=covariance, stamp_ns=0))
    said: list[tuple[object, ...]] = []
    for minute in range(1, 7):
        at_ns = minute * 60 * NS_PER_S
        around, beside = rng.uniform(-math.pi, math.pi), rng.normal(0.0, math.radians(2.0))
        if minute == 4:
            beside += math.radians(60.0)
        target = (0.3 + 3.0 * math.cos(around), -0.2 + 3.0 * math.sin(around), 0.4)
        azimuth = around + beside - 0.5 - math.radians(0.3) * minute * 60
        ray = vector.direction(hand * azimuth, math.atan2(0.4 - EYES_M, 3.0) + 0.02)
        result = drift.update_anchor(at_ns, world(target), EYES, ray)
        said.append(
            (result.accepted, round(hand * result.azimuth_error_rad, 6), round(result.elevation_error_rad, 6))
        )
    return said, drift.predict(400 * NS_PER_S)


@given(
    angles,
    st.floats(-100.0, 100.0),
    st.floats(-100.0, 100.0),
    st.sampled_from((1.0, -1.0)),
    st.integers(0, 99),
)
def test_a_turned_shifted_or_mirrored_world_gives_the_same(
    turn: float, east: float, north: float, hand: float, seed: int
) -> None:
    def world(place: Vec3) -> Vec3:
        x, y, z = vector.rotate_z((place[0], hand * place[1], place[2]), turn)
        return (x + east, y + north, z)

    plain, there = history(lambda place: place, lambda yaw: yaw, 1.0, seed)
    said, pose = history(world, lambda yaw: hand * yaw + turn, hand, seed)
    assert [accepted for accepted, *_ in said] == [True, True, True, False, True, True]
    for a, b in zip(said, plain, strict=True):
        assert np.allclose(np.array(a, dtype=np.float64), np.array(b, dtype=np.float64), atol=2e-6)
    assert abs(yaw_difference(pose.yaw_rad, hand * there.yaw_rad + turn)) < 1e-6
    assert np.allclose((pose.x_m, pose.y_m), world((there.x_m, there.y_m, 0.0))[:2], atol=1e-6)
    assert abs(pose.yaw_sigma_rad - there.yaw_sigma_rad) < 1e-9
    assert abs(pose.position_sigma_m - there.position_sigma_m) < 1e-9
    assert abs(pose.yaw_rate_radps - hand * there.yaw_rate_radps) < 1e-9
