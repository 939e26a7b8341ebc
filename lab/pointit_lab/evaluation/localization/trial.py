"""One localization trial: rays, targets and the true pose."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pointit.geometry.array_types import Array
from pointit.services.localizer.estimation.pointings import GAP_S, Pointings

WINDOWS_S = (1, 2, 3, 5, 8, 10, 20)
"""Evaluated durations of pointing at a moving robot."""

STRIDE_S = 1.0
"""Interval between the starts of windows."""

SLACK_S = 0.05
"""Time that may be missing at the end of the last window: a sample and a rounded time."""


@dataclass(frozen=True, kw_only=True)
class LocalizationTrial:
    """One localization trial, and the truth."""

    set: str
    subject: str
    condition: str
    """`2 s`, `3 targets`."""
    pointings: Pointings
    """Pointings in order of time, without repeated samples."""
    eye_height_m: float
    x_m: float
    """True position of {H} in {W}: that of the head."""
    y_m: float
    yaw_rad: float | None
    """True azimuth of {H}'s x axis in {W}, or None if unknown."""
    recording: str = ""
    """Name of the recording of following."""
    start_s: float = 0.0
    """Start of the window in it."""


@dataclass(frozen=True, kw_only=True)
class FollowRecording:
    """A recording of a person who follows a moving robot with the finger."""

    set: str
    subject: str
    pointings: Pointings
    """n; times start near 0."""
    heads_m: Array
    """n x 3, {W}."""
    eye_height_m: float
    yaw_rad: float | None
    name: str = ""

    def shifted(self, shift_s: float) -> "FollowRecording":
        """Return the recording with the robot reported where it was `shift_s` before; gaps are left out."""
        pointings = self.pointings
        stamps_s = pointings.stamps_s
        then_s = stamps_s - shift_s

        # only where the robot was observed: within the recording, and not in a gap
        within = (then_s >= stamps_s[0]) & (then_s <= stamps_s[-1])
        after = np.searchsorted(stamps_s, then_s)
        after = np.clip(after, 1, len(stamps_s) - 1)
        intervals_s = stamps_s[after] - stamps_s[after - 1]
        within &= intervals_s <= GAP_S

        targets_m = np.empty(pointings.targets_m.shape)
        for axis in range(3):
            targets_m[:, axis] = np.interp(then_s, stamps_s, pointings.targets_m[:, axis])
        shifted_pointings = replace(pointings, targets_m=targets_m)
        return replace(self, pointings=shifted_pointings.only(within), heads_m=self.heads_m[within])

    def trials(self, windows_s: Iterable[float] = WINDOWS_S) -> Iterator[LocalizationTrial]:
        """Yield windows of each length, one every `STRIDE_S`; the truth is the mean position of the head.

        Windows with fewer than two samples, as in a gap of any length, are skipped.
        """
        stamps_s = self.pointings.stamps_s
        for length_s in windows_s:
            last_s = float(stamps_s[-1]) - length_s + SLACK_S
            starts_s = _starts(stamps_s, length_s)
            starts_s = starts_s[starts_s < last_s + 1e-9]
            # samples are not evenly spaced: windows are found by time
            firsts, ends = np.searchsorted(stamps_s, (starts_s, starts_s + length_s))
            windows = zip(starts_s.tolist(), firsts.tolist(), ends.tolist(), strict=True)
            for start_s, first, end in windows:
                if end - first >= 2:
                    yield self._window(slice(first, end), start_s=start_s, length_s=length_s)

    def _window(self, part: slice, *, start_s: float, length_s: float) -> LocalizationTrial:
        """Return the trial of the samples of `part`."""
        head = self.heads_m[part].mean(axis=0)
        window = Pointings(
            self.pointings.stamps_s[part],
            self.pointings.origins_m[part],
            self.pointings.directions[part],
            self.pointings.targets_m[part],
        )
        return LocalizationTrial(
            set=self.set,
            subject=self.subject,
            condition=f"{length_s:g} s",
            pointings=window,
            eye_height_m=self.eye_height_m,
            x_m=float(head[0]),
            y_m=float(head[1]),
            yaw_rad=self.yaw_rad,
            recording=self.name,
            start_s=start_s,
        )


def _starts(stamps_s: Array, length_s: float) -> Array:
    """Return the multiples of `STRIDE_S` at which a window of `length_s` with a sample can start."""
    strides = np.floor(stamps_s / STRIDE_S)
    last = np.unique(strides)
    longest = math.ceil(length_s / STRIDE_S)
    back = np.arange(longest + 1)
    starts = np.unique(last[:, None] - back) * STRIDE_S
    return np.asarray(starts[starts >= 0.0], dtype=np.float64)


@dataclass
class TrialReading:
    """Trials read from recordings."""

    trials: list[LocalizationTrial] = field(default_factory=list[LocalizationTrial])
    followed: list[FollowRecording] = field(default_factory=list[FollowRecording])
    """Recordings of following, from which trials were read."""
    notes: list[str] = field(default_factory=list[str])
    """Messages about skipped data, with the reason."""

    def skip(self, path: Path, reason: str) -> None:
        """Note that `path` was skipped."""
        self.notes.append(f"{path} is skipped: {reason}")

    def follow(self, path: Path, following: FollowRecording) -> None:
        """Add the trials of `following`, read from `path`, or a note if there are none."""
        following = replace(following, name=path.stem)
        self.followed.append(following)
        trials = list(following.trials())
        self.trials.extend(trials)
        if not trials:
            length_s = float(following.pointings.stamps_s[-1])
            extent = f"{len(following.pointings)} different samples within {length_s:g} s"
            self.skip(path, f"its {extent} fill no window of {min(WINDOWS_S)} s")
