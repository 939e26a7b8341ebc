"""`pointit evaluate honesty`: whether stated uncertainties hold, with faults injected on purpose."""

from collections.abc import Sequence
from itertools import groupby, product
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit_lab.cli.command import check_sets
from pointit_lab.cli.options import DATA, JOBS, JSON, check_writable, write_json
from pointit_lab.cli.table import Column, evaluation_console, fitted_table, number, share
from pointit_lab.evaluation.honesty.row import EVERY, HonestyRow
from pointit_lab.evaluation.recordings.data_folder import recordings_folder
from pointit_lab.evaluation.selection.difference import Interval

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

MISSED = "Missed (90 to 98 % within 2 sigma, square 0.6 to 1.6, at most 1 % wrong):"


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
    gate: bool,
    seed: int,
    jobs: int,
    json_file: Path | None,
) -> None:
    """Evaluate whether the uncertainty of accepted poses holds, also where an assumption is broken.

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

    # What was mistyped is reported before anything is computed.
    check_sets(sets, SETS)
    all_names = [injection.name for injection in INJECTIONS]
    check_sets(names, all_names, "--condition")
    check_writable(json_file)
    injections = list(INJECTIONS)
    if names:
        injections = [injection for injection in INJECTIONS if injection.name in names]
    with interruptible():
        is_quick = quick or gate
        size = QUICK if is_quick else FULL
        recordings = None if data is None else recordings_folder(data)
        if recordings is None:
            click.echo("note: simulated people only: give --data DIR with the recordings", err=True)
        subjects = people(recordings, sets, size, seed)
        for note in subjects.notes:
            click.echo(f"note: {note}", err=True)

        # Rows with few poses get further simulated people, so that their shares say something.
        sources = sources_of(subjects.followed, subjects.rooms, injections, size.windows)
        with progress(len(sources)) as tell_progress:
            verdicts = judged_sources(sources, jobs=jobs, tick=lambda done, _: tell_progress("people", done))
        with progress() as tell_progress:
            verdicts = drawn_again(
                verdicts,
                injections,
                size,
                seed,
                jobs=jobs,
                tick=lambda done, of: tell_progress(f"further people of rows with few poses: {done} of {of}"),
            )
        rows = rows_of(verdicts)
        pooled = pooled_rows(verdicts, SIMULATED)

        # A row that should be there and is missing is a regression, too.
        default_sets = SIMULATED if recordings is None else SETS
        conditions = [injection.name for injection in injections]
        expected = set(product(sets or default_sets, conditions))
        worse = regressions(rows, expected) if gate else []
        misses = missed(rows)
        missed_documents = [_missed_document(row, figures) for row, figures in misses]
        row_documents = [row.as_json() for row in rows]
        pooled_documents = [row.as_json() for row in pooled]
        document: dict[str, Any] = {
            "rows": row_documents,
            "pooled": pooled_documents,
            "missed": missed_documents,
            "worse": worse,
        }
        if not write_json(document, json_file):
            print_honesty([*rows, *pooled], misses)

    # The gate fails last: its rows are printed or written before.
    if worse:
        raise click.ClickException("worse than stated: " + "; ".join(worse))


def _missed_document(row: HonestyRow, figures: Sequence[str]) -> dict[str, Any]:
    return {"set": row.set, "condition": row.condition, "figures": figures}


COLUMNS = (
    Column[HonestyRow](name="n", cell=lambda row: str(row.n), rank=5),
    Column[HonestyRow](name="taken", cell=lambda row: share(row.taken)),
    Column[HonestyRow](name="m", cell=lambda row: number(row.error_m.median if row.error_m else None, 2)),
    Column[HonestyRow](
        name="p90", cell=lambda row: number(row.error_m.p90 if row.error_m else None, 2), rank=7
    ),
    Column[HonestyRow](name="> 1 m", cell=lambda row: share(row.far.value if row.far else None, 1)),
    Column[HonestyRow](
        name="miss",
        cell=lambda row: None if row.miss_m is None else f"{row.miss_m:.2f} ({row.miss_sigma_m:.2f})",
        rank=1,
    ),
    Column[HonestyRow](name="right", cell=lambda row: share(row.right, 1), rank=2),
    Column[HonestyRow](name="2 sigma", cell=lambda row: share(row.within_2_sigma)),
    Column[HonestyRow](
        name="2 sigma without one", title="without one", cell=lambda row: _range(row.without_one), rank=8
    ),
    Column[HonestyRow](name="yaw", cell=lambda row: share(row.yaw_within_2_sigma), rank=4),
    Column[HonestyRow](name="square", cell=lambda row: number(row.square, 2), rank=6),
    Column[HonestyRow](name="wrong", cell=lambda row: _interval(row.wrong)),
    Column[HonestyRow](
        name="can show",
        cell=lambda row: (
            None if row.provable is None else f"{100.0 * row.provable:.0f} % ({row.independent})"
        ),
        rank=3,
    ),
    Column[HonestyRow](
        name="wrong without one", title="without one", cell=lambda row: _range(row.wrong_without_one), rank=8
    ),
)


def print_honesty(rows: Sequence[HonestyRow], missed: Sequence[tuple[HonestyRow, Sequence[str]]]) -> None:
    """Print `rows` by set, then the rows that `missed` the targets.

    Args:
        rows: of all durations together, and of single ones, which are not printed.
        missed: rows, and their figures out of range.
    """
    console = evaluation_console()
    for name, group in groupby(rows, key=lambda row: row.set):
        shown = [row for row in group if row.duration == EVERY]
        words = {"condition": [row.condition for row in shown]}
        fitted = fitted_table(console, name, words, COLUMNS, shown)
        console.print(fitted.table)
    console.print(Text(NOTES))
    if missed:
        console.print(Text(MISSED, style="bold"))
    for row, figures in missed:
        reasons = ", ".join(figures)
        console.print(Text(f"  {row.set}, {row.condition}: {reasons}"))


def _range(shares: tuple[float, float] | None) -> str | None:
    if shares is None:
        return None
    low, high = shares
    low_percent = 100.0 * low
    high_percent = 100.0 * high
    return f"{low_percent:.0f}-{high_percent:.0f}"


def _interval(share: Interval | None) -> str | None:
    if share is None:
        return None
    percent = 100.0 * share.value
    low = 100.0 * share.low
    high = 100.0 * share.high
    return f"{percent:.1f} [{low:.1f}, {high:.1f}] %"
