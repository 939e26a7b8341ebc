"""The simulated IMU: frame, drift, noise, silence."""

import math

import numpy as np
import pytest

from pointit.geometry import rotation, vector
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.body.wristband import Wristband
from pointit.services.user_sim.config import WristbandConfig

IDEAL = WristbandConfig(yaw_rate_bias_sd_degps=0.0, yaw_rate_walk_sd_degps=0.0, noise_sd_deg=0.0)
PERIOD_NS = NS_PER_S // 50


def band(config: WristbandConfig, yaw_rad: float = 0.0, seed: int = 1) -> Wristband:
    return Wristband(yaw_rad, config, np.random.default_rng(seed))


def test_orientation_is_given_in_the_persons_frame() -> None:
    # an arm that points along the IMU's yaw origin, azimuth 1 rad in the room, reads yaw 0
    sample = band(IDEAL, yaw_rad=1.0).sample(5, rotation.from_azimuth_elevation(1.0, 0.3))
    assert sample is not None
    arm = rotation.rotate(sample.orientation_xyzw, (1.0, 0.0, 0.0))
    assert vector.azimuth(arm) == pytest.approx(0.0)
    assert vector.elevation(arm) == pytest.approx(0.3)
    assert sample.stamp_ns == 5


def test_drift_turns_the_yaw_alone() -> None:
    drifting = IDEAL.model_copy(update={"yaw_rate_bias_sd_degps": 0.25})
    finals: list[float] = []
    for seed in range(200):
        wrist = band(drifting, seed=seed)
        wrist.sample(0, rotation.IDENTITY)
        sample = wrist.sample(60 * NS_PER_S, rotation.IDENTITY)
        assert sample is not None
        arm = rotation.rotate(sample.orientation_xyzw, (1.0, 0.0, 0.0))
        assert vector.elevation(arm) == pytest.approx(0.0)
        finals.append(math.degrees(vector.azimuth(arm)))
    assert np.std(finals) == pytest.approx(15.0, rel=0.15)


@pytest.mark.parametrize("given_degpmin", [-30.0, 0.0, 24.0])
def test_a_given_drift_is_this_bands_own(given_degpmin: float) -> None:
    real = WristbandConfig(yaw_rate_bias_sd_degps=0.25, yaw_drift_degpmin=given_degpmin)
    exact = real.model_copy(update={"yaw_rate_walk_sd_degps": 0.0})
    for seed in range(3):
        wrist = band(exact, seed=seed)
        wrist.sample(0, rotation.IDENTITY)
        wrist.sample(60 * NS_PER_S, rotation.IDENTITY)
        assert math.degrees(wrist.drift_rad) == pytest.approx(given_degpmin)
    walking = [band(real, seed=seed) for seed in range(20)]
    for wrist in walking:
        for second in range(61):
            wrist.sample(second * NS_PER_S, rotation.IDENTITY)
    drifts = np.degrees([wrist.drift_rad for wrist in walking])
    assert drifts.std() > 0.1  # the rate still wanders
    assert drifts.mean() == pytest.approx(given_degpmin, abs=1.0)


def test_noise_has_the_given_size() -> None:
    noisy = IDEAL.model_copy(update={"noise_sd_deg": 0.03})
    wrist = band(noisy)
    samples = [wrist.sample(i * PERIOD_NS, rotation.IDENTITY) for i in range(5000)]
    vectors = 2.0 * np.array([s.orientation_xyzw[:3] for s in samples if s is not None])
    assert np.degrees(vectors.std(axis=0)) == pytest.approx([0.03] * 3, rel=0.1)


def test_silence_comes_in_bursts_of_the_given_share() -> None:
    lossy = IDEAL.model_copy(update={"dropout_share": 0.05, "dropout_burst_s": 0.15})
    wrist = band(lossy)
    lost = np.array([wrist.sample(i * PERIOD_NS, rotation.IDENTITY) is None for i in range(50_000)])
    assert lost.mean() == pytest.approx(0.05, rel=0.2)
    bursts = int((np.diff(lost.astype(int)) == 1).sum())
    assert lost.sum() / bursts * 0.02 == pytest.approx(0.15, rel=0.3)


def test_lost_samples_leave_a_gap_in_seq_and_the_device_has_its_own_time() -> None:
    lossy = IDEAL.model_copy(update={"dropout_share": 0.3, "clock_skew_ppm": 100.0})
    wrist = band(lossy)
    samples = [wrist.sample(i * PERIOD_NS, rotation.IDENTITY) for i in range(500)]
    kept = [s for s in samples if s is not None]
    assert [s.seq for s in kept] == [i + 1 for i, s in enumerate(samples) if s is not None]
    first, last = kept[0], kept[-1]
    assert first.device_time_ns is not None
    assert last.device_time_ns is not None
    ratio = (last.device_time_ns - first.device_time_ns) / (last.stamp_ns - first.stamp_ns)
    assert ratio == pytest.approx(1.0001, abs=1e-8)
