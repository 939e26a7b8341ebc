"""Orientation from rates and accelerations: error in simulation, sample period, lost readings, drift."""

import math
import sys
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pointit.geometry.rotation import Quaternion
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge import device_wrist
from pointit.services.imu_bridge.arm_frame import YawEpoch
from pointit.services.imu_bridge.device_wrist import DeviceWrist
from pointit.services.imu_bridge.fusion import Fusion, PeriodRegression
from pointit.services.imu_bridge.sources import RawReading

pytest.importorskip("vqf")
SECONDS = 40.0
X = np.array([1.0, 0.0, 0.0])
RATE_HZ = 100
FINE = 10
"""Steps of the simulation for each sample; a sample is their mean, as sensors filter."""
ARM_M = 0.6
GRAVITY = np.array([0.0, 0.0, 9.81])
START_NS = 1_700_000_000 * NS_PER_S
Array = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class SimulatedWrist:
    """Samples of a sensor, and the truth."""

    time_s: Array
    gyro_radps: Array
    acceleration_mps2: Array
    truth: Rotation

    def readings(
        self, *, arrival_jitter_s: float = 0.0, device_time: bool, seed: int = 0
    ) -> list[RawReading]:
        """Return the readings, each late by up to `arrival_jitter_s`, in order."""
        late_s = np.random.default_rng(seed).uniform(0.0, arrival_jitter_s, len(self.time_s))
        arrival_s = np.maximum.accumulate(self.time_s + late_s).tolist()
        return [
            RawReading(
                START_NS + round(arrival * 1e9),
                (gyro[0], gyro[1], gyro[2]),
                (acceleration[0], acceleration[1], acceleration[2]),
                round(time * 1e6) * 1000 if device_time else None,
            )
            for arrival, gyro, acceleration, time in zip(
                arrival_s,
                self.gyro_radps.tolist(),
                self.acceleration_mps2.tolist(),
                self.time_s.tolist(),
                strict=True,
            )
        ]


def simulated_wrist(
    seed: int, seconds: float, rest_s: float = 3.0, bias_degps: float = 1.0
) -> SimulatedWrist:
    """Return a sensor that lies still for `rest_s` and then moves with a pointing arm."""
    random = np.random.default_rng(seed)
    count = round(seconds * RATE_HZ)
    step_s = 1.0 / (RATE_HZ * FINE)
    fine_s = np.arange(count * FINE + 1) * step_s
    moving = np.clip(fine_s - rest_s, 0.0, 1.0)
    angles = [
        moving
        * sum(
            amplitude
            / 2
            * np.sin(math.tau * random.uniform(0.05, 0.6) * fine_s + random.uniform(0.0, math.tau))
            for _ in range(4)
        )
        for amplitude in (0.5, 0.35, 0.4)
    ]
    arm = Rotation.from_euler("ZYX", np.stack(angles, axis=1))
    rate: Array = (arm[:-1].inv() * arm[1:]).as_rotvec() / step_s
    position: Array = arm.apply([ARM_M, 0.0, 0.0])
    force: Array = np.gradient(np.gradient(position, step_s, axis=0), step_s, axis=0) + GRAVITY
    gyro: Array = rate.reshape(count, FINE, 3).mean(axis=1) + random.normal(0.0, math.radians(bias_degps), 3)
    at = slice(FINE, None, FINE)
    felt: Array = arm[at].inv().apply(force[at])
    noise_radps: Array = random.normal(0.0, math.radians(0.07), (count, 3))
    noise_mps2: Array = random.normal(0.0, 0.02, (count, 3))
    return SimulatedWrist(fine_s[at], gyro + noise_radps, felt + noise_mps2, arm[at])


def fused(fusion: Fusion, readings: list[RawReading]) -> list[Quaternion | None]:
    return [fusion.update(each) for each in readings]


def error_deg(wrist: SimulatedWrist, orientations: list[Quaternion | None], zero_s: float = 4.5) -> float:
    """Return the RMS error of the arm's direction, with the heading aligned once at `zero_s`."""
    begin = round(zero_s * RATE_HZ)
    known = [
        (number, each) for number, each in enumerate(orientations) if each is not None and number >= begin
    ]
    found: Array = Rotation.from_quat(np.array([each for _, each in known])).apply(X)
    true: Array = wrist.truth[np.array([number for number, _ in known])].apply(X)
    turn = float(np.arctan2(true[0, 1], true[0, 0]) - np.arctan2(found[0, 1], found[0, 0]))
    found = Rotation.from_euler("z", turn).apply(found)
    angles = np.arccos(np.clip((found * true).sum(axis=1), -1.0, 1.0))
    return float(np.degrees(np.sqrt((angles**2).mean())))


@pytest.mark.parametrize("device_time", [True, False])
def test_arm_is_followed_within_1_5_degrees_after_a_rest(*, device_time: bool) -> None:
    for seed in range(2):
        wrist = simulated_wrist(seed, SECONDS)
        readings = wrist.readings(arrival_jitter_s=0.04, device_time=device_time, seed=seed)
        orientations = fused(Fusion(), readings)
        assert orientations[50] is None  # the first second tells the period
        assert orientations[110] is not None
        assert error_deg(wrist, orientations) < 1.5


def test_lost_readings_are_bridged_by_the_clock_of_the_device() -> None:
    wrist = simulated_wrist(1, SECONDS)
    readings = wrist.readings(arrival_jitter_s=0.02, device_time=True)
    fusion = Fusion()
    orientations = [None if number % 10 == 3 else fusion.update(each) for number, each in enumerate(readings)]
    assert error_deg(wrist, orientations) < 1.5


def test_bias_above_the_filters_limit_is_removed_at_rest() -> None:
    wrist = simulated_wrist(2, SECONDS, bias_degps=6.0)
    orientations = fused(Fusion(), wrist.readings(device_time=True))
    assert error_deg(wrist, orientations) < 1.5


def test_long_gap_is_a_restart_that_keeps_the_bias() -> None:
    wrist = simulated_wrist(3, SECONDS)
    readings = wrist.readings(device_time=True)
    fusion = Fusion()
    fused(fusion, readings[:1000])
    assert fusion.restarts == 0
    orientations = fused(fusion, readings[1200:])
    assert fusion.restarts == 1
    later = [None] * 1200 + orientations
    assert error_deg(wrist, later, 13.5) < 2.5  # without a rest since


def test_repeated_and_late_readings_change_nothing() -> None:
    readings = simulated_wrist(0, 5.0).readings(device_time=True)
    once = Fusion()
    again = Fusion()
    fused(once, readings)
    for number, reading in enumerate(readings):
        again.update(reading)
        assert again.update(reading) is None
        if number > 3:
            assert again.update(readings[number - 3]) is None
    report = dict(each[:2] for each in once.report(5.0))
    assert report == dict(each[:2] for each in again.report(5.0))


def test_device_that_never_lay_still_is_named_until_it_has() -> None:
    fusion = Fusion()
    moving = simulated_wrist(4, 10.0, rest_s=-1.0).readings(device_time=True)
    fused(fusion, moving)
    report = dict(each[:2] for each in fusion.report(10.0))
    assert report["resting"] == 0
    assert "hold it still on a table, for 3 s" in fusion.warning("anna's wrist (fake)")
    fusion = Fusion()
    fused(fusion, simulated_wrist(4, 10.0).readings(device_time=True))
    list(fusion.report(10.0))
    assert fusion.warning("anna's wrist (fake)") == ""


def test_drift_of_the_heading_is_measured_at_the_next_rest() -> None:
    """A bias that grows by 0.5 °/s after the first rest turns the heading by 30° a minute."""
    first = simulated_wrist(5, 8.0, rest_s=4.0).readings(device_time=True)
    still = simulated_wrist(6, 14.0, rest_s=19.0, bias_degps=0.0).readings(device_time=True)
    fusion = Fusion()
    for number, reading in enumerate(first):
        fusion.update(reading)
        if number % RATE_HZ == 0:
            list(fusion.report(number / RATE_HZ))
    x, y, z = first[100].angular_velocity_radps
    report: dict[str, float | None] = {}
    for number, reading in enumerate(still):
        gx, gy, gz = reading.angular_velocity_radps
        device_time_ns = (reading.device_time_ns or 0) + 8_000_000_000
        turning = (gx + x, gy + y, gz + z + np.radians(0.5))
        fusion.update(RawReading(reading.stamp_ns, turning, reading.acceleration_mps2, device_time_ns))
        if number % RATE_HZ == 0:
            report = dict(each[:2] for each in fusion.report(8.0 + number / RATE_HZ))

    assert report["resting"] == 1
    assert report["heading drift"] == 0
    assert fusion.measured_degps == pytest.approx(0.5, abs=0.15)


def test_period_is_that_of_the_arrivals_however_they_jitter() -> None:
    random = np.random.default_rng(0)
    arrivals_s = np.maximum.accumulate(np.arange(3000) * 0.0102 + random.exponential(0.02, 3000))
    regression = PeriodRegression()
    for arrival_s in arrivals_s.tolist():
        regression.add(round(arrival_s * 1e9))
    assert regression.period_s == pytest.approx(0.0102, rel=3e-4)


class CountingFilter:
    """Counts updates."""

    updates = 0

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s

    def update(self, _gyr: Array, _acc: Array) -> None:
        CountingFilter.updates += 1

    def getQuat6D(self) -> Array:  # noqa: N802 - the filter's name
        return np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "steps_ns", [[1] * 4000 + [600_000_000] * 2, [1000] * 20_000 + [10_000_000] * 90 + [300_000_000]]
)
def test_work_is_limited_whatever_times_a_device_states(
    steps_ns: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "vqf", SimpleNamespace(VQF=CountingFilter))
    monkeypatch.setattr(CountingFilter, "updates", 0)
    fusion = Fusion()
    device_ns = 0
    for step_ns in steps_ns:
        device_ns += step_ns
        fusion.update(RawReading(0, (0.1, 0.0, 0.0), (0.0, 0.0, 9.81), device_ns))
    assert CountingFilter.updates < 4000
    orientations = [
        fusion.update(RawReading(0, (0.1, 0.0, 0.0), (0.0, 0.0, 9.81), device_ns + number * 10_000_000))
        for number in range(1, 300)
    ]
    assert orientations[-1] is not None  # once they make sense, it goes on


def test_missing_extra_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "vqf", None)
    with pytest.raises(ConfigError, match="fusion"):
        Fusion()


def test_build_without_fusion_is_named_once_raw_readings_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_wrist, "FUSION", f"{device_wrist.FUSION.partition(':')[0]}_absent:Fusion")
    wrist = DeviceWrist("anna's wrist", "IMU source 'mine'", YawEpoch(), silence_s=3.0, has_steady_time=True)
    assert wrist.process_item(RawReading(0, (0.1, 0.0, 0.0), (0.0, 0.0, 9.81)), 0, 0.0) is None
    assert dict(wrist.warnings(0.1, is_explained=False))["fusion"] == (
        "IMU source 'mine' sends raw readings, whose fusion is not part of this build of PointIt: there is "
        "no pointit.services.imu_bridge.fusion_absent"
    )
