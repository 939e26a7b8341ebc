"""Rows of an evaluation as tables: one per set, a block per condition, as wide as the terminal."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import OutputSection, print_table
from pointit_lab.evaluation.localization.over_people import OverPeople
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row
from pointit_lab.evaluation.selection.difference import Interval

PIPE_WIDTH = 100
"""Width without a terminal, unless COLUMNS in the environment is set."""

GAP = 2
"""Space between two columns."""

EDGES = 2
"""Columns of a table's edges."""

WORDS_WIDTH = 16
"""Characters after which conditions and solvers wrap if there is little room."""

SHORT = {"pointit": "ours", "mean-angle-4dof": "4-DoF", "mean-angle-z0": "z=0"}
"""Short names of solvers for narrow screens."""

SHORTENED = "`ours`: pointit; `4-DoF`, `z=0`: the baselines mean-angle-4dof and mean-angle-z0."


@dataclass(frozen=True, kw_only=True)
class _Column:
    name: str
    """Full name, unique among the columns."""
    cell: Callable[[Row], str | None]
    """Returns the text, or None if it does not apply."""
    rank: int
    """The lowest ranks are shown if there is little room; a p90 ranks after its median."""
    title: str = ""
    """Column heading. `""`: its name."""
    note: str = ""
    """Explanation, printed below the table."""

    @property
    def head(self) -> str:
        return self.title or self.name


def _number(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"


def _share(value: float | None) -> str | None:
    return None if value is None else f"{100.0 * value:.0f} %"


def _spread(
    name: str, of: Callable[[Row], MetricSpread | None], digits: int, ranks: Sequence[int], note: str = ""
) -> Iterator[_Column]:
    """Yield the columns of median, p90 and rms, as many as there are `ranks`."""
    for part, rank in zip(("median", "p90", "rms"), ranks, strict=False):
        is_first = part == "median"

        def cell(row: Row, part: str = part) -> str | None:
            spread = of(row)
            return None if spread is None else _number(getattr(spread, part), digits)

        yield _Column(
            name=name if is_first else f"{part} of {name.removesuffix(' °')}",
            cell=cell,
            rank=rank,
            title="" if is_first else part,
            note=note if is_first else "",
        )


_SIGMA_NOTE = "`2 sigma`: share of errors within twice the stated sigma."

_COLUMNS = (
    _Column(name="n", rank=0, cell=lambda row: str(row.n)),
    _Column(
        name="refused",
        rank=3,
        cell=lambda row: _number(row.refused, 0),
        note="`refused`: of the n trials, those without a pose.",
    ),
    _Column(
        name="unsure",
        rank=14,
        cell=lambda row: _number(row.unsure, 0),
        note="`unsure`: poses with a larger stated sigma than the localizer accepts; it requests another "
        "target then.",
    ),
    _Column(
        name="taken",
        rank=14,
        cell=lambda row: _share(row.taken),
        note="`taken`: share of the trials whose pose the running localizer takes.",
    ),
    _Column(
        name="after s",
        rank=14,
        cell=lambda row: _number(row.until_taken_s, 0),
        note="`after s`: shortest window whose pose is taken, median over starts; `-`: most are never.",
    ),
    *_spread("taken m", lambda row: row.taken_m, 3, (14, 14), "`taken m`: error of the taken poses."),
    _Column(
        name="far",
        rank=14,
        cell=lambda row: _share(row.taken_above_1m),
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
    _Column(
        name="bound",
        rank=16,
        cell=lambda row: _number(row.bound_m, 3),
        note="`bound`: median error of an ideal solver of the same trials, who knows how bias, slopes and "
        "latency go together in the person, and their scatter (posterior Cramér-Rao bound of mean squares: "
        "the median is that of normal errors).",
    ),
    _Column(name="> 1 m", rank=12, cell=lambda row: _share(row.share_above_1m)),
    _Column(
        name="misled",
        rank=17,
        cell=lambda row: _share(row.misled),
        note="`misled`: share of poses off by more than 1 m with a stated sigma below 0.5 m.",
    ),
    _Column(name="2 sigma", rank=4, cell=lambda row: _share(row.within_2_sigma), note=_SIGMA_NOTE),
    *_spread("yaw °", lambda row: row.yaw_deg, 1, (10, 11, 19)),
    _Column(
        name="2 sigma of yaw",
        title="2 sigma",
        rank=13,
        cell=lambda row: _share(row.yaw_within_2_sigma),
        note=_SIGMA_NOTE,
    ),
    _Column(
        name="to plain",
        rank=21,
        cell=lambda row: None if row.times_plain is None else ", ".join(map(_interval, row.times_plain)),
        note="`to plain`: median and p90 of yaw as multiples of those of `re-anchored` (95 % over people).",
    ),
    *_spread("pitch °", lambda row: row.pitch_deg, 2, (6, 7, 18)),
    *_spread("angle °", lambda row: row.angle_deg, 2, (8, 9), "`angle °`: between ray and target."),
    *_spread("ms", lambda row: row.solve_ms, 2, (5, 21), "`ms`: processor time of a solve."),
)

_SPREADS = "Errors are sizes: the median, and beside it p90 and rms."


def evaluation_console() -> Console:
    """Return a console on standard output with the width of the terminal, of COLUMNS, or `PIPE_WIDTH`."""
    is_known = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    return Console(width=None if is_known else PIPE_WIDTH)


def print_rows(console: Console, rows: Sequence[Row], remarks: Sequence[str] = ()) -> None:
    """Print `rows`, sorted by set and condition, then the notes on their columns, and `remarks`.

    Empty columns and those that do not fit the screen are left out, so that no text is cut.
    """
    notes: list[str] = [_SPREADS]
    left_out: list[str] = []
    needed = 0
    for name, group in groupby(rows, key=lambda row: row.set):
        layout = _Layout(list(group), console.width)
        console.print(layout.table(name))
        notes += [column.note for column in layout.shown if column.note]
        notes += [SHORTENED] if layout.shortens else []
        left_out += [column.name for column in layout.left_out]
        needed = max(needed, layout.needed)
    console.print(Text(" ".join(dict.fromkeys([*notes, *remarks]))))
    if left_out:
        names = ", ".join(dict.fromkeys(left_out))
        wider = f"With {needed} columns (COLUMNS={needed} in a pipe) this shows also: {names}."
        console.print(Text(f"{wider} --json FILE has all.", style="dim"))


class _Layout:
    """Selects the columns of one set's rows that fit the screen."""

    def __init__(self, rows: Sequence[Row], width: int) -> None:
        self._rows = rows
        there = [column for column in _COLUMNS if any(column.cell(row) is not None for row in rows)]
        self._has_subjects = any(row.subject != ALL for row in rows)
        figures_width = {column.name: self._width(column) for column in there}
        all_figures = sum(figures_width.values())
        scant = self._words(WORDS_WIDTH, shortens=True)
        self.needed = scant + all_figures
        left = width - scant
        chosen: set[str] = set()
        for column in sorted(there, key=lambda column: column.rank):
            left -= figures_width[column.name]
            if left < 0:
                break
            chosen.add(column.name)
        self.shown = [column for column in there if column.name in chosen]
        self.left_out = [column for column in there if column.name not in chosen]
        shown_width = sum(figures_width[column.name] for column in self.shown)
        self.shortens, max_width = next(  # full words if they fit
            (
                (shortens, max_width)
                for shortens, max_width in ((False, None), (True, None), (False, WORDS_WIDTH))
                if self._words(max_width, shortens=shortens) + shown_width <= width
            ),
            (True, WORDS_WIDTH),
        )
        self._max_width: int | None = max_width
        self.shortens = self.shortens and any(row.solver in SHORT for row in rows)

    def table(self, name: str) -> Table:
        """Return the rows as a table."""
        table = Table(
            box=box.SIMPLE_HEAD,
            title=name,
            title_justify="left",
            title_style="bold",
            pad_edge=False,
            padding=(0, GAP - 1, 0, 0),
        )
        for title, texts in self._texts(shortens=self.shortens):
            width = max(map(len, (title, *texts)))
            table.add_column(title, width=width if self._max_width is None else min(width, self._max_width))
        for column in self.shown:
            table.add_column(column.head, justify="right", no_wrap=True, width=self._width(column) - GAP)
        words = list(zip(*(texts for _, texts in self._texts(shortens=self.shortens)), strict=True))
        following = [row.condition for row in self._rows[1:]]
        for row, own, condition in zip(self._rows, words, [*following, None], strict=True):
            figures = (column.cell(row) for column in self.shown)
            table.add_row(
                *map(Text, own),
                *(Text("-", style="dim") if text is None else Text(text) for text in figures),
                style="bold" if row.subject == ALL and self._has_subjects else "",
                end_section=condition != row.condition,
            )
        return table

    def _width(self, column: _Column) -> int:
        cells = (column.cell(row) for row in self._rows)
        return GAP + max(len(text) for text in (column.head, *(text or "-" for text in cells)))

    def _texts(self, *, shortens: bool) -> list[tuple[str, list[str]]]:
        """Return the text columns, each with its title."""
        columns = [("condition", [row.condition for row in self._rows])]
        if self._has_subjects:
            columns.append(("subject", [row.subject for row in self._rows]))
        solvers = [SHORT.get(row.solver, row.solver) if shortens else row.solver for row in self._rows]
        return [*columns, ("solver", solvers)]

    def _words(self, max_width: int | None, *, shortens: bool) -> int:
        widths = [max(map(len, (title, *texts))) for title, texts in self._texts(shortens=shortens)]
        shown = sum(width if max_width is None else min(width, max_width) for width in widths)
        return shown + GAP * len(widths) + EDGES


def print_over_people(console: Console, name: str, over: Sequence[OverPeople], reference: str) -> None:
    """Print `over` as the table `name`; ratios are to the method `reference`."""
    about = (
        "geometric mean of each person's median error, with its 95 % interval; its range if any one person "
        f"is left out; ratio: to {reference}"
    )
    cells = tuple(
        {
            "condition": each.condition,
            "solver": each.solver,
            "people": each.people,
            "error": _interval(each.error, each.unit),
            "without one": _range(each.error_without_one),
            "ratio": "" if each.ratio is None else _interval(each.ratio),
            "without one person": _range(each.without_one),
        }
        for each in over
    )
    print_table(console, OutputSection(name=name, about=about, rows=cells))


def _range(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.2f} to {ends[1]:.2f}"


def _interval(interval: Interval, unit: str = "") -> str:
    return f"{interval.value:.2f} {unit} ({interval.low:.2f} to {interval.high:.2f})".replace("  ", " ")
