"""Errors over people as a table."""

from collections.abc import Sequence

from rich.console import Console

from pointit.cli.common.output import Section, print_table
from pointit_lab.evaluation.localization.over_people import OverPeople
from pointit_lab.evaluation.selection.difference import Interval


def print_over_people(screen: Console, name: str, over: Sequence[OverPeople], reference: str) -> None:
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
    print_table(screen, Section(name=name, about=about, rows=cells))


def _range(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.2f} to {ends[1]:.2f}"


def _interval(interval: Interval, unit: str = "") -> str:
    return f"{interval.value:.2f} {unit} ({interval.low:.2f} to {interval.high:.2f})".replace("  ", " ")
