"""Yaw errors as multiples of those of plain re-anchoring, with intervals over people."""

from collections.abc import Sequence

import numpy as np

from pointit_lab.evaluation.selection.difference import Interval

PLAIN = "re-anchored"
"""Solver whose yaw is that of the last anchor."""

RESAMPLED = 1000
"""Number of bootstrap samples; people are drawn, with all their trials (Efron 1979)."""

MIN_PEOPLE = 3
"""Smallest number of people for an interval."""


def ratios(
    people: Sequence[str], errors: Sequence[float], plain: Sequence[float]
) -> tuple[Interval, Interval] | None:
    """Return the ratios of median and of p90 with 95 % intervals, or None of fewer than `MIN_PEOPLE`.

    Args:
        people: n names, who each trial is of.
        errors: n yaw errors.
        plain: n yaw errors of `PLAIN` in the same trials.
    """
    names = list(dict.fromkeys(people))
    if len(names) < MIN_PEOPLE:
        return None
    sizes = np.abs(np.array([errors, plain], dtype=np.float64))
    trials = [np.flatnonzero(np.array(people) == name) for name in names]
    grid = np.full((2, len(names), max(map(len, trials))), np.nan)
    for row, mine in enumerate(trials):
        grid[:, row, : len(mine)] = sizes[:, mine]
    drawn = np.random.default_rng(0).integers(len(names), size=(RESAMPLED, len(names)))
    resampled = np.sort(grid[:, drawn].reshape(2, RESAMPLED, -1))  # nan last
    last = np.isfinite(resampled).sum(axis=2, keepdims=True) - 1
    both: list[Interval] = []
    for share in (0.5, 0.9):
        ours, others = np.quantile(sizes, share, axis=1)
        below, rest = np.divmod(share * last, 1.0)  # as `np.nanquantile` does, which takes a row at a time
        smallest, next_ = (
            np.take_along_axis(resampled, np.minimum(below.astype(np.int64) + more, last), axis=2)[:, :, 0]
            for more in (0, 1)
        )
        redrawn = smallest + rest[:, :, 0] * (next_ - smallest)
        low, high = np.quantile(redrawn[0] / redrawn[1], (0.025, 0.975))
        both.append(Interval(value=float(ours / others), low=float(low), high=float(high)))
    return both[0], both[1]
