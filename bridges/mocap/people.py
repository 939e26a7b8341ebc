"""People who wear marker bodies: their poses, or their true poses beside those of the localizer. Pure."""

import math
from dataclasses import dataclass, field

from pointit.bridges.mocap.bodies import BodyPose
from pointit.bridges.mocap.config import MocapConfig
from pointit.forearm.forearm_yaw import ForearmYaw
from pointit.forearm.true_pose import PERSON, PERSON_FRAME, PoseError, TruePose
from pointit.schemas import NS_PER_S, ImuSample, TrackedObject, UserPose

MAX_HEAD_AGE_NS = NS_PER_S // 2
"""Age from which a head's position is not current."""
TRUE_HEAD_NS = NS_PER_S // 20
"""Time before the newest frame at which a head that is not in it is no truth of that frame, ns."""
HEAD_SIGMA_M = 0.02
"""1 sigma of the way from the head's body to the point above the feet, m."""
MAX_METRIC = 64
"""Number of characters of a metric's name, which health accepts."""
ARM_SILENCE_NS = 3 * NS_PER_S
PERSON_LENGTH_M = 0.3
"""Diameter of a person as an object, m."""


@dataclass
class _Worn:
    """Bodies of one person."""

    has_forearm: bool
    yaw: ForearmYaw = field(default_factory=ForearmYaw)
    head_pose: BodyPose | None = None
    arm_ns: int = 0
    forearm_ns: int = 0


class WornBodies:
    """Poses of people by the bodies that they wear."""

    def __init__(self, config: MocapConfig) -> None:
        self._is_truth = config.truth
        self._parts: dict[str, tuple[str, str]] = {}
        """Person and part of each body that is worn."""
        for name, body in config.bodies.items():
            if body.person:
                self._parts[name] = (body.person, body.part)
        arms = {person for person, part in self._parts.values() if part == "forearm"}
        self._people = {person: _Worn(person in arms) for person, _ in self._parts.values()}
        self._last_poses: dict[str, UserPose] = {}

    @property
    def names(self) -> list[str]:
        """Return the people who wear bodies."""
        return sorted(self._people)

    def on_body(self, pose: BodyPose) -> None:
        """Update a person by a body in {W}."""
        person, part = self._parts.get(pose.name, ("", ""))
        if not person:
            return
        worn = self._people[person]
        if part == "head":
            worn.head_pose = pose
        else:
            worn.forearm_ns = pose.stamp_ns
            worn.yaw.add_body(pose.stamp_ns, pose.orientation_xyzw)

    def on_imu(self, person: str, sample: ImuSample) -> None:
        """Update a person by the orientation of the arm."""
        worn = self._people.get(person)
        if worn is None or not worn.has_forearm:
            return
        worn.arm_ns = sample.stamp_ns
        worn.yaw.add_arm(sample.stamp_ns, sample.orientation_xyzw, sample.yaw_epoch)

    def on_pose(self, person: str, pose: UserPose) -> None:
        """Store the localizer's pose, which is compared with the truth."""
        if person in self._people:
            self._last_poses[person] = pose

    def poses(self, now_ns: int) -> list[tuple[str, UserPose]]:
        """Return the poses of people whose position and yaw are known, and once of those whose yaw is lost.

        The list is empty in truth mode.
        """
        if self._is_truth:
            return []
        poses: list[tuple[str, UserPose]] = []
        for person, worn in self._people.items():
            head = self._fresh_head(worn, now_ns)
            if head is None:
                continue
            yaw = worn.yaw.stated(now_ns)
            if yaw is None:
                continue

            # The person stands below the head; their position is as uncertain in each direction
            variance = head.sigma_m**2 + HEAD_SIGMA_M**2
            covariance = (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, yaw.sigma_rad**2)
            x, y, _ = head.position_m
            pose = UserPose(
                stamp_ns=head.stamp_ns,
                position_m=(x, y, 0.0),
                yaw_rad=yaw.yaw_rad,
                covariance=covariance,
                method="external",
            )
            poses.append((person, pose))
        return poses

    def objects(self, now_ns: int, frame_ns: int) -> list[TrackedObject]:
        """Return the people who have no pose here, with the yaw of {H} if they are truth and it is known.

        Args:
            now_ns: time of the site, ns.
            frame_ns: time of the newest frame, with which the objects are stamped, ns.
        """
        objects: list[TrackedObject] = []
        for person, worn in self._people.items():
            head = self._fresh_head(worn, now_ns)
            yaw = worn.yaw.known(now_ns)
            if head is None:
                continue
            if self._is_truth:
                is_missing = frame_ns - head.stamp_ns > TRUE_HEAD_NS
            else:
                is_missing = yaw is not None  # then they have a pose
            if is_missing:
                continue

            # Only the truth has a yaw here, that of {H}
            kind = PERSON
            yaw_rad = None
            if yaw is not None:
                kind = PERSON_FRAME
                yaw_rad = yaw.yaw_rad
            person_object = TrackedObject(
                id=person,
                kind=kind,
                position_m=head.position_m,
                length_m=PERSON_LENGTH_M,
                yaw_rad=yaw_rad,
                position_sigma_m=head.sigma_m,
            )
            objects.append(person_object)
        return objects

    def figures(self, now_ns: int) -> dict[str, tuple[float | None, str]]:
        """Return values and units of the metrics by name. None removes one."""
        figures: dict[str, tuple[float | None, str]] = {}
        for person, worn in self._people.items():
            yaw = worn.yaw.estimate(now_ns)
            sigma_deg = None if yaw is None else math.degrees(yaw.sigma_rad)
            figures[f"yaw sigma of {person}"] = sigma_deg, "°"
            if not self._is_truth:
                continue
            error = self._error(person, worn, now_ns)
            error_m = None
            error_deg = None
            if error is not None:
                error_m = error.position_m
            if error is not None and error.yaw_rad is not None:
                error_deg = math.degrees(error.yaw_rad)
            figures[f"position error of {person}"] = error_m, "m"
            figures[f"yaw error of {person}"] = error_deg, "°"
        return {name[:MAX_METRIC]: figure for name, figure in figures.items()}

    def problem(self, now_ns: int) -> str:
        """Return a sentence about a yaw that is not known, or `""`."""
        for person, worn in self._people.items():
            problem = worn.yaw.problem(person, now_ns) if worn.has_forearm else ""
            if problem and now_ns - worn.arm_ns > ARM_SILENCE_NS:
                return f"the yaw of {person} is not known: no wrist sends, start imu-bridge for {person}"
            if problem and now_ns - worn.forearm_ns <= ARM_SILENCE_NS:
                return problem
        return ""

    def _error(self, person: str, worn: _Worn, now_ns: int) -> PoseError | None:
        """Return the error of the pose in force at `now_ns`, or None if it or the truth is unknown."""
        head = self._fresh_head(worn, now_ns)
        yaw = worn.yaw.known(now_ns)
        pose = self._last_poses.get(person)
        if head is None or pose is None:
            return None
        yaw_rad = None if yaw is None else yaw.yaw_rad
        return TruePose(head.stamp_ns, head.position_m, yaw_rad).error_of(pose)

    def _fresh_head(self, worn: _Worn, now_ns: int) -> BodyPose | None:
        head = worn.head_pose
        if head is None or abs(now_ns - head.stamp_ns) > MAX_HEAD_AGE_NS:
            return None
        return head
