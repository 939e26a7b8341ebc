"""Rows of the selection evaluation as tables: one per bench, a block per condition."""

from collections.abc import Sequence
from itertools import groupby

from rich import box
from rich.table import Table
from rich.text import Text

from pointit_lab.cli.table import evaluation_console
from pointit_lab.evaluation.selection.difference import Difference, Interval
from pointit_lab.evaluation.selection.row import SelectionMetrics, SelectionTrialRow
from pointit_lab.evaluation.selection.selection import SimulationSpeed

PEOPLE = {"pointing": "people", "mouse": "people, mouse"}

NOTES = (
    "`median`, `p90`: time, s; in belts_lab of a run, until all that should be is selected; elsewhere from "
    "when a package comes until it is selected. n: runs; elsewhere packages that should be selected. "
    "`between`: from one right selection to the next, s. `wrong`: of all toggles, those that leave a package "
    "as it should not be. `missed`: of what should be selected, what was not; on the conveyor, what did not "
    "leave at bay 1. `original`: fraction as in the paper's system (10 Hz, 4 of 5 timesteps)."
)

DIFFERENCE_NOTES = (
    "Differences over the same trials, each with a seed of its own. `errors`: wrong and missed, of what "
    "should be selected; `time`: mean. Intervals: bootstrap over trials; all of this run together hold with "
    "95 %. `so`: what they exclude; `-`: no difference was found."
)


def print_selection(
    rows: Sequence[SelectionTrialRow], differences: Sequence[Difference], speed: SimulationSpeed
) -> None:
    """Print `rows`, sorted by bench and condition, people after the methods.

    Then print the differences between methods, and the simulation speed `speed`.
    """
    screen = evaluation_console()
    for bench, of_bench in groupby(rows, key=lambda row: row.bench):
        screen.print(_table(bench, list(of_bench)))
    screen.print(Text(NOTES))
    if differences:
        screen.print(_differences(differences))
        screen.print(Text(DIFFERENCE_NOTES))
    screen.print(
        Text(
            f"Simulated: {speed.simulated_s:.0f} s, {speed.times_real:.0f} times faster than real time on "
            "one core.",
            style="dim",
        )
    )


def _table(bench: str, rows: list[SelectionTrialRow]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=bench, title_justify="left", title_style="bold", pad_edge=False)
    table.add_column("condition")
    table.add_column("method")
    for name in ("n", "median", "p90", "between", "wrong", "missed"):
        table.add_column(name, justify="right", no_wrap=True)
    for condition, group in groupby(rows, key=lambda row: row.condition):
        of_it = list(group)
        lines = [(row.method, row.figures, "") for row in of_it]
        lines += [(PEOPLE.get(name, name), human, "italic") for name, human in of_it[0].human.items()]
        for index, (name, figures, style) in enumerate(lines):
            table.add_row(
                Text(condition if index == 0 else ""),
                Text(name),
                *(Text("-", style="dim") if cell is None else Text(cell) for cell in _cells(figures)),
                style=style,
                end_section=index == len(lines) - 1,
            )
    return table


def _differences(differences: Sequence[Difference]) -> Table:
    table = Table(
        box=box.SIMPLE_HEAD, title="differences", title_justify="left", title_style="bold", pad_edge=False
    )
    for name in ("condition", "methods", "errors", "time", "so"):
        table.add_column(name)
    for each in differences:
        table.add_row(
            Text(each.condition),
            Text(f"{each.method} - {each.other}"),
            Text(_interval(each.errors, 100.0, "%")),
            Text("-" if each.time_s is None else _interval(each.time_s, 1.0, "s")),
            Text("; ".join(each.claims) or "-"),
        )
    return table


def _interval(interval: Interval, scale: float, unit: str) -> str:
    value, low, high = (scale * each for each in (interval.value, interval.low, interval.high))
    return f"{value:+.2f} [{low:+.2f}, {high:+.2f}] {unit}"


def _cells(figures: SelectionMetrics) -> tuple[str | None, ...]:
    time_s, between_s = figures.time_s, figures.between_s
    return (
        str(figures.n),
        None if time_s is None else f"{time_s.median:.1f}",
        None if time_s is None else f"{time_s.p90:.1f}",
        None if between_s is None else f"{between_s.median:.1f}",
        None if figures.wrong_rate is None else f"{100.0 * figures.wrong_rate:.1f} %",
        None if figures.missed_rate is None else f"{100.0 * figures.missed_rate:.1f} %",
    )
