"""`pointit evaluate honesty`: whether stated uncertainties hold, with faults injected on purpose."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import click
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit_lab.cli.command import check_sets
from pointit_lab.cli.options import DATA, JOBS, JSON, check_writable, write_json
from pointit_lab.cli.table import evaluation_console
from pointit_lab.evaluation.honesty.row import EVERY, HonestyRow
from pointit_lab.evaluation.recordings.data_folder import recordings_folder


@click.command("honesty")
@click.option("--data", help="folder with recordings of people; without it, simulated people only", **DATA)
@click.option("--set", "sets", multiple=True, metavar="NAME", help="only this set; may be repeated")
@click.option(
    "--condition",
    "names",
    multiple=True,
    metavar="NAME",
    help="only this one, named as in the table, such as 'time +0.2 s'; may be repeated",
)
@click.option("--quick", is_flag=True, help="fewer people and windows: a minute instead of several")
@click.option("--durations", is_flag=True, help="a row for each duration and number of lamps, too")
@click.option(
    "--gate", is_flag=True, help="--quick, and an error if a row is missing or worse than its limits"
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    metavar="SEED",
    help="seed of the first simulated person, incremented for each",
)
@JOBS
@JSON
def honesty(
    *,
    data: Path | None,
    sets: tuple[str, ...],
    names: tuple[str, ...],
    quick: bool,
    durations: bool,
    gate: bool,
    seed: int,
    jobs: int,
    json_file: Path | None,
) -> None:
    """Evaluate whether the uncertainty of taken poses holds, also where an assumption is broken.

    Recorded and simulated people follow a robot or point at lamps; faults of time, body, mounting and rays
    are injected. Of the poses that the localizer takes, 90 to 98 % should be within 2 sigma, and 1 % at most
    beyond that and more than 0.5 m off. Rows that miss this are named.

    Example: pointit evaluate honesty --quick --json rows.json
    """
    from pointit_lab.evaluation.honesty.honesty import drawn_again, judged_sources, sources_of  # noqa: PLC0415 - SciPy is wanted only here
    from pointit_lab.evaluation.honesty.injections import INJECTIONS  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.honesty.row import pooled_rows, rows_of  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.honesty.sources import FULL, QUICK, SETS, SIMULATED, people  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.honesty.targets import missed, regressions  # noqa: PLC0415 - as above

    check_sets(sets, SETS)
    check_sets(names, [each.name for each in INJECTIONS], "--condition")
    check_writable(json_file)
    chosen = [each for each in INJECTIONS if not names or each.name in names]
    with interruptible():
        size = QUICK if quick or gate else FULL
        recordings = None if data is None else recordings_folder(data)
        if recordings is None:
            click.echo("note: simulated people only: give --data DIR with the recordings", err=True)
        found = people(recordings, sets, size, seed)
        for note in found.notes:
            click.echo(f"note: {note}", err=True)
        sources = sources_of(found.followed, found.rooms, chosen, size.windows)
        with progress(len(sources)) as tell_progress:
            verdicts = judged_sources(sources, jobs=jobs, tick=lambda done, _: tell_progress("people", done))
        with progress() as tell_progress:
            verdicts = drawn_again(
                verdicts,
                chosen,
                size,
                seed,
                jobs=jobs,
                tick=lambda done, of: tell_progress(f"further people of rows with few poses: {done} of {of}"),
            )
        rows, pooled = rows_of(verdicts), pooled_rows(verdicts, SIMULATED)
        asked = {
            (name, each.name)
            for name in sets or (SIMULATED if recordings is None else SETS)
            for each in chosen
        }
        worse = regressions(rows, asked) if gate else []
        misses = missed(rows)
        document = {
            "rows": [row.as_json() for row in rows],
            "pooled": [row.as_json() for row in pooled],
            "missed": [
                {"set": row.set, "condition": row.condition, "figures": broken} for row, broken in misses
            ],
            "worse": worse,
        }
        if not write_json(document, json_file):
            print_honesty([*rows, *pooled], misses, durations=durations)
    if worse:
        raise click.ClickException("worse than stated: " + "; ".join(worse))


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
