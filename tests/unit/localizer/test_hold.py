"""A hold: reaction skipped, steadiness waited for, repeated rays left out; rays as the solver takes them."""

import math

import pytest

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, PointingRay
from pointit.services.localizer.estimation.estimator import SolverSettings
from pointit.services.localizer.estimation.rays import Mean, believed, mean, unfiltered
from pointit.services.localizer.procedures.facing import HeadingWindow
from pointit.services.localizer.procedures.hold import Hold
from tests.unit.localizer.person import START_NS, config

STEADY = config(reaction_s=1.0, patience_s=3.0, steady_degps=8.0)


def ns(t_s: float) -> int:
    return START_NS + round(t_s * NS_PER_S)


def ray(t_s: float, azimuth_deg: float = 0.0, elevation_deg: float = -10.0) -> PointingRay:
    direction = vector.direction(math.radians(azimuth_deg), math.radians(elevation_deg))
    return PointingRay(stamp_ns=ns(t_s), origin_m=(0.0, 0.0, 1.64), direction=direction)


def reaching(hold: Hold, settles_s: float, until_s: float, jitter_deg: float = 0.0) -> None:
    """The arm turns at 40 °/s until `settles_s`, then rests; 50 rays a second, each given twice."""
    for tick in range(round(until_s * 50)):
        t_s = tick / 50.0
        wobble = jitter_deg if tick % 2 else -jitter_deg
        hold.add(ray(t_s, 40.0 * min(0.0, t_s - settles_s) + wobble))
        hold.add(ray(t_s, 90.0))


def test_without_a_gate_the_hold_begins_when_the_reaction_is_over() -> None:
    hold = Hold(START_NS, config(reaction_s=1.0))
    reaching(hold, 1.6, 3.1)
    assert hold.rays[0].stamp_ns == ns(1.02)
    assert not hold.is_over(ns(2.99), 10)
    assert hold.is_over(ns(3.0), 10)
    assert not hold.is_over(ns(3.0), 1000)


@pytest.mark.parametrize("jitter_deg", [0.0, 0.3])
def test_a_slow_reach_is_waited_for(jitter_deg: float) -> None:
    hold = Hold(START_NS, STEADY)
    reaching(hold, 1.8, 2.0, jitter_deg)
    assert not hold.is_settled
    assert hold.progress(ns(2.0)) == 0.0
    assert not hold.is_over(ns(9.0), 0)
    hold = Hold(START_NS, STEADY)
    reaching(hold, 1.8, 4.5, jitter_deg)
    assert hold.is_settled
    assert 1.6 <= (hold.rays[0].stamp_ns - START_NS) / NS_PER_S <= 1.9
    off = [abs(math.degrees(vector.azimuth(each.direction))) for each in hold.rays]
    assert max(off) < 8.0  # nothing of the reach but its end
    assert hold.is_over(hold.rays[0].stamp_ns + 2 * NS_PER_S, 20)


def test_steady_ray_settles_without_delay() -> None:
    hold = Hold(START_NS, STEADY)
    reaching(hold, 0.5, 3.2)
    assert hold.rays[0].stamp_ns == ns(1.02)
    assert hold.is_over(ns(3.0), 20)


def test_ray_that_never_settles_counts_in_the_end() -> None:
    hold = Hold(START_NS, STEADY)
    reaching(hold, 100.0, 6.5)
    assert hold.is_settled
    assert 3.5 <= (hold.rays[0].stamp_ns - START_NS) / NS_PER_S <= 4.1
    assert hold.is_over(ns(6.1), 20)


def test_silence_is_hopeless_after_patience() -> None:
    hold = Hold(START_NS, STEADY)
    assert not hold.has_timed_out(ns(5.9))
    assert hold.has_timed_out(ns(6.0))


def test_the_unfiltered_ray_is_the_raw_one_with_the_offset() -> None:
    raw = vector.direction(1.0, -0.2)
    plain = ray(0.0)
    assert unfiltered(plain) == plain.direction
    corrected = plain.model_copy(
        update={"raw_direction": raw, "azimuth_correction_rad": 0.05, "elevation_correction_rad": -0.1}
    )
    assert unfiltered(corrected) == pytest.approx(vector.direction(1.05, -0.3))
    assert unfiltered(plain.model_copy(update={"raw_direction": raw})) == raw


def test_a_calibrated_person_has_a_narrower_prior() -> None:
    trust = SolverSettings()
    known = ray(0.0).model_copy(update={"elevation_sigma_rad": math.radians(1.2)})
    assert believed(trust, [known, known]).bias_sigma_rad == pytest.approx(math.radians(1.2))
    assert believed(trust, [known, ray(1.0)]).bias_sigma_rad == trust.bias_sigma_rad
    exact = known.model_copy(update={"elevation_sigma_rad": 0.0})
    assert believed(trust, [exact]).bias_sigma_rad == pytest.approx(math.radians(1.0))
    vague = known.model_copy(update={"elevation_sigma_rad": 3.0})
    assert believed(trust, [vague]).bias_sigma_rad == trust.bias_sigma_rad
    assert believed(trust, []) == trust


def test_the_mean_ray_with_its_spread_and_its_time() -> None:
    rays = [ray(0.0, -2.0, 0.0), ray(1.0, 2.0, 0.0)]
    middle = mean(rays)
    assert middle is not None
    assert math.degrees(middle.spread_rad) == pytest.approx(2.0)
    assert middle.stamp_ns == ns(0.5)
    assert middle.direction == pytest.approx((1.0, 0.0, 0.0))
    assert mean([]) is None
    assert mean([ray(0.0, 0.0, 0.0), ray(1.0, 180.0, 0.0)]) is None


def test_facing_takes_the_last_half_second_when_it_is_steady() -> None:
    facing = HeadingWindow()
    assert "no rays come" in str(facing.mean(ns(0.0)))
    for tick in range(200):
        facing.add(ray(tick / 50.0, 80.0 if tick < 170 else 10.0))
    told = facing.mean(ns(4.0))
    assert isinstance(told, Mean)
    assert math.degrees(vector.azimuth(told.direction)) == pytest.approx(10.0)
    assert "no rays come" in str(facing.mean(ns(5.0)))
    for tick in range(50):
        facing.add(ray(4.0 + tick / 50.0, 4.0 * (tick % 5)))
    assert "the arm moves by" in str(facing.mean(ns(5.0)))
    for tick in range(50):
        facing.add(ray(5.0 + tick / 50.0, 0.0, -75.0))
    assert "too steeply" in str(facing.mean(ns(6.0)))
