"""Errors of poses against motion capture of the person."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S, UserPose, summarize_validation_error
from pointit.sim.recordings import ImuRecording

BUCKET_S = 5.0
"""Length of the parts of a recording over which errors are summarized."""

INDEX = "index.json"
"""Name of the index beside recordings: a list of objects with properties, one per file."""

REFERENCE_YAW = "ref_yaw_deg_human_minus_world"
"""Key in the index: azimuth in {H} minus azimuth in {W} of the same direction, degrees."""

_ENTRIES = TypeAdapter(list[dict[str, Any]])


@dataclass(frozen=True, kw_only=True)
class PoseError:
    """Errors of one pose."""

    t_s: float
    """Time in the recording of the newest ray in the pose."""
    position_error_m: float | None
    """Horizontal. None without motion capture of the head."""
    yaw_error_deg: float | None
    """In [-180, 180]. None without a reference."""
    position_sigma_m: float
    yaw_sigma_deg: float
    residual_deg: float
    elevation_bias_deg: float
    samples: int


def reference_yaw_deg(recording: Path) -> float | None:
    """Return the azimuth of {H}'s x axis in {W} from the index beside `recording`, or None.

    Raises:
        ConfigError: If there is an index, but it cannot be used.
    """
    index = recording.parent / INDEX
    if not index.exists():
        return None
    try:
        entries = _ENTRIES.validate_json(index.read_bytes())
    except OSError as error:
        raise ConfigError(f"{index}: cannot be read ({error.strerror or error})") from error
    except ValidationError as error:
        raise ConfigError(
            f"{index}: a JSON list of objects was expected; {summarize_validation_error(error)}"
        ) from error
    value = next((entry.get(REFERENCE_YAW) for entry in entries if entry.get("file") == recording.name), None)
    if value is None:
        return None
    if not isinstance(value, int | float):
        raise ConfigError(f"{index}, {recording.name}, {REFERENCE_YAW}: a number was expected, got {value!r}")
    return -float(value)


class Accuracy:
    """Compares poses with a recording's motion capture."""

    def __init__(self, recording: ImuRecording, start_ns: int, yaw_deg: float | None = None) -> None:
        """Compare with `recording`, whose first sample was at `start_ns`, and with the true `yaw_deg`."""
        self._recording = recording
        self._start_ns = start_ns
        self._yaw_deg = yaw_deg
        self.rows: list[PoseError] = []
        """Errors in order of arrival."""

    def add(self, pose: UserPose) -> PoseError:
        """Measure the error of `pose` at its own time, and store it."""
        t_s = (pose.stamp_ns - self._start_ns) / NS_PER_S
        covariance = np.array(pose.covariance, dtype=np.float64).reshape(3, 3)
        row = PoseError(
            t_s=t_s,
            position_error_m=self._position_error_m(pose, t_s),
            yaw_error_deg=self._yaw_error_deg(pose),
            position_sigma_m=math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))),
            yaw_sigma_deg=math.degrees(math.sqrt(max(0.0, float(covariance[2, 2])))),
            residual_deg=math.degrees(pose.residual_rad),
            elevation_bias_deg=math.degrees(pose.elevation_bias_rad),
            samples=pose.samples,
        )
        self.rows.append(row)
        return row

    def buckets(self) -> list[dict[str, float | int | None]]:
        """Return median and 90th percentile of the errors for each `BUCKET_S` of the recording."""
        groups: dict[int, list[PoseError]] = {}
        for row in self.rows:
            groups.setdefault(int(row.t_s // BUCKET_S), []).append(row)
        return [
            {"from_s": number * BUCKET_S, "to_s": (number + 1) * BUCKET_S, **_summary(rows)}
            for number, rows in sorted(groups.items())
        ]

    def overall(self) -> dict[str, float | int | None]:
        """Return the same over all poses."""
        return _summary(self.rows)

    def _position_error_m(self, pose: UserPose, t_s: float) -> float | None:
        head_m = self._recording.head_m
        if head_m is None:
            return None
        x, y = (float(np.interp(t_s, self._recording.t_s, head_m[:, axis])) for axis in range(2))
        return math.hypot(pose.position_m[0] - x, pose.position_m[1] - y)

    def _yaw_error_deg(self, pose: UserPose) -> float | None:
        if self._yaw_deg is None:
            return None
        return math.remainder(math.degrees(pose.yaw_rad) - self._yaw_deg, 360.0)


def _summary(rows: Sequence[PoseError]) -> dict[str, float | int | None]:
    positions = [row.position_error_m for row in rows if row.position_error_m is not None]
    yaws = [abs(row.yaw_error_deg) for row in rows if row.yaw_error_deg is not None]
    sigmas = [row.position_sigma_m for row in rows]
    return {
        "poses": len(rows),
        "position_error_m_median": _quantile(positions, 0.5),
        "position_error_m_p90": _quantile(positions, 0.9),
        "yaw_error_deg_median": _quantile(yaws, 0.5),
        "yaw_error_deg_p90": _quantile(yaws, 0.9),
        "position_sigma_m_median": _quantile(sigmas, 0.5),
    }


def _quantile(values: Sequence[float], share: float) -> float | None:
    return float(np.quantile(values, share)) if values else None
