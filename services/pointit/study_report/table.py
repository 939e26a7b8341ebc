"""Tables of results, and intervals over participants."""

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

RESAMPLES = 10_000
LEVEL = 0.95


class Table(list[dict[str, Any]]):
    """Rows with the same keys, None if not determined; `pandas.DataFrame(table)` makes a data frame."""

    def _repr_html_(self) -> str:
        """Return the table in HTML, which notebooks show."""
        if not self:
            return "<p>No row.</p>"
        head = "".join(f"<th>{escape(name.replace('_', ' '))}</th>" for name in self[0])
        rows = ["".join(_cell(value) for value in row.values()) for row in self]
        body = "".join(f"<tr>{cells}</tr>" for cells in rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    html = _repr_html_


def _cell(value: Any) -> str:
    if value is None:
        return "<td>-</td>"
    if isinstance(value, float):
        return f'<td class="number">{value:.3g}</td>'
    number = ' class="number"' if isinstance(value, int) else ""
    return f"<td{number}>{escape(str(value))}</td>"


Statistic = Callable[..., Any]
"""A statistic over the `axis` of an array, such as `numpy.median`."""


def resample_indices(count: int) -> NDArray[np.int64]:
    """Return indices of draws of `count` participants with replacement, shape (`RESAMPLES`, count)."""
    return np.random.default_rng(0).integers(count, size=(RESAMPLES, count))


def interval(values: ArrayLike, statistic: Statistic = np.median) -> tuple[float | None, float | None]:
    """Return the 95 % percentile bootstrap interval of a statistic over participants.

    `values` has one value of each participant. (None, None) if there are fewer than two. The random numbers
    are the same at each call. Efron, B. and Tibshirani, R. J. (1993). An introduction to the bootstrap.
    """
    array = np.asarray(values, dtype=np.float64)
    if len(array) < 2:
        return None, None
    return percentile_interval(statistic(array[resample_indices(len(array))], axis=1))


def summary(
    values: Sequence[float], name: str, statistic: Statistic = np.median, **columns: object
) -> dict[str, Any]:
    """Return the last columns of a row: participants, `columns`, a statistic of the values, its interval."""
    low, high = interval(values, statistic)
    middle = float(statistic(np.array(values), axis=0)) if values else None
    return {"participants": len(values), **columns, name: middle, "low": low, "high": high}


def percentile_interval(resampled: NDArray[np.float64]) -> tuple[float, float]:
    """Return the quantiles of resampled statistics between which `LEVEL` of them are."""
    low, high = np.quantile(resampled, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)
