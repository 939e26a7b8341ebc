"""A simulated arm that moves, with noise of its IMU and of the cameras that see its marker body."""

import math
from collections.abc import Callable

import numpy as np

from pointit.forearm.forearm_yaw import ForearmYaw, ForearmYawEstimate
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S
from tests.support.bench import START_NS

STEP_S = 0.01
DRIFT_RADPS = math.radians(0.02)
IMU_RAD = math.radians(0.3)
CAMERA_RAD = math.radians(0.4)

Course = Callable[[float], Quaternion]


def waving(dice: np.random.Generator) -> Course:
    rates = dice.uniform(0.8, 1.5, 3)
    phases = dice.uniform(0.0, math.tau, 3)

    def course(time_s: float) -> Quaternion:
        azimuth, elevation, roll = 0.3 * np.sin(math.tau * rates * time_s + phases)
        return rotation.from_azimuth_elevation(azimuth, elevation, roll)

    return course


def pointing(dice: np.random.Generator) -> Course:
    """Point at one place after another: .6 s for each way, .5 s for each hold."""
    places = dice.uniform((-0.8, -0.5, -0.3), (0.8, 0.3, 0.3), (60, 3))

    def course(time_s: float) -> Quaternion:
        index, rest_s = divmod(time_s, 1.1)
        share = min(1.0, rest_s / 0.6)
        share = 10 * share**3 - 15 * share**4 + 6 * share**5
        angles = places[int(index)] + share * (places[int(index) + 1] - places[int(index)])
        return rotation.from_azimuth_elevation(*angles)

    return course


def small(dice: np.random.Generator) -> Course:
    rates = dice.uniform(0.4, 0.8, 3)

    def course(time_s: float) -> Quaternion:
        azimuth, elevation, roll = 0.12 * np.sin(math.tau * rates * time_s)
        return rotation.from_azimuth_elevation(azimuth, elevation, roll)

    return course


class Arm:
    """An arm with an IMU and a marker body on it."""

    def __init__(
        self, seed: int, *, delay_s: float = 0.0, error_time_s: float = 0.0, imu_rad: float = IMU_RAD
    ) -> None:
        """Errors of the IMU with 1 sigma `imu_rad` for each axis last for about `error_time_s`."""
        self.dice = np.random.default_rng(seed)
        self.yaw_rad = float(self.dice.uniform(-3.0, 3.0))
        self.mount = self.noise(2.0)
        self.delay_s = delay_s
        self.epoch = 0
        self.time_s = 0.0
        self.estimator = ForearmYaw()
        self.imu_rad = imu_rad
        self.kept = math.exp(-2 * STEP_S / error_time_s) if error_time_s else 0.0
        self.error_rad3 = self.dice.normal(0.0, imu_rad, 3)

    @property
    def now_ns(self) -> int:
        return START_NS + round(self.time_s * NS_PER_S)

    @property
    def true_rad(self) -> float:
        return self.yaw_rad + DRIFT_RADPS * self.time_s

    def noise(self, sigma_rad: float) -> Quaternion:
        vector = self.dice.normal(0.0, sigma_rad, 3)
        angle = float(np.linalg.norm(vector))
        x, y, z = (vector / angle).tolist()
        return rotation.from_axis_angle((x, y, z), angle)

    def imu_error(self) -> Quaternion:
        fresh = self.dice.normal(0.0, self.imu_rad * math.sqrt(1.0 - self.kept**2), 3)
        self.error_rad3 = self.kept * self.error_rad3 + fresh
        angle = float(np.linalg.norm(self.error_rad3))
        x, y, z = (self.error_rad3 / angle).tolist()
        return rotation.from_axis_angle((x, y, z), angle)

    def move(self, course: Course, duration_s: float, *, cameras: bool = True) -> None:
        for step in range(round(duration_s / STEP_S)):
            self.time_s += STEP_S
            if cameras:
                arm = rotation.multiply(rotation.from_yaw(self.yaw_rad), course(self.time_s))
                seen = rotation.multiply(rotation.multiply(arm, self.mount), self.noise(CAMERA_RAD))
                self.estimator.add_body(self.now_ns, seen)
            if step % 2 == 0:
                late = course(max(0.0, self.time_s - self.delay_s))
                drifted = rotation.multiply(rotation.from_yaw(-DRIFT_RADPS * self.time_s), late)
                self.estimator.add_arm(self.now_ns, rotation.multiply(self.imu_error(), drifted), self.epoch)
            if step % 25 == 0:
                self.estimator.estimate(self.now_ns)

    def estimate(self) -> ForearmYawEstimate:
        estimate = self.estimator.estimate(self.now_ns)
        assert estimate is not None
        return estimate

    def error_rad(self) -> float:
        return abs(math.remainder(self.estimate().yaw_rad - self.true_rad, math.tau))
