"""A person's recorded arm, as in the public recordings, as entries of a recording.

A CSV file has no date: its time 0 becomes `EPOCH_NS`.
"""

import heapq
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.recording.entries import Entry, entry
from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import pointit_version
from pointit.schemas import (
    NS_PER_S,
    Configuration,
    ImuSample,
    Localization,
    PointingRay,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas.system import instance_of
from pointit.schemas.topics import CONFIGURATION, IMU, LOCALIZATION, OBJECTS, PROFILE, RAY
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, ArmFrame
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.pointing.service import PointingConfig
from pointit.services.robot_replay.trajectory import Trajectory
from pointit.sim.motion_table import BIDS_SUFFIX, DOCUMENTED, MotionForm, rows_of
from pointit.sim.recordings import (
    OPERATOR,
    FloorRecording,
    ImuRecording,
    RecordedMotion,
    is_floor_csv,
    read_floor_csv,
    read_imu_csv,
)

EPOCH_NS = 10**18
"""Time of the first sample: 2001-09-09 01:46:40 UTC."""

CSV_MOUNTING = "minus_x"
"""Mounting of the public recordings."""
BIDS_MOUNTING = "plus_x"
"""Mounting of an orientation that is the arm's."""

ROBOT = "robot"
"""Tracker and id of a recorded robot."""

TRACKER = "mocap"
"""Tracker of the person, an object whose id is their name: their true position."""

PERSON = "person"
"""Kind of such an object."""


def csv_entries(
    path: Path,
    *,
    user: str,
    mounting: str = "",
    form: MotionForm = DOCUMENTED,
    note: Callable[[str], None] = lambda _: None,
) -> Iterator[Entry]:
    """Return the entries of the recording at `path`, in order of time.

    The person is `user`. With a robot in the file they follow it with the finger: the recording has a
    localization that samples throughout, and a replay localizes them. The head's marker is their true
    position.

    An arm is that of the public recordings' operator, and a replay computes its rays. Points on the floor
    (`px`, `py`) become rays from the eyes. Without a `mounting` it is that of the public recordings, and that
    of the arm itself in a file of Motion-BIDS, as `pointit export` writes it. What is lost in a row has no
    entry at its time; `note` is called with a sentence about the gaps.

    Raises:
        ConfigError: If it cannot be read, or there is no such `mounting`.
    """
    mounting = mounting or (BIDS_MOUNTING if path.name.endswith(BIDS_SUFFIX) else CSV_MOUNTING)
    if mounting not in MOUNTINGS:
        known = ", ".join(MOUNTINGS)
        raise ConfigError(f"--mounting {mounting}: there is no such mounting; there are {known}")
    if is_floor_csv(path, form):
        floor = read_floor_csv(path, form)
        _note_all(floor, note)
        return _entries(floor, user, [], _rays(floor, user))
    recorded = read_imu_csv(path, form)
    _note_all(recorded, note)
    profile = entry(EPOCH_NS, PROFILE, user, UserProfile(stamp_ns=EPOCH_NS, body=OPERATOR))
    begins = [profile, _configuration("pointing", user, PointingConfig())]
    return _entries(recorded, user, begins, _arm(recorded, user, ArmFrame(MOUNTINGS[mounting])))


def _note_all(motion: RecordedMotion, note: Callable[[str], None]) -> None:
    for sentence in motion.notes:
        note(sentence)


def _entries(
    motion: RecordedMotion, user: str, begins: Sequence[Entry], entries: Iterator[Entry]
) -> Iterator[Entry]:
    yield from begins
    if motion.robot_m is not None:
        robot_localization = Localization(
            stamp_ns=EPOCH_NS, phase="sampling", target_id=ROBOT, target_count=1, since_ns=EPOCH_NS
        )
        yield entry(EPOCH_NS, LOCALIZATION, user, robot_localization)
        yield _configuration("localizer", user, LocalizerConfig(method="moving_target", autostart=True))
    streams = [entries]
    if motion.robot_m is not None:
        streams.append(_robot(motion))
    if motion.head_m is not None:
        streams.append(_head(motion, motion.head_m, user))
    yield from heapq.merge(*streams, key=lambda each: each.time_ns)


def _configuration(service: str, user: str, config: Config) -> Entry:
    instance = instance_of(service, user)
    configuration = Configuration(
        stamp_ns=EPOCH_NS,
        service=service,
        instance=instance,
        user=user,
        parameters=config.model_dump_json(),
        release=pointit_version(),
    )
    return entry(EPOCH_NS, CONFIGURATION, instance, configuration)


def _arm(recorded: ImuRecording, user: str, arm: ArmFrame) -> Iterator[Entry]:
    times_ns = _times_ns(recorded)
    for count, (row, (x, y, z, w)) in enumerate(rows_of(recorded.orientation_xyzw), start=1):
        orientation = arm.orientation((x, y, z, w))
        sample = ImuSample(stamp_ns=times_ns[row], seq=count, orientation_xyzw=orientation)
        yield entry(times_ns[row], IMU, user, sample)


def _rays(recorded: FloorRecording, user: str) -> Iterator[Entry]:
    eyes_m = recorded.eye_height_m
    times_ns = _times_ns(recorded)
    for count, (row, (x, y)) in enumerate(rows_of(recorded.floor_m), start=1):
        way = vector.normalized((x, y, -eyes_m))
        ray = PointingRay(stamp_ns=times_ns[row], seq=count, origin_m=(0.0, 0.0, eyes_m), direction=way)
        yield entry(times_ns[row], RAY, user, ray)


def _robot(motion: RecordedMotion) -> Iterator[Entry]:
    trajectory = Trajectory(motion, ROBOT)
    for index in range(len(trajectory.times_ns)):
        report = trajectory.report(index, EPOCH_NS)
        yield entry(report.stamp_ns, OBJECTS, ROBOT, report)


def _head(motion: RecordedMotion, heads_m: Array, user: str) -> Iterator[Entry]:
    times_ns = _times_ns(motion)
    for count, (row, (x, y, z)) in enumerate(rows_of(heads_m), start=1):
        tracked_object = TrackedObject(id=user, kind=PERSON, position_m=(x, y, z))
        tracked = TrackedObjects(stamp_ns=times_ns[row], seq=count, objects=(tracked_object,))
        yield entry(times_ns[row], OBJECTS, TRACKER, tracked)


def _times_ns(motion: RecordedMotion) -> list[int]:
    return [EPOCH_NS + time_ns for time_ns in np.rint(motion.t_s * NS_PER_S).astype(np.int64).tolist()]
