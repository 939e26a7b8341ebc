"""A gyroscope and accelerometer on a simulated arm that rests and then points about, and its radio."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.reading import RawReading

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
