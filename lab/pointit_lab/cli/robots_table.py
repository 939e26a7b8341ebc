"""Rows of the evaluation of robots as tables."""

from collections.abc import Sequence
from itertools import groupby

from rich import box
from rich.table import Table
from rich.text import Text

from pointit_lab.cli.table import evaluation_console, print_rows
from pointit_lab.evaluation.recordings.row import ALL, Row
from pointit_lab.evaluation.robots.choice import Reliability
from pointit_lab.evaluation.robots.flight_row import FlightQuantiles, FlightRow
from pointit_lab.evaluation.robots.identification import Rate
from pointit_lab.evaluation.selection.difference import Interval

FLIGHT_NOTES = (
    "Medians with 95 % intervals, and p90. `error`: distance from the spot, m: where the robot has landed; "
    "on a workspace, in space at the person's press. `ordered`: the same when the landing is ordered, which "
    "is all that is recorded of people; their spots are inferred from the landings, and their time by "
    "pointing includes 3.2 s of holding still, which orders it. `time`: of steering, s. `detour`: flown way, "
    "divided by the distance. `taking`: time until the person has the robot, s."
)
RATE_NOTES = (
    "Rates with 95 % intervals (Wilson). `right`: the robot pointed at is the likeliest of two. `chosen`: "
    "with the required certainty. `wrong`: the other one is chosen. `without a pose`: by motion alone, as "
    "in the published comparison, which states 88 % right (Gromov et al. 2018)."
)


CHOICE_NOTE = (
    "Half the people point at a place 0.5 to 1.5 m from a robot. `p ≥ .9`: robots meant of those stated so "
    "at the press. `right`: of the robots taken, if 20, 50 and 80 % point beside. `once`: "
    "share of the robots meant that the first press took, or pointing on for 3 s; `taken`: with a second, "
    "if asked for. `started`: share of the people who point beside that started a robot."
)

FOLLOWING_NOTE = (
    "following: `figure`: the way that the robot chooses to localize a person, against others of the same "
    "length; the place of the person is known to 0.4 m before."
)


def print_robots(
    flights: Sequence[FlightRow],
    identified: Sequence[Rate],
    following: Sequence[Row],
    chosen: Sequence[Reliability] = (),
) -> None:
    """Print `flights` by bench, and the rates and the errors of localization over all people of each set."""
    screen = evaluation_console()
    for bench, of_bench in groupby(flights, key=lambda row: row.bench):
        screen.print(_flights(bench, list(of_bench)))
    if flights:
        screen.print(Text(FLIGHT_NOTES))
    rates = [rate for rate in identified if rate.subject == ALL]
    if rates:
        screen.print(_rates(rates))
        screen.print(Text(RATE_NOTES))
    if chosen:
        screen.print(_choices(chosen))
        screen.print(Text(CHOICE_NOTE))
    poses = [row for row in following if row.subject == ALL]
    if poses:
        print_rows(screen, poses, [FOLLOWING_NOTE])


def _table(title: str, texts: Sequence[str], numbers: Sequence[str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)
    for name in texts:
        table.add_column(name)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _flights(bench: str, rows: Sequence[FlightRow]) -> Table:
    names = ("n", "failed", "error", "p90", "ordered", "time", "p90", "detour", "taking")
    table = _table(bench, ("condition", "people"), names)
    for row in rows:
        cells = (
            str(row.n),
            str(row.failed),
            _median(row.error_m, 2),
            _p90(row.error_m, 2),
            _median(row.ordered_error_m, 2),
            _median(row.time_s, 1),
            _p90(row.time_s, 1),
            None if row.detour is None else f"{row.detour.median:.2f}",
            None if row.taking_s is None else f"{row.taking_s.median:.1f}",
        )
        table.add_row(Text(row.condition), Text(row.who), *map(_cell, cells))
    return table


def _rates(rates: Sequence[Rate]) -> Table:
    table = _table("identification", ("set", "condition", "method"), ("n", "right", "chosen", "wrong"))
    for rate in rates:
        cells = (str(rate.n), _share(rate.right), _share(rate.chosen), _share(rate.wrong))
        table.add_row(Text(rate.set), Text(rate.condition), Text(rate.method), *map(_cell, cells))
    return table


def _choices(rows: Sequence[Reliability]) -> Table:
    table = _table("choice", ("robots",), ("p ≥ .9", "right", "once", "taken", "started"))
    for row in rows:
        sure = None if row.right is None else f"{round(row.right.value * row.stated)} of {row.stated}"
        right = " ".join("-" if each is None else f"{100.0 * each:.0f}" for each in row.taken_right)
        cells = (sure, f"{right} %", f"{100.0 * row.at_once.value:.0f} %")
        table.add_row(Text(row.robots), *map(_cell, (*cells, _share(row.taken), _share(row.started))))
    return table


def _cell(text: str | None) -> Text:
    return Text("-", style="dim") if text is None else Text(text)


def _median(spread: FlightQuantiles | None, digits: int) -> str | None:
    if spread is None:
        return None
    return f"{spread.median:.{digits}f} [{spread.low:.{digits}f}, {spread.high:.{digits}f}]"


def _p90(spread: FlightQuantiles | None, digits: int) -> str | None:
    return None if spread is None else f"{spread.p90:.{digits}f}"


def _share(interval: Interval) -> str:
    value, low, high = (100.0 * each for each in (interval.value, interval.low, interval.high))
    return f"{value:.0f} [{low:.0f}, {high:.0f}] %"
