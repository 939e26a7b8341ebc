"""Rows of the evaluation of honesty as tables."""

from collections.abc import Sequence
from itertools import groupby

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pointit_lab.cli.table import evaluation_console
from pointit_lab.evaluation.honesty.row import EVERY, HonestyRow

NOTES = (
    "`taken`: share of the trials whose pose the localizer takes; the other figures are of those. `m`: "
    "error, median, and beside it p90. `> 1 m`: share more than 1 m off. `miss`: of the cursor at the "
    "targets, m, median, and in brackets what is stated. `right`: mean share of eight things 3 m away all "
    "round that the person selects. `2 sigma`: share of the places within 2 sigma, the "
    "ellipse that holds "
    "95.45 % of normal errors (squared Mahalanobis distance up to 6.18); `yaw`: of the yaws. `square`: "
    "median squared Mahalanobis distance of the place, over its nominal value. `wrong`: beyond 2 sigma and "
    "more than 0.5 m off, with a 95 % interval (Wilson) as of independent trials; windows of a recording "
    "overlap, and people have several. `can show`: share of wrong poses that this number of independent "
    "trials excludes with 95 % confidence if none is wrong: simulated people, stretches of 10 s of a "
    "recording, recorded people who point at lamps. `without one`: range of the share before it without any "
    "one person."
)
FIGURES = (
    "n",
    "taken",
    "m",
    "p90",
    "> 1 m",
    "miss",
    "right",
    "2 sigma",
    "without one",
    "yaw",
    "square",
    "wrong",
    "can show",
    "without one",
)
LEFT_OUT = ("without one", "p90", "square", "n", "yaw", "can show", "right", "miss")
"""Figures that a narrow terminal leaves out, the first one first, so that no condition is cut."""
MISSED = "Missed (90 to 98 % within 2 sigma, square 0.6 to 1.6, at most 1 % wrong):"


def print_honesty(
    rows: Sequence[HonestyRow], missed: Sequence[tuple[HonestyRow, Sequence[str]]], *, durations: bool
) -> None:
    """Print `rows` by set, then the rows that `missed` the targets.

    Args:
        rows: of all durations.
        missed: rows, and their figures out of range.
        durations: also print the rows of single durations.
    """
    console = evaluation_console()
    shown = [row for row in rows if durations or row.duration == EVERY]
    for name, of_set in groupby(shown, key=lambda row: row.set):
        console.print(_fitting(console, name, list(of_set)))
    console.print(Text(NOTES))
    if missed:
        console.print(Text(MISSED, style="bold"))
    for row, figures in missed:
        console.print(Text(f"  {row.set}, {row.condition}: {', '.join(figures)}"))


def _fitting(console: Console, name: str, rows: Sequence[HonestyRow]) -> Table:
    """Return the table of `rows` with as many figures as fit `console`."""
    unbounded = console.options.update(max_width=10 * console.width)
    tables = [_table(name, rows, LEFT_OUT[:count]) for count in range(len(LEFT_OUT) + 1)]
    fits = (each for each in tables if console.measure(each, options=unbounded).maximum <= console.width)
    return next(fits, tables[-1])


def _table(name: str, rows: Sequence[HonestyRow], left_out: Sequence[str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=name, title_justify="left", title_style="bold", pad_edge=False)
    table.padding = (0, 1, 0, 0)
    table.add_column("condition", min_width=max(len(row.condition) for row in rows))
    has_durations = any(row.duration != EVERY for row in rows)
    if has_durations:
        table.add_column("after")
    shown = [index for index, figure in enumerate(FIGURES) if figure not in left_out]
    for index in shown:
        table.add_column(FIGURES[index], justify="right", no_wrap=True)
    for row in rows:
        words = (row.condition, row.duration) if has_durations else (row.condition,)
        figures = _figures(row)
        table.add_row(*map(Text, words), *(_cell(figures[index]) for index in shown))
    return table


def _figures(row: HonestyRow) -> tuple[str | None, ...]:
    error, wrong = row.error_m, row.wrong
    return (
        str(row.n),
        _percent(row.taken),
        None if error is None else f"{error.median:.2f}",
        None if error is None else f"{error.p90:.2f}",
        None if row.far is None else f"{100.0 * row.far.value:.1f} %",
        None if row.miss_m is None else f"{row.miss_m:.2f} ({row.miss_sigma_m:.2f})",
        None if row.right is None else f"{100.0 * row.right:.1f} %",
        _percent(row.within_2_sigma),
        _range(row.without_one),
        _percent(row.yaw_within_2_sigma),
        None if row.square is None else f"{row.square:.2f}",
        None
        if wrong is None
        else f"{100.0 * wrong.value:.1f} [{100.0 * wrong.low:.1f}, {100.0 * wrong.high:.1f}] %",
        None if row.provable is None else f"{100.0 * row.provable:.0f} % ({row.independent})",
        _range(row.wrong_without_one),
    )


def _percent(value: float | None) -> str | None:
    return None if value is None else f"{100.0 * value:.0f} %"


def _range(shares: tuple[float, float] | None) -> str | None:
    return None if shares is None else "{:.0f}-{:.0f}".format(*(100.0 * share for share in shares))


def _cell(text: str | None) -> Text:
    return Text("-", style="dim") if text is None else Text(text)
