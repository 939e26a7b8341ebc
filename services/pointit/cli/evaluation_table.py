"""Rows of an evaluation as tables for people: one a set, a block a condition."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pointit.cli.output import ROOMY_WIDTH
from pointit.evaluation.row import ALL, Row, Spread


@dataclass(frozen=True, kw_only=True)
class _Column:
    title: str
    cell: Callable[[Row], str | None]
    """None: does not apply."""
    roomy: bool = False
    """Only a wide terminal has room for it."""


def _number(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"


def _share(value: float | None) -> str | None:
    return None if value is None else f"{100.0 * value:.0f} %"


def _median(spread: Spread | None, digits: int) -> str | None:
    return None if spread is None else _number(spread.median, digits)


def _p90(spread: Spread | None, digits: int) -> str | None:
    return None if spread is None else _number(spread.p90, digits)


_WORDS = ("condition", "subject", "solver")

_COLUMNS = (
    _Column(title="n", cell=lambda row: str(row.n)),
    _Column(title="refused", cell=lambda row: None if row.refused is None else str(row.refused)),
    _Column(title="unsure", cell=lambda row: None if row.unsure is None else str(row.unsure)),
    _Column(title="m", cell=lambda row: _median(row.position_m, 3)),
    _Column(title="p90", cell=lambda row: _p90(row.position_m, 3)),
    _Column(title="all m", cell=lambda row: _median(row.every_m, 3)),
    _Column(title="p90", cell=lambda row: _p90(row.every_m, 3), roomy=True),
    _Column(title="linear", cell=lambda row: _number(row.bound_m, 3)),
    _Column(title="> 1 m", cell=lambda row: _share(row.share_above_1m)),
    _Column(title="misled", cell=lambda row: _share(row.misled), roomy=True),
    _Column(title="2 sigma", cell=lambda row: _share(row.within_2_sigma)),
    _Column(title="yaw °", cell=lambda row: _median(row.yaw_deg, 1)),
    _Column(title="p90", cell=lambda row: _p90(row.yaw_deg, 1), roomy=True),
    _Column(title="rms", cell=lambda row: _number(row.yaw_deg.rms, 1) if row.yaw_deg else None, roomy=True),
    _Column(title="2 sigma", cell=lambda row: _share(row.yaw_within_2_sigma), roomy=True),
    _Column(title="pitch °", cell=lambda row: _median(row.pitch_deg, 2)),
    _Column(title="p90", cell=lambda row: _p90(row.pitch_deg, 2)),
    _Column(title="rms", cell=lambda row: _number(row.pitch_deg.rms, 2) if row.pitch_deg else None),
    _Column(title="angle °", cell=lambda row: _median(row.angle_deg, 2)),
    _Column(title="p90", cell=lambda row: _p90(row.angle_deg, 2)),
    _Column(title="ms", cell=lambda row: _median(row.solve_ms, 2)),
    _Column(title="p90", cell=lambda row: _p90(row.solve_ms, 2), roomy=True),
)
"""Spreads are medians with the p90 beside them."""


def print_rows(screen: Console, rows: Sequence[Row]) -> None:
    """Print `rows`, which stand together by set and condition, leaving out columns that are empty."""
    for name, group in groupby(rows, key=lambda row: row.set):
        screen.print(_table(name, list(group), screen.width))


def _table(name: str, rows: Sequence[Row], width: int) -> Table:
    columns = [
        column
        for column in _COLUMNS
        if any(column.cell(row) is not None for row in rows) and (width >= ROOMY_WIDTH or not column.roomy)
    ]
    table = Table(box=box.SIMPLE_HEAD, title=name, title_justify="left", title_style="bold", pad_edge=False)
    for word in _WORDS:
        table.add_column(word)
    for column in columns:
        table.add_column(column.title, justify="right")
    for _, group in groupby(rows, key=lambda row: row.condition):
        block = list(group)
        for row in block:
            table.add_row(
                row.condition,
                row.subject,
                row.solver,
                *(
                    Text("-", style="dim") if text is None else text
                    for text in (c.cell(row) for c in columns)
                ),
                style="bold" if row.subject == ALL else "",
                end_section=row is block[-1],
            )
    return table
