"""People who follow a robot: poses that end when pointing begins, and errors of the shoulder."""

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import IDENTITY
from pointit.schemas import (
    NS_PER_S,
    BodyMeasures,
    ButtonEvent,
    ImuSample,
    Interaction,
    Localization,
    PointingRay,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Pointings, Solution, solve
from pointit.services.localizer.outputs import Output as LocalizerOutput
from pointit.services.localizer.pose_manager import PoseManager, Response
from pointit.services.pointing.pointer import ArmRay, RayModel
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.life_cycle import Cancel, LifeCycle, Start
from pointit.services.supervisor.life_cycle import Output as SupervisorOutput
from tests.unit.localizer.person import CORNERS, EYES_M, START_NS, USER

Array = NDArray[np.float64]
RATE_HZ = 5.0
STEPS_HZ = 2.0


@dataclass
class Course:
    """Course of one person's localization."""

    person_m: tuple[float, float]
    poses: list[UserPose] = field(default_factory=list[UserPose])
    states: list[str] = field(default_factory=list[str])
    told: list[Localization] = field(default_factory=list[Localization])
    pointing_s: float = math.inf
    """When they were told that pointing has begun."""

    @property
    def error_m(self) -> float:
        """Return the error of the last pose."""
        x, y, _ = self.poses[-1].position_m
        return math.hypot(x - self.person_m[0], y - self.person_m[1])

    @property
    def sigma_m(self) -> float:
        """Return the stated sigma of the last pose along its worse direction."""
        return math.sqrt(
            float(np.linalg.eigvalsh(np.array(self.poses[-1].covariance).reshape(3, 3)[:2, :2])[1])
        )


def follow(seed: int, config: LocalizerConfig, *, late_s: tuple[float, float], duration_s: float) -> Course:
    """Return the course of a person who presses, follows the robot, and turns away once they may point."""
    rng = np.random.default_rng(seed)
    times_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    robots_m = _robot(rng, times_s)
    feet_m = robots_m.mean(axis=0)[:2] + _polar(rng.uniform(2.0, 4.0), rng.uniform(-math.pi, math.pi))
    away_m = _things(rng, times_s, feet_m)
    following, elsewhere = (_directions(rng, at_m, feet_m) for at_m in (robots_m, away_m))
    following = _raised(rng, times_s, following, rng.uniform(*late_s))
    yaw_rad = rng.uniform(-math.pi, math.pi)
    course = Course((float(feet_m[0]), float(feet_m[1])))
    pair = _Pair(config, course)
    turned_s = math.inf
    for index, time_s in enumerate(times_s.tolist()):
        turned_s = min(turned_s, course.pointing_s + rng.uniform(0.3, 0.8))
        azimuth, elevation = (elsewhere if time_s >= turned_s else following)[index]
        direction = vector.direction(azimuth - yaw_rad, elevation)
        pair.live(time_s, robots_m[index], direction)
    return course


class _Pair:
    """Localizer and supervisor, pure, wired as the bus does it."""

    def __init__(self, config: LocalizerConfig, course: Course) -> None:
        self._course = course
        self._pose_manager = PoseManager(USER, config)
        self._cycle = LifeCycle(SupervisorConfig(localize=True, localization_method="moving_target"))
        self._now_ns = self._step_ns = START_NS
        self._supervised(self._cycle.begin(START_NS))
        self._located(self._pose_manager.begin(START_NS))
        self._supervised(self._cycle.button(ButtonEvent(stamp_ns=START_NS), START_NS))

    def live(self, time_s: float, robot_m: Array, direction: tuple[float, float, float]) -> None:
        self._now_ns = now_ns = START_NS + round(time_s * NS_PER_S)
        x, y, z = robot_m.tolist()
        robot = TrackedObject(id="drone", kind="robot", position_m=(x, y, z))
        self._pose_manager.on_objects(TrackedObjects(stamp_ns=now_ns, objects=(robot,)), "room")
        sample = ImuSample(stamp_ns=now_ns, orientation_xyzw=IDENTITY)
        self._supervised(self._cycle.imu(sample, now_ns))
        ray = PointingRay(stamp_ns=now_ns, origin_m=(0.0, 0.0, EYES_M), direction=direction)
        self._located(self._pose_manager.on_ray(ray, now_ns))
        if now_ns >= self._step_ns:
            self._step_ns = now_ns + round(NS_PER_S / STEPS_HZ)
            self._located(self._pose_manager.step(now_ns))
        self._supervised(self._cycle.tick(now_ns))

    def _located(self, outputs: list[LocalizerOutput]) -> None:
        for output in outputs:
            if isinstance(output, UserPose):
                self._course.poses.append(output)
                self._supervised(self._cycle.pose(output, self._now_ns))
            elif isinstance(output, Localization):
                self._course.told.append(output)
                self._supervised(self._cycle.localization(output, self._now_ns))

    def _supervised(self, outputs: list[SupervisorOutput]) -> None:
        for output in outputs:
            if isinstance(output, Start):
                answer = self._pose_manager.start("moving_target", self._now_ns)
                assert isinstance(answer, Response)
                self._located([*answer.outputs])  # published before the answer is sent
                self._supervised(self._cycle.on_start_accepted(output.run))
            elif isinstance(output, Cancel):
                self._located([*self._pose_manager.cancel(self._now_ns).outputs])
                self._cycle.on_cancel_reply(self._now_ns)
            elif isinstance(output, Interaction):
                self._course.states.append(output.state)
                self._pose_manager.on_interaction(output)
                if output.state == "pointing":
                    self._course.pointing_s = min(
                        self._course.pointing_s, (self._now_ns - START_NS) / NS_PER_S
                    )


def _polar(length: float, azimuth_rad: float) -> Array:
    return length * np.array([math.cos(azimuth_rad), math.sin(azimuth_rad)])


def _robot(rng: np.random.Generator, times_s: Array) -> Array:
    """Return where a robot is that flies circles of 1 to 2 m within 8 to 14 s, up and down (n x 3)."""
    angles = math.tau * times_s / rng.uniform(8.0, 14.0) + rng.uniform(-math.pi, math.pi)
    radius_m, height_m = rng.uniform(1.0, 2.0), rng.uniform(0.2, 0.8)
    up_m = height_m + rng.uniform(0.0, 0.2) * np.sin(2.0 * angles)
    return np.column_stack([radius_m * np.cos(angles), radius_m * np.sin(angles), up_m])


def _things(rng: np.random.Generator, times_s: Array, feet_m: Array) -> Array:
    """Return the targets of the person once they may point: objects on a belt, 2 to 6 s each (n x 3)."""
    hold_s = rng.uniform(2.0, 6.0)
    ahead = _polar(1.0, rng.uniform(-math.pi, math.pi))
    along_m = rng.uniform(-2.5, 2.5, int(times_s[-1] / hold_s) + 1)
    level_m = feet_m + rng.uniform(1.5, 3.5) * ahead + along_m[:, None] * np.array([-ahead[1], ahead[0]])
    places = np.column_stack([level_m, np.full(len(along_m), 0.9)])
    return np.asarray(places[(times_s / hold_s).astype(np.intp)], dtype=np.float64)


def _directions(rng: np.random.Generator, at_m: Array, feet_m: Array) -> Array:
    """Return azimuth and elevation in {W} of rays at `at_m`, with people's errors (pointing.md §7; n x 2)."""
    reach = at_m - [*feet_m, EYES_M]
    level = np.hypot(reach[:, 0], reach[:, 1])
    exact = np.column_stack([np.arctan2(reach[:, 1], reach[:, 0]), np.arctan2(reach[:, 2], level)])
    unrest, keep = np.zeros_like(exact), math.exp(-1.0 / (0.3 * RATE_HZ))
    drawn = rng.normal(0.0, math.radians(1.5), exact.shape)
    for index in range(1, len(exact)):
        unrest[index] = keep * unrest[index - 1] + math.sqrt(1.0 - keep * keep) * drawn[index]
    return np.asarray(
        exact + unrest + [0.0, rng.normal(math.radians(-2.8), math.radians(2.8))], dtype=np.float64
    )


def _raised(rng: np.random.Generator, times_s: Array, directions: Array, began_s: float) -> Array:
    """Return `directions` of somebody whose arm hangs until `began_s`, and then needs 0.7 s to come up."""
    share = np.clip((times_s - began_s) / 0.7, 0.0, 1.0)[:, None]
    share = share * share * (3.0 - 2.0 * share)
    hangs = directions[0] + [rng.uniform(-1.0, 1.0), math.radians(-50.0) - directions[0, 1]]
    return np.asarray(share * directions + (1.0 - share) * hangs, dtype=np.float64)


LATE_S = {"prompt": (0.3, 0.8), "late": (1.0, 2.5)}
"""When the arm begins to rise after the press, which is after rays count for late ones."""
FOUND_S = {"prompt": 7.0, "late": 11.0}
"""Median time until they may point: rays come at 5 Hz and 20 of them are needed, after the reaction."""


@pytest.mark.parametrize("who", LATE_S)
def test_poses_of_people_who_turn_away_when_they_may_point(who: str) -> None:
    """Were the pose not settled when pointing begins, every third would end more than 1 m off."""
    config = LocalizerConfig(method="moving_target")
    courses = [follow(seed, config, late_s=LATE_S[who], duration_s=14.0) for seed in range(25)]
    assert {len(course.poses) for course in courses} == {1}
    assert {course.states[-1] for course in courses} == {"pointing"}
    for course in courses:
        (pose,) = course.poses
        assert pose.stamp_ns <= START_NS + course.pointing_s * 1e9  # no ray after that is in it
        assert [news.phase for news in course.told].count("solved") == 1
    errors_m = np.array([course.error_m for course in courses])
    sigmas_m = np.array([course.sigma_m for course in courses])
    assert np.max(errors_m) < 1.0
    assert np.median(errors_m) < 0.25
    assert np.mean(errors_m <= 2.0 * sigmas_m) >= 0.95
    assert np.median([course.pointing_s for course in courses]) < FOUND_S[who]


def test_poses_that_are_followed_on_while_people_point_elsewhere() -> None:
    """Asked for explicitly (`autostart`), it goes on, but takes no pose that contradicts the surest one.

    Otherwise half of them would end more than 1 m off.
    """
    config = LocalizerConfig(method="moving_target", autostart=True)
    courses = [follow(seed, config, late_s=LATE_S["prompt"], duration_s=30.0) for seed in range(8)]
    assert {course.states[-1] for course in courses} == {"pointing"}
    reasons = [news.reason for course in courses for news in course.told]
    assert any("contradict the pose" in reason or "rays miss" in reason for reason in reasons)
    errors_m = np.array([course.error_m for course in courses])
    sigmas_m = np.array([course.sigma_m for course in courses])
    assert np.max(errors_m) < 1.0
    assert np.mean(errors_m <= 2.0 * sigmas_m) >= 0.95


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
