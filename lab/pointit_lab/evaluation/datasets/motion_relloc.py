"""`motion_relloc`: an operator with a Myo on the forearm follows a flying drone."""

from pathlib import Path

import numpy as np

from pointit.geometry.rotation import Quaternion
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, ArmFrame
from pointit.services.localizer.estimation.estimator import Pointings
from pointit.sim.recordings import OPERATOR, read_imu_csv
from pointit_lab.evaluation.datasets.plausible import check_reach, check_times
from pointit_lab.evaluation.localization.arm_rays import eye_finger_rays, eye_height_m
from pointit_lab.evaluation.localization.trial import FollowRecording, TrialReading
from pointit_lab.evaluation.recordings.data_folder import file_of, read_index, text_of, yaw_of

NAME = "motion_relloc"
KIND = "pointing_at_moving_drone"
MOUNTING = "minus_x"
"""Mounting of a Myo: the arm lies along the sensor's minus x axis."""


def read(folder: Path, reading: TrialReading) -> None:
    """Add the windows of all files of `folder` whose kind is `KIND`.

    Raises:
        ConfigError: If the index or a file is damaged.
    """
    for entry in read_index(folder):
        if entry.get("kind") != KIND:
            continue
        path = file_of(folder, entry)
        if path is None:
            name = text_of(folder, entry, "file")
            reading.skip(folder / name, "the index lists it, but it is missing")
            continue
        subject = text_of(folder, entry, "subject")
        _add(path, subject, yaw_of(folder, entry), reading)


def _add(path: Path, subject: str, yaw_rad: float | None, reading: TrialReading) -> None:
    recorded = read_imu_csv(path)
    if recorded.robot_m is None or recorded.head_m is None:
        reading.skip(path, "it has no positions of robot and head")
        return
    check_times(path, recorded.t_s)
    samples = np.hstack([recorded.orientation_xyzw, recorded.robot_m, recorded.head_m])
    is_whole = np.isfinite(samples).all(axis=1)
    t_s = recorded.t_s[is_whole]
    orientation_xyzw = recorded.orientation_xyzw[is_whole]
    robot_m = recorded.robot_m[is_whole]
    head_m = recorded.head_m[is_whole]
    check_reach(path, robot_m, head_m, "robot ('robot_x', …) and head ('head_x', …)")

    # the radio data, 50 Hz with gaps, was resampled to 30 Hz: repeated samples are old
    steps = np.diff(orientation_xyzw, axis=0)
    is_new = np.any(steps != 0.0, axis=1)
    fresh = np.append(True, is_new)

    # the sensor's orientations are those of the arm but for its mounting
    arm = ArmFrame(MOUNTINGS[MOUNTING])
    sensors: list[Quaternion] = [tuple(row) for row in orientation_xyzw[fresh].tolist()]
    arms = (arm.orientation(sensor) for sensor in sensors)
    origins_m, directions = eye_finger_rays(arms, OPERATOR)
    following = FollowRecording(
        set=NAME,
        subject=subject,
        pointings=Pointings(t_s[fresh], origins_m, directions, robot_m[fresh]),
        heads_m=head_m[fresh],
        eye_height_m=eye_height_m(OPERATOR),
        yaw_rad=yaw_rad,
    )
    reading.follow(path, following)
