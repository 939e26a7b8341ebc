"""Motion of the arm: bell-shaped reaches of human duration onto moving aims, human noise."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.body.arm import Arm, PosturalNoise, minimum_jerk_to_rest
from pointit.services.user_sim.config import ArmConfig
from pointit.sim.aim import Aim

STILL = ArmConfig(hold_yaw_sd_deg=0.0, hold_pitch_sd_deg=0.0, tremor_rms_deg=0.0, reach_spread=0.0)


def arm(config: ArmConfig = STILL) -> Arm:
    return Arm(Aim(0.0, 0.0), config, np.random.default_rng(1))


def direction(moving: Arm, now_s: float, aim: Aim) -> vector.Vec3:
    return rotation.rotate(moving.follow(round(now_s * NS_PER_S), aim), (1.0, 0.0, 0.0))


def test_a_reach_of_39_degrees_takes_people_0_74_s_and_peaks_at_100_degrees_a_second() -> None:
    moving, aim = arm(), Aim(math.radians(39.0), 0.0)
    duration_s = moving.reach_s(math.radians(39.0))
    assert duration_s == pytest.approx(0.74, abs=0.02)
    moving.reach(0, aim, duration_s)
    times_s = np.arange(0.0, duration_s, 0.001)
    angles_deg = np.degrees([vector.azimuth(direction(moving, t, aim)) for t in times_s])
    assert angles_deg[0] == pytest.approx(0.0, abs=1e-9)
    assert np.diff(angles_deg).max() / 0.001 == pytest.approx(102.0, abs=5.0)
    assert math.degrees(vector.azimuth(direction(moving, duration_s, aim))) == pytest.approx(39.0)


def test_short_reaches_are_quicker() -> None:
    durations_s = [arm().reach_s(math.radians(angle)) for angle in (0.0, 2.0, 10.0, 39.0, 180.0)]
    assert durations_s == sorted(durations_s)
    assert durations_s[0] == pytest.approx(0.25)
    assert durations_s[-1] < 1.5


@given(
    st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-9, 9)),
    st.floats(0.2, 1.5),
    st.floats(0.01, 0.99),
)
def test_fading_is_one_smooth_curve_from_its_start_to_rest(
    start: tuple[float, float, float], duration_s: float, share: float
) -> None:
    assert minimum_jerk_to_rest(start, duration_s, 0.0) == pytest.approx(start)
    assert minimum_jerk_to_rest(start, duration_s, duration_s) == (0.0, 0.0, 0.0)
    assert minimum_jerk_to_rest(start, duration_s, duration_s * (1 - 1e-9)) == pytest.approx(
        (0.0, 0.0, 0.0), abs=1e-5
    )
    # rate and acceleration are the derivatives of what they should be
    at_s, step_s = share * duration_s, 1e-5
    before, here, after = (minimum_jerk_to_rest(start, duration_s, at_s + k * step_s) for k in (-1, 0, 1))
    assert (after[0] - before[0]) / (2 * step_s) == pytest.approx(here[1], abs=1e-3)
    assert (after[1] - before[1]) / (2 * step_s) == pytest.approx(here[2], abs=1e-1)


def test_turning_to_another_aim_in_mid_reach_and_mid_pursuit_keeps_the_speed() -> None:
    moving = arm()
    first = Aim(1.0, 0.2)
    moving.reach(0, first, 0.8)
    step_s = 1e-4
    before = [direction(moving, t, first) for t in (0.4 - step_s, 0.4)]
    # the new aim runs away at 0.5 rad/s
    second = Aim(-0.5, -0.3, 0.5, 0.0)
    moving.reach(round(0.4 * NS_PER_S), second, 0.8)
    after = [direction(moving, 0.4 + t, Aim(-0.5 + 0.5 * t, -0.3, 0.5, 0.0)) for t in (0.0, step_s)]
    assert vector.angle_between(before[1], after[0]) < 1e-7
    for pair in zip(vector.subtract(before[1], before[0]), vector.subtract(after[1], after[0]), strict=True):
        assert pair[0] / step_s == pytest.approx(pair[1] / step_s, abs=0.02)
    end = Aim(-0.5 + 0.5 * 0.8, -0.3, 0.5, 0.0)
    assert vector.azimuth(direction(moving, 1.2, end)) == pytest.approx(end.azimuth_rad)


def test_the_short_way_round() -> None:
    moving = Arm(Aim(3.0, 0.0), STILL, np.random.default_rng(1))
    aim = Aim(-3.0, 0.0)
    moving.reach(0, aim, 1.0)
    middle = direction(moving, 0.5, aim)
    assert abs(vector.azimuth(middle)) == pytest.approx(math.pi, abs=1e-6)


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 200.0])
def test_unrest_is_as_measured_whatever_the_rate(rate_hz: float) -> None:
    config = ArmConfig(tremor_rms_deg=0.0)
    unrest = PosturalNoise(config, np.random.default_rng(3))
    samples = np.degrees([unrest.at(round(i / rate_hz * NS_PER_S)) for i in range(int(400 * rate_hz))])
    assert samples.std(axis=0) == pytest.approx([0.25, 0.16], rel=0.1)
    lag = round(0.3 * rate_hz)
    for axis in samples.T:  # of two poles, 0.3 and 0.1 s
        assert np.corrcoef(axis[:-lag], axis[lag:])[0, 1] == pytest.approx(0.53, abs=0.1)


def test_most_of_the_unrest_is_slow() -> None:
    """65 % of the variance below 0.5 Hz, 17 % up to 1, 14 % up to 2, < 4 % up to 4, < 1 % up to 8 Hz."""
    unrest = PosturalNoise(ArmConfig(tremor_rms_deg=0.0), np.random.default_rng(3))
    samples = np.array([unrest.at(i * NS_PER_S // 50) for i in range(50 * 1000)])[:, 0]
    power = np.abs(np.fft.rfft(samples - samples.mean())) ** 2
    hz = np.fft.rfftfreq(len(samples), 0.02)
    shares = [
        power[(hz >= low) & (hz < high)].sum() / power.sum()
        for low, high in ((0.0, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0))
    ]
    assert shares == pytest.approx([0.65, 0.17, 0.14, 0.035, 0.005], abs=0.08)


def test_some_holds_are_steadier_than_others_and_the_skilled_are_steadier() -> None:
    def sds(skill: float) -> list[float]:
        unrest = PosturalNoise(ArmConfig(tremor_rms_deg=0.0), np.random.default_rng(5), skill)
        found: list[float] = []
        for hold in range(150):
            unrest.draw()
            at = [unrest.at((hold * 500 + i) * NS_PER_S // 50) for i in range(500)]
            found.append(float(np.degrees(np.std([yaw for yaw, _ in at[150:]]))))
        return found

    usual = sds(0.0)
    assert np.median(usual) == pytest.approx(0.25, abs=0.08)
    assert 0.6 < np.quantile(usual, 0.9) < 1.3  # 1.07 in the recordings
    assert np.median(sds(1.0)) == pytest.approx(0.5 * float(np.median(usual)), rel=0.1)


def test_tremor_lies_between_6_and_12_hz() -> None:
    config = ArmConfig(hold_yaw_sd_deg=0.0, hold_pitch_sd_deg=0.0)
    unrest = PosturalNoise(config, np.random.default_rng(3))
    samples = np.degrees([unrest.at(i * NS_PER_S // 100) for i in range(6000)])[:, 0]
    assert samples.std() == pytest.approx(0.05, rel=0.15)
    power = np.abs(np.fft.rfft(samples)) ** 2
    frequencies = np.fft.rfftfreq(len(samples), 0.01)
    inside = power[(frequencies > 5.9) & (frequencies < 12.1)].sum() / power.sum()
    assert inside > 0.95
