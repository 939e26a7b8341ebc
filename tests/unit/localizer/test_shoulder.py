"""People whose shoulder is beside the neck: found as well as others, wherever the IMU's yaw began."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pointit.geometry import rotation
from pointit.schemas import BodyMeasures
from pointit.services.localizer.estimation.estimator import Pointings, Solution, solve
from pointit.services.pointing.pointer import ArmRay, RayModel
from tests.unit.localizer.person import CORNERS, EYES_M

Array = NDArray[np.float64]

PEOPLE = 200
NECK_M = 1.43
ARM_M = 0.73
TURNED = (0.6, 1.0)
"""Share of the way to what they point at that people turn their bodies by."""


@dataclasses.dataclass(frozen=True)
class Pointer:
    """Readings of one person's wrist, and the truth."""

    arms: Array
    """Azimuth and elevation of the arm in {W} (n x 2), rad."""
    targets_m: Array
    feet_m: Array

    def pointings(self, body: BodyMeasures, yaw_rad: float, model: RayModel = "eye_finger") -> Pointings:
        """Return the rays that are made of an IMU whose x axis began at azimuth `yaw_rad`."""
        orientations = [
            rotation.from_azimuth_elevation(azimuth - yaw_rad, elevation)
            for azimuth, elevation in self.arms.tolist()
        ]
        origins, directions = ArmRay(body, model=model).rays(np.array(orientations))
        return Pointings(np.arange(len(self.arms)) / 25.0, origins, directions, self.targets_m)


def pointer(seed: int, shoulder_m: float, *, moving: bool) -> Pointer:
    """Return a person who follows a robot for 10 s, or points at four lamps for 2 s each.

    The geometry is their own, not the model's: the body turns less than the arm does.
    """
    rng = np.random.default_rng(seed)
    if moving:
        angles = rng.uniform(-math.pi, math.pi) + math.tau * np.arange(250) / rng.uniform(200.0, 350.0)
        targets = np.column_stack([3.0 + 1.5 * np.cos(angles), 1.5 * np.sin(angles), np.full(250, 0.5)])
        errors = np.zeros((250, 2)) + rng.normal(0.0, math.radians(1.5), (25, 2)).repeat(10, axis=0)
    else:
        targets = np.repeat(np.array(CORNERS), 50, axis=0)
        errors = rng.normal(0.0, math.radians(4.0), (4, 2)).repeat(50, axis=0)
    errors[:, 1] += rng.normal(math.radians(-2.8), math.radians(2.8))
    feet = rng.uniform(-1.0, 1.0, 2)
    sight = targets - [*feet, EYES_M]
    azimuth, level = np.arctan2(sight[:, 1], sight[:, 0]), np.hypot(sight[:, 0], sight[:, 1])
    middle = math.atan2(*(targets.mean(axis=0)[:2] - feet)[::-1])
    around = np.remainder(azimuth - middle + math.pi, math.tau) - math.pi
    share = rng.uniform(*TURNED)
    faces = middle + share * around if moving else azimuth - (1.0 - share) * 0.5 * np.sign(around)
    shoulder = shoulder_m * np.column_stack([np.sin(faces), -np.cos(faces), np.zeros(len(faces))])
    shoulder[:, 2] = NECK_M - EYES_M
    azimuth, elevation = azimuth + errors[:, 0], np.arctan2(sight[:, 2], level) + errors[:, 1]
    line = np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    along = np.einsum("ij,ij->i", line, shoulder)
    reach = along + np.sqrt(along**2 - np.einsum("ij,ij->i", shoulder, shoulder) + ARM_M**2)
    arm = reach[:, None] * line - shoulder
    arms = np.column_stack(
        [np.arctan2(arm[:, 1], arm[:, 0]), np.arctan2(arm[:, 2], np.hypot(arm[:, 0], arm[:, 1]))]
    )
    return Pointer(arms, targets, feet)


def outcomes(shoulder_m: float, *, moving: bool) -> tuple[float, float]:
    """Return the share of people who are found, and of these of errors within twice what is stated."""
    body = BodyMeasures(neck_to_shoulder_m=shoulder_m)
    within: list[bool] = []
    for seed in range(PEOPLE):
        person = pointer(seed, shoulder_m, moving=moving)
        found = solve(person.pointings(body, 2.4 * seed))
        if isinstance(found, Solution):
            error_m = math.hypot(found.x_m - person.feet_m[0], found.y_m - person.feet_m[1])
            within.append(error_m <= 2.0 * found.position_sigma_m)
    return len(within) / PEOPLE, sum(within) / len(within)


@pytest.mark.parametrize("moving", [True, False], ids=["robot", "lamps"])
def test_poses_with_a_shoulder_are_as_honest_as_without(moving: bool) -> None:  # noqa: FBT001
    found, honest = outcomes(0.2, moving=moving)
    found_without, honest_without = outcomes(0.0, moving=moving)
    assert found >= found_without - 0.03
    assert honest >= honest_without - 0.01
    assert honest >= 0.95
