"""Rows of an evaluation as tables: one per set, a block per condition, as wide as the terminal."""

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Generic, TypeVar

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import OutputSection, print_table
from pointit_lab.evaluation.localization.over_people import OverPeople
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row
from pointit_lab.evaluation.selection.difference import Interval

AnyRow = TypeVar("AnyRow")

PIPE_WIDTH = 100
"""Width without a terminal, unless COLUMNS in the environment is set."""

WORDS_WIDTH = 16
"""Characters after which conditions and solvers wrap if there is little room."""
_SIGMA_NOTE = "`2 sigma`: share of errors within twice the stated sigma."

_SPREADS = "Errors are sizes: the median, and beside it p90 and rms."


@dataclass(frozen=True, kw_only=True)
class Column(Generic[AnyRow]):
    """A column of figures."""

    name: str
    """Full name, unique among the columns."""
    cell: Callable[[AnyRow], str | None]
    """Returns the text, or None if it does not apply."""
    rank: int = 0
    """The lowest ranks are shown if there is little room; a p90 ranks after its median."""
    title: str = ""
    """Column heading. `""`: its name."""
    note: str = ""
    """Explanation, printed below the table."""

    @property
    def head(self) -> str:
        """Return the column heading."""
        return self.title or self.name


@dataclass(frozen=True, kw_only=True)
class FittedTable(Generic[AnyRow]):
    """A table with as many columns as fit the screen."""

    table: Table
    columns: Sequence[Column[AnyRow]]
    left_out: Sequence[Column[AnyRow]]
    needed: int
    """Width with all columns, characters."""


def fitted_table(
    console: Console,
    title: str,
    words: Mapping[str, Sequence[str]],
    columns: Sequence[Column[AnyRow]],
    rows: Sequence[AnyRow],
) -> FittedTable[AnyRow]:
    """Return the table of `rows` as wide as `console`, so that no text is cut.

    Empty columns are left out, and those of the highest ranks that do not fit.

    Args:
        console: the screen.
        title: of the table.
        words: texts in front of the figures, by column heading, one for each row. Rows with the same first
            text are a block.
        columns: figures.
        rows: rows.
    """
    cells: dict[str, list[str | None]] = {}
    filled: list[Column[AnyRow]] = []
    for column in columns:
        texts = [column.cell(row) for row in rows]
        cells[column.name] = texts
        if any(text is not None for text in texts):
            filled.append(column)

    # The width of a table is known only when it is made, so it is made with one column less until it fits.
    needed = 0
    by_rank = sorted(filled, key=lambda column: column.rank)
    unbounded = console.options.update(max_width=10 * PIPE_WIDTH)
    for count in range(len(filled), -1, -1):
        shown: list[Column[AnyRow]] = []
        left_out: list[Column[AnyRow]] = []
        for column in filled:
            if column in by_rank[:count]:
                shown.append(column)
            else:
                left_out.append(column)
        figures = [(column.head, cells[column.name]) for column in shown]
        table = _table(title, words, figures)
        width = console.measure(table, options=unbounded).minimum
        needed = max(needed, width)
        if width <= console.width or not count:
            return FittedTable(table=table, columns=shown, left_out=left_out, needed=needed)
    raise AssertionError


def _table(
    title: str, words: Mapping[str, Sequence[str]], figures: Sequence[tuple[str, Sequence[str | None]]]
) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)
    table.padding = (0, 1, 0, 0)
    # Words may wrap, figures never.
    for head, texts in words.items():
        width = max(map(len, (head, *texts)))
        table.add_column(head, min_width=min(WORDS_WIDTH, width))
    for head, figure_texts in figures:
        width = len(head)
        for text in figure_texts:
            width = max(width, len(text or "-"))
        table.add_column(head, justify="right", no_wrap=True, min_width=width)

    # A block ends where the first text changes.
    lines = list(zip(*words.values(), strict=True))
    blocks = [line[0] for line in lines]
    has_blocks = len(set(blocks)) < len(blocks)
    next_blocks = [*blocks[1:], None]
    for index, (line, next_block) in enumerate(zip(lines, next_blocks, strict=True)):
        cells = [Text(text) for text in line]
        for _, figure_texts in figures:
            cells.append(_figure(figure_texts[index]))
        is_end = has_blocks and next_block != line[0]
        table.add_row(*cells, end_section=is_end)
    return table


def _figure(text: str | None) -> Text:
    if text is None:
        return Text("-", style="dim")
    return Text(text)


def number(value: float | None, digits: int) -> str | None:
    """Return the text of `value`, or None."""
    if value is None:
        return None
    return f"{value:.{digits}f}"


def share(value: float | None, digits: int = 0) -> str | None:
    """Return the text of a share in per cent, or None."""
    if value is None:
        return None
    percent = 100.0 * value
    return f"{percent:.{digits}f} %"


def _spread(
    name: str, of: Callable[[Row], MetricSpread | None], digits: int, ranks: Sequence[int], note: str = ""
) -> Iterator[Column[Row]]:
    """Yield the columns of median, p90 and rms, as many as there are `ranks`."""
    for part, rank in zip(("median", "p90", "rms"), ranks, strict=False):
        is_first = part == "median"

        def cell(row: Row, part: str = part) -> str | None:  # as a default: `part` is that of this turn
            spread = of(row)
            if spread is None:
                return None
            return number(getattr(spread, part), digits)

        # The median bears the name and the note of all of them.
        if is_first:
            yield Column(name=name, cell=cell, rank=rank, note=note)
        else:
            quantity = name.removesuffix(" °")
            yield Column(name=f"{part} of {quantity}", cell=cell, rank=rank, title=part)


_COLUMNS = (
    Column[Row](name="n", rank=0, cell=lambda row: str(row.n)),
    Column[Row](
        name="refused",
        rank=3,
        cell=lambda row: number(row.refused, 0),
        note="`refused`: of the n trials, those without a pose.",
    ),
    Column[Row](
        name="unsure",
        rank=14,
        cell=lambda row: number(row.unsure, 0),
        note="`unsure`: poses with a larger stated sigma than the localizer accepts; it requests another "
        "target then.",
    ),
    Column[Row](
        name="taken",
        rank=14,
        cell=lambda row: share(row.taken),
        note="`taken`: share of the trials whose pose the running localizer takes.",
    ),
    Column[Row](
        name="after s",
        rank=14,
        cell=lambda row: number(row.until_taken_s, 0),
        note="`after s`: shortest window whose pose is taken, median over starts; `-`: most are never.",
    ),
    *_spread("taken m", lambda row: row.taken_m, 3, (14, 14), "`taken m`: error of the taken poses."),
    Column[Row](
        name="far",
        rank=14,
        cell=lambda row: share(row.taken_above_1m),
        note="`far`: share of the taken poses that are more than 1 m off.",
    ),
    *_spread("m", lambda row: row.position_m, 3, (1, 2), "`m`: error of the poses that were stated, median."),
    *_spread(
        "all m",
        lambda row: row.every_m,
        3,
        (15, 20),
        "`all m`: error of all trials, of the refused ones with the pose that fits best.",
    ),
    Column[Row](
        name="bound",
        rank=16,
        cell=lambda row: number(row.bound_m, 3),
        note="`bound`: median error of an ideal solver of the same trials, who knows how bias, slopes and "
        "latency go together in the person, and their scatter (posterior Cramér-Rao bound of mean squares: "
        "the median is that of normal errors).",
    ),
    Column[Row](name="> 1 m", rank=12, cell=lambda row: share(row.share_above_1m)),
    Column[Row](
        name="misled",
        rank=17,
        cell=lambda row: share(row.misled),
        note="`misled`: share of poses off by more than 1 m with a stated sigma below 0.5 m.",
    ),
    Column[Row](name="2 sigma", rank=4, cell=lambda row: share(row.within_2_sigma), note=_SIGMA_NOTE),
    *_spread("yaw °", lambda row: row.yaw_deg, 1, (10, 11, 19)),
    Column[Row](
        name="2 sigma of yaw",
        title="2 sigma",
        rank=13,
        cell=lambda row: share(row.yaw_within_2_sigma),
        note=_SIGMA_NOTE,
    ),
    Column[Row](
        name="to plain",
        rank=21,
        cell=lambda row: None if row.times_plain is None else ", ".join(map(_interval, row.times_plain)),
        note="`to plain`: median and p90 of yaw as multiples of those of `re-anchored` (95 % over people).",
    ),
    *_spread("pitch °", lambda row: row.pitch_deg, 2, (6, 7, 18)),
    *_spread("angle °", lambda row: row.angle_deg, 2, (8, 9), "`angle °`: between ray and target."),
    *_spread("ms", lambda row: row.solve_ms, 2, (5, 21), "`ms`: processor time of a solve."),
)


def evaluation_console() -> Console:
    """Return a console on standard output with the width of the terminal, of COLUMNS, or `PIPE_WIDTH`."""
    columns = os.environ.get("COLUMNS", "")
    is_known = sys.stdout.isatty() or columns.isdigit()
    return Console(width=None if is_known else PIPE_WIDTH)


def print_rows(console: Console, rows: Sequence[Row], remarks: Sequence[str] = ()) -> None:
    """Print `rows`, sorted by set and condition, then the notes on their columns, and `remarks`."""
    notes: list[str] = [_SPREADS]
    left_out: list[str] = []
    needed = 0
    for name, group in groupby(rows, key=lambda row: row.set):
        set_rows = list(group)
        words = {"condition": [row.condition for row in set_rows]}
        subjects = [row.subject for row in set_rows]
        if set(subjects) != {ALL}:
            words["subject"] = subjects
        words["solver"] = [row.solver for row in set_rows]
        fitted = fitted_table(console, name, words, _COLUMNS, set_rows)
        console.print(fitted.table)
        for column in fitted.columns:
            if column.note:
                notes.append(column.note)
        left_out += [column.name for column in fitted.left_out]
        needed = max(needed, fitted.needed)

    # Tables share columns: each note and each name is printed once, in the order of the columns.
    texts = dict.fromkeys([*notes, *remarks])
    console.print(Text(" ".join(texts)))
    if left_out:
        names = ", ".join(dict.fromkeys(left_out))
        wider = f"With {needed} columns (COLUMNS={needed} in a pipe) this shows also: {names}."
        console.print(Text(f"{wider} --json FILE has all.", style="dim"))


def print_over_people(console: Console, name: str, over: Sequence[OverPeople], reference: str) -> None:
    """Print `over` as the table `name`; ratios are to the method `reference`."""
    about = (
        "geometric mean of each person's median error, with its 95 % interval; its range if any one person "
        f"is left out; ratio: to {reference}"
    )
    rows = tuple(_over_people_row(figures) for figures in over)
    print_table(console, OutputSection(name=name, about=about, rows=rows))


def _over_people_row(figures: OverPeople) -> dict[str, Any]:
    ratio = ""
    if figures.ratio is not None:
        ratio = _interval(figures.ratio)
    return {
        "condition": figures.condition,
        "solver": figures.solver,
        "people": figures.people,
        "error": _interval(figures.error, figures.unit),
        "without one": _range(figures.error_without_one),
        "ratio": ratio,
        "without one person": _range(figures.without_one),
    }


def _range(ends: tuple[float, float] | None) -> str:
    if ends is None:
        return ""
    low, high = ends
    return f"{low:.2f} to {high:.2f}"


def _interval(interval: Interval, unit: str = "") -> str:
    ends = f"({interval.low:.2f} to {interval.high:.2f})"
    return f"{interval.value:.2f} {unit} {ends}" if unit else f"{interval.value:.2f} {ends}"
