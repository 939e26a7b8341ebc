"""Localizations in recorded sessions, scored where the truth is in them.

The truth is a tracker's: the person as an object whose id is their name, or their pose (`external`). Without
one, pointing at lamps afterwards (anchors) shows how far rays were off.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pointit.forearm.true_pose import PERSON_FRAME
from pointit.geometry.vector import Vec3
from pointit.recording.reader import Recording
from pointit.runtime.errors import ConfigError
from pointit.schemas import (
    Anchor,
    Environment,
    ImuSample,
    Localization,
    PointingRay,
    TrackedObjects,
    UserPose,
    UserProfile,
)
from pointit.schemas.topics import ANCHOR, IMU, LOCALIZATION, MAP, OBJECTS, POSE, PROFILE, RAY, Topic
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.pointing.pointer import ArmRay
from pointit_lab.evaluation.localization.recorded_person import SET, Course, PersonInSession
from pointit_lab.evaluation.localization.scoring import Key, Outcome, rows_of
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row

LIVE = "live"
"""Solver of the rows of poses as they were found in the session."""

ANCHORS = "anchors"
"""Condition of the rows of pointing at lamps after the localization."""

UNTRUE = (
    "it has no true position of any person; let a tracker publish each person as an object whose id is their "
    "name, or let them point at lamps afterwards (`pointit person anchor`)"
)
UNUSED = "has no localization of {users}, whose position a tracker knows; record one"

READ: tuple[Topic[Any], ...] = (MAP, PROFILE, LOCALIZATION, OBJECTS, POSE, ANCHOR, RAY, IMU)
PEOPLE = (RAY, IMU, LOCALIZATION, POSE)
"""Topics of everybody who can be scored."""
DEFAULT_ARM = ArmRay()
"""Arm of a person without a profile."""


@dataclass
class Sessions:
    """Parts of recorded sessions that can be scored."""

    trials: list[LocalizationTrial] = field(default_factory=list[LocalizationTrial])
    """Localizations, to be solved again."""
    outcomes: list[Outcome] = field(default_factory=list[Outcome])
    """Poses that were found in the sessions."""
    anchors: list[tuple[str, Anchor]] = field(default_factory=list[tuple[str, Anchor]])
    """Pointings at known places, with the person."""
    notes: list[str] = field(default_factory=list[str])
    """Sentences about what is missing."""

    def rows(self) -> list[Row]:
        """Return the rows of poses and anchors as they were in the sessions."""
        by_user = defaultdict[str, list[Anchor]](list)
        for user, anchor in self.anchors:
            by_user[user].append(anchor)
        rows = list(rows_of(self.outcomes))
        if self.anchors:
            anchors = [anchor for _, anchor in self.anchors]
            rows.append(_anchors(ALL, anchors))
        for user, own_anchors in by_user.items():
            rows.append(_anchors(user, own_anchors))
        return rows


def read_sessions(paths: Sequence[Path], tick: Callable[[str], None] = lambda _: None) -> Sessions:
    """Return the parts of the recordings that can be scored.

    Args:
        paths: recordings. A name is the same person in all of them.
        tick: called with a short description of the current step.

    Raises:
        ConfigError: If one is no recording, or none has anything to score.
    """
    sessions = Sessions()
    for path in paths:
        tick(f"reading {path.name}")
        with Recording.open(path) as recording:
            if recording.problem:
                sessions.notes.append(recording.problem)
            # who is in it is known before the first message
            names: dict[str, set[str]] = {}
            for topic in READ:
                names[topic.key] = {topic.name_in(key) for key in recording.counts}
            reader = _Reader(names)
            for entry in recording.entries(_is_read):
                reader.add(entry.name, entry.body)
            missing = reader.end(sessions)
            if missing:
                sessions.notes.append(f"{path}: {missing}")
    is_empty = not (sessions.trials or sessions.outcomes or sessions.anchors)
    if is_empty:
        raise ConfigError("; ".join(sessions.notes))
    return sessions


def _is_read(key: str) -> bool:
    return any(_fits(topic, key) for topic in READ)


def _fits(topic: Topic[Any], key: str) -> bool:
    return topic.key == key or bool(topic.name_in(key))


class _Reader:
    """Reads one recording."""

    def __init__(self, names: Mapping[str, set[str]]) -> None:
        """Expect the people in `names`, by the key of a topic. Who has no rays gets them from their IMU."""
        users = set[str]()
        for topic in PEOPLE:
            users |= names[topic.key]
        users.discard("")
        config = LocalizerConfig()
        self._people = {user: PersonInSession(user, config) for user in sorted(users)}
        self._rayed = names[RAY.key]
        self._arms: dict[str, ArmRay] = {}
        self._lamps: dict[str, Vec3] = {}
        self._targets: dict[str, Course] = {}
        self._anchors: list[tuple[str, Anchor]] = []

    def add(self, name: str, body: object) -> None:
        """Add a message; `name` is for the placeholder of its key."""
        match body:
            case TrackedObjects():
                self._track(body)
            case Environment():
                self._lamps = {lamp.id: lamp.position_m for lamp in body.lamps}
            case UserProfile():
                self._arms[name] = ArmRay.from_profile(body)
            case ImuSample():
                self._move(name, body)
            case _:
                self._on_message(name, body)

    def end(self, sessions: Sessions) -> str:
        """Add what there is to score to `sessions`. Return what is missing, or `""`."""
        for person in self._people.values():
            trials = list(person.trials(self._targets))
            sessions.trials += trials
            yaws_rad = {trial.yaw_rad for trial in trials}
            sessions.outcomes += _live(person, yaws_rad)
        sessions.anchors += self._anchors

        tracked = [person for person in self._people.values() if len(person.truth)]
        if not tracked and not self._anchors:
            return UNTRUE
        idle = [person.user for person in tracked if not person.was_localized]
        return UNUSED.format(users=", ".join(idle)) if idle else ""

    def _on_message(self, name: str, body: object) -> None:
        person = self._people.get(name)
        match body:
            case Localization() if person:
                person.on_localization(body, self._lamps)
                if body.target_id not in self._lamps:
                    self._targets.setdefault(body.target_id, Course(3))
            case UserPose() if person:
                person.on_pose(body)
            case PointingRay() if person:
                person.on_ray(body)
            case Anchor():
                self._anchors.append((name, body))
            case _:
                pass

    def _track(self, message: TrackedObjects) -> None:
        for item in message.objects:
            person = self._people.get(item.id)
            course = self._targets.get(item.id)
            if person is not None:
                course = person.truth
            if course is not None:
                course.add(message.stamp_ns, item.position_m)
            # the yaw of any other kind is not that of {H}
            if person is None or item.kind != PERSON_FRAME:
                continue
            if item.yaw_rad is not None:
                person.add_yaw(message.stamp_ns, item.yaw_rad)

    def _move(self, name: str, sample: ImuSample) -> None:
        if name in self._rayed:
            return
        arm = self._arms.get(name, DEFAULT_ARM)
        ray = arm.ray(sample.orientation_xyzw)
        if ray is None:
            return
        origin_m, direction = ray
        message = PointingRay(stamp_ns=sample.stamp_ns, origin_m=origin_m, direction=direction)
        self._people[name].on_ray(message)


def _live(person: PersonInSession, yaws_rad: Collection[float | None]) -> Iterable[Outcome]:
    """Yield the outcomes of the poses that were found while a tracker knew the position.

    The true yaw is the tracker's, or that of all the person's trials, `yaws_rad`, if it is the same.
    """
    common_yaw_rad = None
    if len(yaws_rad) == 1:
        (common_yaw_rad,) = yaws_rad
    for pose in person.poses.values():
        times_ns = np.array([pose.stamp_ns])
        place_m = person.truth.at(times_ns)[0]
        if not np.isfinite(place_m).all():
            continue

        # errors
        tracked_yaw = person.yaws.at(times_ns)[0]
        yaw_rad = common_yaw_rad
        if np.isfinite(tracked_yaw).all():
            cosine, sine = tracked_yaw
            yaw_rad = math.atan2(sine, cosine)
        yaw_deg = math.nan
        if yaw_rad is not None:
            turned_rad = math.remainder(pose.yaw_rad - yaw_rad, math.tau)
            yaw_deg = math.degrees(turned_rad)
        x_error_m = pose.position_m[0] - place_m[0]
        y_error_m = pose.position_m[1] - place_m[1]

        position_sigma_m, yaw_sigma_rad = _stated_sigmas(pose)
        condition = pose.method.replace("_", " ")
        yield Outcome(
            key=Key(set=SET, subject=person.user, condition=condition),
            solver=LIVE,
            position_m=math.hypot(x_error_m, y_error_m),
            yaw_deg=yaw_deg,
            position_sigma_m=position_sigma_m,
            yaw_sigma_deg=math.degrees(yaw_sigma_rad),
        )


def _stated_sigmas(pose: UserPose) -> tuple[float, float]:
    """Return the standard deviations of the position along its worst direction, m, and of the yaw, rad."""
    # rounding may leave a variance below zero
    covariance = np.array(pose.covariance).reshape(3, 3)
    place_variances = np.linalg.eigvalsh(covariance[:2, :2])
    place_variance = max(0.0, float(place_variances[-1]))
    yaw_variance = max(0.0, float(covariance[2, 2]))
    return math.sqrt(place_variance), math.sqrt(yaw_variance)


def _anchors(subject: str, anchors: Sequence[Anchor]) -> Row:
    """Return the row of the angles between rays and known places, in the pose before each anchor."""
    upwards = [anchor.elevation_error_rad for anchor in anchors]
    angles: list[float] = []
    for anchor in anchors:
        # an error of the azimuth is a smaller angle for a steep ray
        level = math.hypot(*anchor.direction[:2])
        sideways = anchor.azimuth_error_rad * level
        angles.append(math.hypot(sideways, anchor.elevation_error_rad))
    return Row(
        set=SET,
        subject=subject,
        condition=ANCHORS,
        solver=LIVE,
        n=len(anchors),
        pitch_deg=MetricSpread.of(map(math.degrees, upwards)),
        angle_deg=MetricSpread.of(map(math.degrees, angles)),
    )
