"""One localization to try: what a person pointed, at what, and where they really stood."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.services.localizer.estimation.estimator import Pointings

Array = NDArray[np.float64]

WINDOWS_S = (1, 2, 3, 5, 8, 10, 20)
"""Durations of pointing at a moving robot that are tried."""

STRIDE_S = 1.0
"""A window starts so often."""

SLACK_S = 0.05
"""So much may be missing at the end of the last window: a sample and a rounded time."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One localization to try, and the truth."""

    set: str
    subject: str
    condition: str
    """`2 s`, `3 targets`."""
    pointings: Pointings
    """In order of time; repeated samples are taken out."""
    eye_height_m: float
    x_m: float
    """True place of {H} in {W}: of the head."""
    y_m: float
    yaw_rad: float | None
    """True azimuth of {H}'s x axis in {W}; none where it is not known."""
    independent_hz: float | None = 2.0
    """Independent pointings per second, as people's are: the samples of a hold err together; none: unlike."""


@dataclass(frozen=True, kw_only=True)
class FollowRecording:
    """A recording of somebody who follows a moving robot with the finger."""

    set: str
    subject: str
    pointings: Pointings
    """n; the time starts near 0."""
    heads_m: Array
    """n x 3, {W}."""
    eye_height_m: float
    yaw_rad: float | None

    def trials(self, windows_s: Iterable[float] = WINDOWS_S) -> Iterator[Trial]:
        """Yield windows of each length, one every `STRIDE_S`; the truth is where the head was on average.

        Windows with less than two samples, as in a gap, are stepped over, however long the gap is.
        """
        stamps_s = self.pointings.stamps_s
        for length_s in windows_s:
            last_s = float(stamps_s[-1]) - length_s + SLACK_S
            starts_s = _starts(stamps_s, length_s)
            starts_s = starts_s[starts_s < last_s + 1e-9]
            begins, ends = np.searchsorted(stamps_s, (starts_s, starts_s + length_s))
            for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
                part = slice(begin, end)
                if end - begin < 2:
                    continue
                head = self.heads_m[part].mean(axis=0)
                yield Trial(
                    set=self.set,
                    subject=self.subject,
                    condition=f"{length_s:g} s",
                    pointings=Pointings(
                        stamps_s[part],
                        self.pointings.origins_m[part],
                        self.pointings.directions[part],
                        self.pointings.targets_m[part],
                    ),
                    eye_height_m=self.eye_height_m,
                    x_m=float(head[0]),
                    y_m=float(head[1]),
                    yaw_rad=self.yaw_rad,
                )


def _starts(stamps_s: Array, length_s: float) -> Array:
    """Return the multiples of `STRIDE_S` at which a window of `length_s` can begin that holds a sample."""
    last = np.unique(np.floor(stamps_s / STRIDE_S))
    back = np.arange(math.ceil(length_s / STRIDE_S) + 1)
    starts = np.unique(last[:, None] - back) * STRIDE_S
    return np.asarray(starts[starts >= 0.0], dtype=np.float64)


@dataclass
class Reading:
    """What was found in the recordings."""

    trials: list[Trial] = field(default_factory=list[Trial])
    notes: list[str] = field(default_factory=list[str])
    """What was passed over, and why: a sentence each."""

    def skip(self, path: Path, why: str) -> None:
        """Note that `path` was passed over."""
        self.notes.append(f"{path} is skipped: {why}")

    def follow(self, path: Path, following: FollowRecording) -> None:
        """Add the trials of `following`, read from `path`; note where there are none."""
        before = len(self.trials)
        self.trials.extend(following.trials())
        if len(self.trials) == before:
            length_s = float(following.pointings.stamps_s[-1])
            self.skip(
                path,
                f"its {len(following.pointings)} different samples within {length_s:g} s fill no window of "
                f"{min(WINDOWS_S)} s",
            )
