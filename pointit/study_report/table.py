"""Tables of results, scores of questionnaires, and intervals over participants."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pointit.errors import ConfigError
from pointit.study.questionnaire import NASA_TLX, SUS
from pointit.study.table_file import NUMBER
from pointit.study_report.reading import Trials

Statistic = Callable[..., Any]
"""A statistic over the `axis` of an array, such as `numpy.median`."""

RESAMPLES = 10_000
LEVEL = 0.95


class Table(list[dict[str, Any]]):
    """Rows with the same keys, None if not determined; `pandas.DataFrame(table)` makes a data frame."""

    def _repr_html_(self) -> str:
        """Return the table in HTML, which notebooks show."""
        if not self:
            return "<p>No row.</p>"
        titles = [name.replace("_", " ") for name in self[0]]
        head = "".join(f"<th>{escape(title)}</th>" for title in titles)
        body = ""
        for row in self:
            cells = "".join(_cell(value) for value in row.values())
            body += f"<tr>{cells}</tr>"
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    html = _repr_html_


def _cell(value: Any) -> str:
    if value is None:
        return "<td>-</td>"
    if isinstance(value, float):
        return f'<td class="number">{value:.3g}</td>'
    number = ' class="number"' if isinstance(value, int) else ""
    return f"<td{number}>{escape(str(value))}</td>"


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
    resampled = array[resample_indices(len(array))]
    return percentile_interval(statistic(resampled, axis=1))


def summary(
    values: Sequence[float], name: str, statistic: Statistic = np.median, **columns: object
) -> dict[str, Any]:
    """Return the last columns of a row: participants, `columns`, a statistic of the values, its interval."""
    low, high = interval(values, statistic)
    middle = float(statistic(np.array(values), axis=0)) if values else None
    return {"participants": len(values), **columns, name: middle, "low": low, "high": high}


def percentile_interval(resampled: NDArray[np.float64]) -> tuple[float, float]:
    """Return the quantiles of resampled statistics between which `LEVEL` of them are."""
    limits = [(1 - LEVEL) / 2, (1 + LEVEL) / 2]
    low, high = np.quantile(resampled, limits)
    return float(low), float(high)


def system_usability(values: Sequence[float]) -> float:
    """Return the score of the System Usability Scale, 0 to 100, of its ten items from 1 to 5, in their order.

    Brooke, J. (1996). SUS: a quick and dirty usability scale. Raises: ConfigError: If an item is missing or
    not from 1 to 5.
    """
    if len(values) != len(SUS.items):
        raise ConfigError(f"SUS has {len(SUS.items)} items, not {len(values)}; complete its answers")
    least, most = SUS.points
    total = 0.0
    for item, value in enumerate(values, 1):
        if not least <= value <= most:
            raise ConfigError(f"SUS: answer {value:g} is not from 1 to 5; correct it")
        # Odd items are favourable, even ones unfavourable.
        total += value - 1 if item % 2 else 5 - value
    return 2.5 * total


def questionnaires(trials: Trials) -> Table:
    """Return scores by questionnaire and condition: means over participants, with bootstrap intervals.

    SUS becomes its score. NASA-TLX becomes the mean of its items, the raw TLX (Hart, 2006), followed by its
    items. Of other questionnaires, each item with numbers is a row. Further answers, such as text, stay in
    `answers.csv`. The last answer to an item counts.

    Raises: ConfigError: If there is no answer that is a number, or one of SUS cannot be used.
    """
    # A sheet is what a participant filled in once: numbers by item.
    sheets: dict[tuple[str, ...], dict[str, float]] = defaultdict(dict)
    for row in trials.answers:
        value = row["value"]
        if NUMBER.fullmatch(value):
            key = (row["questionnaire"], row["condition"], row["block"], row["participant"])
            sheets[key][row["item"]] = float(value)
    if not sheets:
        raise ConfigError(f"{trials.folder}: no answer to a questionnaire that is a number")

    # The scores of a participant in a condition, which may have several blocks.
    scores: dict[tuple[str, str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for (name, condition, _, participant), answers in sheets.items():
        for item, value in _scores_of(name, answers).items():
            scores[name, item, condition][participant].append(value)

    table = Table()
    for (name, item, condition), people in scores.items():
        means = [float(np.mean(values)) for values in people.values()]
        row = {"questionnaire": name, "item": item, "condition": condition or "all"}
        table.append({**row, **summary(means, "mean", np.mean)})
    return table


def _scores_of(name: str, answers: Mapping[str, float]) -> Mapping[str, float]:
    """Return the scores of one sheet of the questionnaire `name`. Raises ConfigError."""
    if name == SUS.name:
        numbers = map(str, range(1, len(SUS.items) + 1))
        values = [answers[number] for number in numbers if number in answers]
        return {"score, 0 to 100": system_usability(values)}
    if name == NASA_TLX.name:
        return {"raw TLX": float(np.mean([*answers.values()])), **answers}
    return answers
