"""What an evaluation tells: one row per set of recordings, subject, condition and solver."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

ALL = "all"
"""Subject of the row over all of a set."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How errors are spread; all have one unit."""

    median: float
    p90: float
    rms: float

    @classmethod
    def of(cls, values: Iterable[float]) -> "Spread | None":
        """Return the spread of the sizes of `values`, or none of none."""
        sizes = np.abs(np.array(list(values), dtype=np.float64))
        if not len(sizes):
            return None
        return cls(
            median=float(np.median(sizes)),
            p90=float(np.quantile(sizes, 0.9)),
            rms=math.sqrt(float(np.mean(sizes * sizes))),
        )


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table; what does not apply is none."""

    set: str
    subject: str
    condition: str
    """`2 s`, `3 targets`, `1 anchor`."""
    solver: str
    n: int
    """Trials, refused ones among them."""
    position_m: Spread | None = None
    """Of the poses that were stated."""
    every_m: Spread | None = None
    """Of all trials: where it was refused, of the pose that fits best."""
    yaw_deg: Spread | None = None
    pitch_deg: Spread | None = None
    angle_deg: Spread | None = None
    """Between ray and target."""
    share_above_1m: float | None = None
    misled: float | None = None
    """Share of stated poses that were off by more than 1 m with a sigma below 0.5 m."""
    within_2_sigma: float | None = None
    """Share of true errors of the position within the stated 2 sigma."""
    yaw_within_2_sigma: float | None = None
    refused: int | None = None
    """Trials without a pose."""
    unsure: int | None = None
    """Trials with a pose whose stated sigma is more than the localizer takes; their errors count."""
    solve_ms: Spread | None = None
    bound_m: float | None = None
    """Median position error of an unbiased linear estimate under the assumptions that are stated."""

    def as_json(self) -> dict[str, Any]:
        """Return it as it stands in a JSON file."""
        return asdict(self)


def arranged(rows: Iterable[Row]) -> list[Row]:
    """Return `rows` by set, condition and subject as these are first met, that over all subjects first."""
    met = list(rows)
    sets, conditions, subjects = (
        {name: rank for rank, name in enumerate(dict.fromkeys(names))}
        for names in (
            (row.set for row in met),
            ((row.set, row.condition) for row in met),
            ((row.set, row.subject) for row in met),
        )
    )
    return sorted(
        met,
        key=lambda row: (
            sets[row.set],
            conditions[row.set, row.condition],
            row.subject != ALL,
            subjects[row.set, row.subject],
        ),
    )


def document(rows: Sequence[Row]) -> dict[str, Any]:
    """Return what `--json FILE` writes."""
    return {"rows": [row.as_json() for row in rows]}
