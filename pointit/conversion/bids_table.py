"""Tables of Motion-BIDS: samples of one tracking system, and the description of its channels."""

import itertools
from array import array
from collections.abc import Iterable, Iterator, Sequence
from math import isnan, nan
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from pointit.runtime.host.extras import pointit_version
from pointit.schemas import NS_PER_S

MISSING = "n/a"
"""Missing value of BIDS."""
MIN_DURATION_S = 1.0
"""Least duration of a session from which a rate is computed, s."""
KINDS = ("POS", "ORNT", "VEL", "GYRO", "ACCEL", "ANGACCEL", "MAGN", "JNTANG", "MISC")
"""Types of channels that are counted."""
_FRAMES = {
    "room": ("FLU", "x and y as in the map of the room, z up. x is written as forward."),
    "person": ("FLU", "at the person's feet; x where the yaw of the wrist is 0, z up"),
    "arm": ("FLU", "x along the arm to the finger"),
}
"""Axes and descriptions of frames of reference."""
SYSTEMS = {
    "imu": "PointIt: wrist with an inertial measurement unit",
    "pose": "PointIt: localization of the person",
    "cursor": "PointIt: intersection of the pointing ray with the room",
}
"""Descriptions of tracking systems by their labels. Others are trackers of objects."""


class BidsChannel(NamedTuple):
    """A row of `channels.tsv`."""

    point: str
    """Tracked point or object."""
    kind: str
    """Type of the standard, such as `POS`."""
    component: str
    unit: str
    frame: str
    placement: str = MISSING
    owner: str = ""
    """Person to whose files it belongs, or `""` for all."""

    @property
    def name(self) -> str:
        """Unique name in a file."""
        return f"{self.point}_{self.kind}_{self.component}"


class BidsTable:
    """Samples of one tracking system."""

    def __init__(self) -> None:
        """Begin without samples."""
        self.stamps_ns = array("q")
        self._columns: dict[BidsChannel, array[float]] = {}

    def add(self, stamp_ns: int, cells: Iterable[tuple[BidsChannel, float]]) -> None:
        """Add a row. Channels without a cell have no value in it."""
        row = len(self.stamps_ns)
        self.stamps_ns.append(stamp_ns)
        for channel, value in cells:
            column = self._columns.setdefault(channel, array("d"))
            column.extend([nan] * (row - len(column)))
            column[row:] = array("d", [value])

    def channels(self, person: str) -> list[BidsChannel]:
        """Return the channels for the files of `person`."""
        return [channel for channel in self._columns if channel.owner in ("", person)]

    def rows(self, person: str, onset_ns: int) -> Iterator[str]:
        """Yield the lines of `motion.tsv`, in order of time."""
        columns = [self._columns[channel] for channel in self.channels(person)]
        for row in sorted(range(len(self.stamps_ns)), key=self.stamps_ns.__getitem__):
            latency_s = (self.stamps_ns[row] - onset_ns) / NS_PER_S
            cells = [f"{latency_s:.6f}"]
            for column in columns:
                value = column[row] if row < len(column) else nan
                cells.append(MISSING if isnan(value) else f"{value:.6f}")
            yield "\t".join(cells)

    def rates_hz(self, duration_s: float) -> tuple[float, float]:
        """Return the nominal and the effective rate in a session of `duration_s`, which are above 0.

        The standard wants a number, and readers divide by it. Samples of one time, such as a pose that was
        set once, have the rate that their number in the whole session gives, as the standard computes it.
        """
        stamps_ns = sorted(self.stamps_ns)
        steps_ns = [end_ns - start_ns for start_ns, end_ns in itertools.pairwise(stamps_ns)]
        steps_ns = [step_ns for step_ns in steps_ns if step_ns > 0]
        if not steps_ns:
            rate_hz = _rounded(len(stamps_ns) / max(duration_s, MIN_DURATION_S))
            return rate_hz, rate_hz
        nominal_hz = NS_PER_S / median(steps_ns)
        effective_hz = (len(stamps_ns) - 1) * NS_PER_S / (stamps_ns[-1] - stamps_ns[0])
        return _rounded(nominal_hz), _rounded(effective_hz)


def _rounded(rate_hz: float) -> float:
    """Return `rate_hz` with six digits, so that a low one is not 0."""
    return float(f"{rate_hz:.6g}")


def motion_folder(begin: str) -> Path:
    """Return the folder in a dataset of files whose names begin with `begin`, subject and session."""
    subject, _, session = begin.partition("_task-")[0].partition("_")
    return Path(subject, session, "motion")


def motion_json(
    system: str, task: str, channels: Sequence[BidsChannel], table: BidsTable, duration_s: float
) -> dict[str, Any]:
    """Return the content of `motion.json`. `duration_s`: of the session."""
    nominal_hz, effective_hz = table.rates_hz(duration_s)
    kinds = [channel.kind for channel in channels]
    counts = {f"{kind}ChannelCount": kinds.count(kind) for kind in KINDS}
    points = {channel.point for channel in channels}
    return {
        "TaskName": task,
        "TaskDescription": "pointing at things with the arm",
        "TrackingSystemName": SYSTEMS.get(system, f"tracker {system}"),
        "SamplingFrequency": nominal_hz,
        "SamplingFrequencyEffective": effective_hz,
        "MissingValues": MISSING,
        "SoftwareVersions": f"PointIt {pointit_version()}".strip(),
        "MotionChannelCount": len(channels) + 1,  # with the latency
        "TrackedPointsCount": len(points),
        "LATENCYChannelCount": 1,
        **counts,
    }


def channel_lines(channels: Sequence[BidsChannel]) -> Iterator[str]:
    """Yield the lines of `channels.tsv`."""
    yield "name\tcomponent\ttype\ttracked_point\tunits\tplacement\treference_frame"
    yield f"latency\t{MISSING}\tLATENCY\t{MISSING}\ts\t{MISSING}\t{MISSING}"
    for channel in channels:
        cells = (
            channel.name,
            channel.component,
            channel.kind,
            channel.point,
            channel.unit,
            channel.placement,
            channel.frame,
        )
        yield "\t".join(cells)


def channels_json(channels: Sequence[BidsChannel]) -> dict[str, Any]:
    """Return the content of `channels.json`: frames of reference."""
    used_frames = {channel.frame for channel in channels}
    levels: dict[str, dict[str, str]] = {}
    for frame, (axes, text) in _FRAMES.items():
        if frame in used_frames:
            levels[frame] = {
                "SpatialAxes": axes,
                "RotationRule": "right-hand",
                "RotationOrder": MISSING,
                "Description": text,
            }
    return {"reference_frame": {"Description": "frame in which values are expressed", "Levels": levels}}
