"""Rows of the evaluation of honesty as tables."""

from collections.abc import Sequence
from itertools import groupby

from rich import box
from rich.table import Table
from rich.text import Text

from pointit.cli.evaluate.table import evaluation_console
from pointit.evaluation.honesty.row import EVERY, HonestyRow

NOTES = (
    "`taken`: share of the trials whose pose the localizer takes; the other figures are of those. `m`: "
    "error, median, and beside it p90. `2 sigma`: share of the places within 2 sigma, the ellipse that holds "
    "95.45 % of normal errors (squared Mahalanobis distance up to 6.18); `yaw`: of the yaws. `square`: "
    "median squared Mahalanobis distance of the place, over its nominal value. `wrong`: beyond 2 sigma and "
    "more than 0.5 m off, with a 95 % interval (Wilson) as of independent trials; windows of a recording "
    "overlap, and people have several. `without one`: range of the share before it without any one person."
)
FIGURES = ("n", "taken", "m", "p90", "2 sigma", "without one", "yaw", "square", "wrong", "without one")
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
    screen = evaluation_console()
    shown = [row for row in rows if durations or row.duration == EVERY]
    for name, of_set in groupby(shown, key=lambda row: row.set):
        screen.print(_table(name, list(of_set)))
    screen.print(Text(NOTES))
    if missed:
        screen.print(Text(MISSED, style="bold"))
    for row, figures in missed:
        screen.print(Text(f"  {row.set}, {row.condition}: {', '.join(figures)}"))


def _table(name: str, rows: Sequence[HonestyRow]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=name, title_justify="left", title_style="bold", pad_edge=False)
    table.add_column("condition")
    has_durations = any(row.duration != EVERY for row in rows)
    if has_durations:
        table.add_column("after")
    for figure in FIGURES:
        table.add_column(figure, justify="right", no_wrap=True)
    for row in rows:
        words = (row.condition, row.duration) if has_durations else (row.condition,)
        table.add_row(*map(Text, words), *map(_cell, _figures(row)))
    return table


def _figures(row: HonestyRow) -> tuple[str | None, ...]:
    error, wrong = row.error_m, row.wrong
    return (
        str(row.n),
        _percent(row.taken),
        None if error is None else f"{error.median:.2f}",
        None if error is None else f"{error.p90:.2f}",
        _percent(row.within_2_sigma),
        _range(row.without_one),
        _percent(row.yaw_within_2_sigma),
        None if row.square is None else f"{row.square:.2f}",
        None
        if wrong is None
        else f"{100.0 * wrong.value:.1f} [{100.0 * wrong.low:.1f}, {100.0 * wrong.high:.1f}] %",
        _range(row.wrong_without_one),
    )


def _percent(value: float | None) -> str | None:
    return None if value is None else f"{100.0 * value:.0f} %"


def _range(shares: tuple[float, float] | None) -> str | None:
    return None if shares is None else "{:.0f}-{:.0f}".format(*(100.0 * share for share in shares))


def _cell(text: str | None) -> Text:
    return Text("-", style="dim") if text is None else Text(text)
