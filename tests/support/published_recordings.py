"""Invented people, written to files as the published recordings are; errors of pointing as told."""

import csv
import itertools
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HZ = 30.0
ORIGINAL_STATURE_M = 1.835


@dataclass(frozen=True, kw_only=True)
class Stand:
    """Pose of a person and errors of their pointing."""

    x: float = -1.5
    y: float = -1.0
    yaw_deg: float = 35.0
    """Azimuth of {H}'s x axis in {W}."""
    bias_deg: float = 0.0
    noise_deg: float = 0.0
    eyes_m: float = 1.69

    def rays(self, targets: Array) -> Array:
        """Return the azimuths and elevations (n x 2, rad) in {H} of rays at `targets` (n x 3, {W})."""
        away = targets - (self.x, self.y, self.eyes_m)
        level = np.hypot(away[:, 0], away[:, 1])
        azimuths = np.arctan2(away[:, 1], away[:, 0]) - math.radians(self.yaw_deg)
        elevations = np.arctan2(away[:, 2], level) + math.radians(self.bias_deg)
        rng = np.random.default_rng(3)
        noise = rng.normal(0.0, math.radians(self.noise_deg), (2, len(targets)))
        return np.column_stack([azimuths + noise[0], elevations + noise[1]])


def unit(angles: Array) -> Array:
    azimuths, elevations = angles.T
    level = np.cos(elevations)
    x = level * np.cos(azimuths)
    y = level * np.sin(azimuths)
    return np.column_stack([x, y, np.sin(elevations)])


def robot(duration_s: float) -> tuple[Array, Array]:
    """Return times and places of a robot that circles."""
    samples = round(duration_s * HZ) + 1
    times = np.arange(samples) / HZ
    turn = times * 0.6
    x = 0.9 * np.cos(turn)
    y = 0.9 * np.sin(turn)
    z = 0.8 + 0.2 * np.sin(2.0 * turn)
    return times, np.column_stack([x, y, z])


def arm_towards(rays: Array, eyes_m: float, shoulder_m: float, arm_m: float) -> Array:
    """Return the directions of arms from the shoulder whose fingers lie on `rays` (n x 3) from the eyes."""
    up = eyes_m - shoulder_m
    # |(0, 0, up) + s ray| = arm
    half = rays[:, 2] * up
    reach = -half + np.sqrt(half**2 - up**2 + arm_m**2)
    fingers = reach[:, None] * rays
    arms = fingers + np.array((0.0, 0.0, up))
    return arms / arm_m


def write_csv(path: Path, header: str, rows: Iterable[Sequence[Any]]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header.split(","))
        writer.writerows(rows)
    return path


def write_motion(
    recordings: Path, stand: Stand, *, duration_s: float = 12.0, repeat: int = 4, subject: str = "M9"
) -> Path:
    """Write a session; the quaternion of each `repeat`-th row is that of the row before."""
    times, places = robot(duration_s)
    rays = unit(stand.rays(places))
    sensors = _sensors(arm_towards(rays, 1.69, 1.47, 0.69))
    rows: list[list[float]] = []
    for row, time_s in enumerate(times):
        is_repeated = row % repeat == repeat - 1
        sensor = sensors[row - 1] if is_repeated else sensors[row]
        rows.append([time_s, *sensor, *places[row], stand.x, stand.y, 1.82])
    folder = recordings / "motion_relloc"
    header = "t,qw,qx,qy,qz,robot_x,robot_y,robot_z,head_x,head_y,head_z"
    path = write_csv(folder / "circle.csv", header, rows)
    circle = {
        "file": "circle.csv",
        "subject": subject,
        "kind": "pointing_at_moving_drone",
        "ref_yaw_deg_human_minus_world": -stand.yaw_deg,
    }
    idle = {"file": "idle_0.csv", "subject": subject, "kind": "not_pointing_or_unlabelled"}
    lost = {"file": "lost.csv", "subject": subject, "kind": "pointing_at_moving_drone"}
    index = json.dumps([circle, idle, lost])
    (folder / "index.json").write_text(index, encoding="utf-8")
    return path


def _sensors(arms: Array) -> Array:
    """Return the quaternions (n x 4; w, x, y, z) of sensors whose x axes look away from the finger."""
    # Rz(azimuth) Ry(-elevation)
    half_azimuth = 0.5 * (np.arctan2(arms[:, 1], arms[:, 0]) + math.pi)
    half_elevation = 0.5 * np.arcsin(-arms[:, 2])
    ca = np.cos(half_azimuth)
    sa = np.sin(half_azimuth)
    ce = np.cos(half_elevation)
    se = np.sin(half_elevation)
    return np.column_stack([ca * ce, sa * se, -ca * se, sa * ce])


def write_track(
    recordings: Path, stand: Stand, *, duration_s: float = 12.0, subject: str | int = "user9"
) -> Path:
    """Write a track; rays that miss the floor have no point."""
    times, places = robot(duration_s)
    rays = unit(stand.rays(places))
    rows: list[list[Any]] = []
    for time_s, place, ray in zip(times, places, rays, strict=True):
        point: list[Any] = ["", ""]
        if ray[2] < -1e-3:
            distance = stand.eyes_m / -ray[2]
            point = [*(ray[:2] * distance)]
        rows.append([time_s, *point, *place, stand.x, stand.y, stand.eyes_m + 0.115])
    folder = recordings / "proximity_waypoints"
    path = write_csv(folder / "track_9.csv", "t,px,py,robot_x,robot_y,robot_z,head_x,head_y,head_z", rows)
    entry = {
        "file": "track_9.csv",
        "subject": subject,
        "eye_height_guess_m": stand.eyes_m,
        "ref_yaw_deg_human_minus_world": -stand.yaw_deg,
    }
    flown = {"file": "session_9.csv", "subject": subject, "interface": "POINTING"}
    index = json.dumps({"targets_xy": {}, "files": [flown, entry]})
    (folder / "index.json").write_text(index, encoding="utf-8")
    return path


def write_acts(recordings: Path, people: dict[str, tuple[float, Stand]], *, times: int = 2) -> Path:
    """Write acts at nine targets, `times` each; `people`: stature and stand by subject, yaw 0."""
    targets = np.array([*itertools.product((1.5, 2.5), (-1.0, 1.0), (0.5, 1.0))])
    rows: list[list[Any]] = []
    for subject, (stature_m, stand) in people.items():
        factor = stature_m / ORIGINAL_STATURE_M
        eyes_m = 1.64 * factor
        seen = Stand(x=stand.x, y=stand.y, yaw_deg=0.0, bias_deg=stand.bias_deg, eyes_m=eyes_m)
        arms = arm_towards(unit(seen.rays(targets)), eyes_m, 1.43 * factor, 0.73 * factor)
        forearm = np.array([stand.x + 0.2, stand.y - 0.1, 1.3])
        for _ in range(times):
            for target, arm in zip(targets, arms, strict=True):
                hand = forearm + 0.25 * arm
                rows.append([subject, stature_m, *target, stand.x, stand.y, 1.6, *forearm, *hand])
    columns = ["subject", "stature"]
    for part in ("target", "hmd", "forearm", "hand"):
        columns += [f"{part}_x", f"{part}_y", f"{part}_z"]
    return write_csv(recordings / "vr_arm_pointing" / "endpoints.csv", ",".join(columns), rows)
