"""A resting arm measures the drift rate, a moving one does not."""

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.rest_detection import RestDetector, RestYawRate

HANGING, LEVEL = -1.45, -0.3
DRIFT_RADPS = math.radians(0.4)
HZ = 50.0


def wander(count: int, sigma_deg: float, rng: np.random.Generator, hz: float = HZ) -> NDArray[np.float64]:
    """Return the tremor of a held arm (pointing.md §7)."""
    stays = math.exp(-1.0 / (hz * 0.3))
    kicks = rng.normal(0.0, math.radians(sigma_deg) * math.sqrt(1.0 - stays**2), count)
    out = np.zeros(count)
    for i in range(1, count):
        out[i] = stays * out[i - 1] + kicks[i]
    return out


def stream(
    azimuth: Callable[[float], float],
    elevation: Callable[[float], float],
    seconds: float,
    *,
    seed: int = 0,
    start_s: float = 100.0,
    hz: float = HZ,
) -> list[tuple[Quaternion, int]]:
    rng = np.random.default_rng(seed)
    count = round(seconds * hz)
    sideways, upwards = wander(count, 0.25, rng, hz), wander(count, 0.16, rng, hz)
    return [
        (
            rotation.from_azimuth_elevation(
                azimuth(i / hz) + float(sideways[i]), elevation(i / hz) + float(upwards[i]), 0.7
            ),
            round((start_s + i / hz) * NS_PER_S),
        )
        for i in range(count)
    ]


def fed(stillness: RestDetector, samples: Iterable[tuple[Quaternion, int]]) -> list[RestYawRate]:
    told = [stillness.add(*sample) for sample in samples]
    return [one for one in (*told, stillness.end()) if one is not None]


@pytest.mark.parametrize("elevation", [HANGING, -math.pi / 2, LEVEL, 0.0])
def test_a_resting_arm_tells_the_drift(elevation: float) -> None:
    told = fed(RestDetector(), stream(lambda t: 1.0 + DRIFT_RADPS * t, lambda _: elevation, 60.0))
    assert len(told) >= 4
    for rate in told:
        assert abs(rate.yaw_rate_radps + DRIFT_RADPS) < 3.5 * rate.sigma_radps
        assert rate.is_raised == (elevation > -1.0)
    longest = max(told, key=lambda rate: rate.span_s)
    assert longest.sigma_radps < math.radians(0.2 if longest.is_raised else 0.06)


def test_the_stated_sigma_is_what_rests_scatter_by() -> None:
    normal = [
        (rate.yaw_rate_radps + DRIFT_RADPS) / rate.sigma_radps
        for seed in range(60)
        for rate in fed(RestDetector(), stream(lambda t: DRIFT_RADPS * t, lambda _: HANGING, 8.0, seed=seed))
    ]
    assert len(normal) > 40
    assert 0.5 < float(np.sqrt(np.mean(np.square(normal)))) < 1.2


def test_rest_samples_count_once() -> None:
    told = fed(RestDetector(), stream(lambda t: DRIFT_RADPS * t, lambda _: HANGING, 120.0))
    ends = [(rate.stamp_ns - rate.span_s * 5e8, rate.stamp_ns + rate.span_s * 5e8) for rate in told]
    assert all(a[1] <= b[0] for a, b in pairwise(ends))
    assert sum(rate.span_s for rate in told) <= 120.0


Turn = Callable[[float], float]

FOLLOWED: list[tuple[Turn, Turn]] = [
    (lambda t: 0.05 * t, lambda _: LEVEL),  # a parcel at 3 °/s
    (lambda t: math.radians(2.5) * math.sin(0.5 * t), lambda _: LEVEL),
    (lambda t: math.radians(1.5) * t, lambda _: LEVEL),
    (lambda t: 0.0 * t, lambda t: LEVEL + math.radians(0.6) * t),  # upwards: never drift
    (lambda t: math.radians(5.0) * math.sin(t), lambda _: LEVEL),
    (lambda t: math.radians(20.0) * math.sin(0.3 * t), lambda t: LEVEL + 0.1 * math.cos(0.3 * t)),
]


@pytest.mark.parametrize(("azimuth", "elevation"), FOLLOWED)
def test_an_arm_that_follows_something_slowly_does_not_rest(azimuth: Turn, elevation: Turn) -> None:
    assert fed(RestDetector(), stream(azimuth, elevation, 40.0)) == []


def test_a_movement_ends_the_rest_before_it_begins() -> None:
    def azimuth(t: float) -> float:
        return 0.0 if t < 5.0 else 0.6 * (t - 5.0)

    told = fed(RestDetector(), stream(azimuth, lambda _: HANGING, 7.0))
    assert len(told) == 1
    assert told[0].stamp_ns + told[0].span_s * 5e8 <= 105.0 * NS_PER_S
    assert abs(told[0].yaw_rate_radps) < 3.0 * told[0].sigma_radps


def test_a_movement_that_begins_gently_is_left_out() -> None:
    def azimuth(t: float) -> float:
        return 0.05 * max(0.0, t - 5.0) ** 2

    told = fed(RestDetector(), stream(azimuth, lambda _: HANGING, 7.0))
    assert len(told) == 1
    assert told[0].stamp_ns + told[0].span_s * 5e8 <= 105.4 * NS_PER_S
    assert abs(told[0].yaw_rate_radps) < 3.0 * told[0].sigma_radps


def test_short_rest_has_no_rate() -> None:
    assert fed(RestDetector(), stream(lambda _: 0.0, lambda _: HANGING, 2.5)) == []


def test_gaps_and_clock_steps_restart_a_rest_and_repeats_are_ignored() -> None:
    samples = stream(lambda t: DRIFT_RADPS * t, lambda _: HANGING, 6.0)
    twice = [sample for sample in samples for _ in range(2)]
    assert fed(RestDetector(), twice) == fed(RestDetector(), samples)
    holed = [s for s in samples if not 102.5 * NS_PER_S < s[1] < 103.5 * NS_PER_S]
    assert all(rate.span_s < 3.0 for rate in fed(RestDetector(), holed))
    stillness = RestDetector()
    for sample in samples:
        stillness.add(*sample)
    back = [(q, stamp - 90 * NS_PER_S) for q, stamp in samples]
    assert [round(rate.stamp_ns / NS_PER_S) for rate in fed(stillness, back)] == [13]


def test_the_sign_of_a_quaternion_means_nothing() -> None:
    samples = stream(lambda t: DRIFT_RADPS * t, lambda _: HANGING, 8.0)
    flipped = [((-q[0], -q[1], -q[2], -q[3]) if i % 3 else q, stamp) for i, (q, stamp) in enumerate(samples)]
    plain, other = fed(RestDetector(), samples), fed(RestDetector(), flipped)
    assert len(plain) == 1
    assert other[0].yaw_rate_radps == pytest.approx(plain[0].yaw_rate_radps, abs=1e-12)
