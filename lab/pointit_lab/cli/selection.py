"""`pointit evaluate selection`: simulated people select packages, compared with real people."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import click
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit.runtime.errors import ConfigError
from pointit_lab.cli.options import DATA, JOBS, JSON, bench_option, check_writable, write_json
from pointit_lab.cli.table import Column, evaluation_console, fitted_table, number, share
from pointit_lab.evaluation.recordings.data_folder import recordings_folder
from pointit_lab.evaluation.selection.condition import Condition
from pointit_lab.evaluation.selection.difference import Difference, Interval
from pointit_lab.evaluation.selection.row import SelectionMetrics, SelectionTrialRow

BENCHES = ("belts_lab", "conveyor")
METHODS = ("original", "hold", "fraction", "gauge")
"""Methods evaluated by default."""

UNSEEN_SEED = 2000
"""First seed for claims; parameters of methods and people were chosen with smaller seeds."""

PEOPLE = {"pointing": "people", "mouse": "people, mouse"}

NOTES = (
    "`median`, `p90`: time, s; in belts_lab of a run, until all that should be is selected; elsewhere from "
    "when a package comes until it is selected. n: runs; elsewhere packages that should be selected. "
    "`between`: from one right selection to the next, s. `wrong`: of all toggles, those that leave a package "
    "as it should not be. `missed`: of what should be selected, what was not; on the conveyor, what did not "
    "leave at bay 1. `original`: fraction as in the paper's system (10 Hz, 4 of 5 timesteps)."
)

COLUMNS = (
    Column[SelectionMetrics](name="n", cell=lambda figures: str(figures.n)),
    Column[SelectionMetrics](
        name="median", cell=lambda figures: number(figures.time_s.median if figures.time_s else None, 1)
    ),
    Column[SelectionMetrics](
        name="p90", cell=lambda figures: number(figures.time_s.p90 if figures.time_s else None, 1)
    ),
    Column[SelectionMetrics](
        name="between",
        cell=lambda figures: number(figures.between_s.median if figures.between_s else None, 1),
    ),
    Column[SelectionMetrics](name="wrong", cell=lambda figures: share(figures.wrong_rate, 1)),
    Column[SelectionMetrics](name="missed", cell=lambda figures: share(figures.missed_rate, 1)),
)

DIFFERENCE_NOTES = (
    "Differences over the same trials, each with a seed of its own. `errors`: wrong and missed, of what "
    "should be selected; `time`: mean. Intervals: bootstrap over trials; all of this run together hold with "
    "95 %. `so`: what they exclude; `-`: no difference was found."
)


@click.command("selection")
@bench_option(BENCHES)
@click.option(
    "--condition",
    "names",
    multiple=True,
    metavar="NAME",
    help="only this one, named as in the table, such as '0.6 m apart'; may be repeated",
)
@click.option(
    "--method",
    "methods",
    multiple=True,
    metavar="NAME[@S]",
    help="hold, fraction, gauge, or original: fraction as in the paper's system; @S: with another time on an "
    "object, s; may be repeated  [default: all four]",
)
@click.option(
    "--trials",
    type=click.IntRange(1, 100_000),
    default=25,
    metavar="N",
    help="trials of each condition and method; differences between methods need 20",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=UNSEEN_SEED,
    metavar="SEED",
    help="seed of the first trial, incremented for each; parameters were chosen with seeds below "
    f"{UNSEEN_SEED} only",
)
@JOBS
@click.option("--data", help="folder with recordings of people to compare with; optional", **DATA)
@JSON
@click.option(
    "--plot",
    "plot_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="draw the rows, as .png or .svg; needs the extra `plot`",
)
def selection(
    *,
    benches: tuple[str, ...],
    names: tuple[str, ...],
    methods: tuple[str, ...],
    trials: int,
    seed: int,
    jobs: int,
    data: Path | None,
    json_file: Path | None,
    plot_file: Path | None,
) -> None:
    """Simulate people who select packages by each method, and compare with real people.

    The services' own cores run in virtual time: the person sees only the light of the strips. Benches:
    belts_lab, packages on two strips; conveyor, the paper's demonstrator, one thing varied at a time. The
    same seed gives the same rows. A method is called better than another only if the interval of their
    difference over the same trials excludes zero.

    Example: pointit evaluate selection --bench belts_lab --method gauge --method hold@0.6 --json rows.json
    """
    from pointit_lab.evaluation.selection.condition import conditions  # noqa: PLC0415 - SciPy is wanted only here
    from pointit_lab.evaluation.selection.human import humans  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.selection.method import selector_config  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.selection.plot import check_plot, plot  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.selection.selection import document, selection_rows  # noqa: PLC0415 - SciPy, and all services' cores

    # What was mistyped is reported before anything is computed.
    chosen_methods = tuple(dict.fromkeys(methods)) or METHODS
    for name in chosen_methods:
        selector_config(name)
    chosen_conditions = _named(conditions(benches), names)
    check_writable(json_file)
    check_writable(plot_file, "--plot")
    if plot_file is not None:
        check_plot(plot_file)
    with interruptible():
        notes: list[str] = []
        recordings = None if data is None else recordings_folder(data)
        people = humans(recordings, notes)
        for note in notes:
            click.echo(f"note: {note}", err=True)
        trial_count = len(chosen_conditions) * len(chosen_methods) * trials
        with progress(trial_count) as tell_progress:
            rows, differences = selection_rows(
                chosen_conditions,
                chosen_methods,
                trials=trials,
                seed=seed,
                jobs=jobs,
                humans=people,
                tick=lambda done, _: tell_progress("trials", done),
            )

        # The plot comes beside the table or the file, which have all figures.
        if plot_file is not None:
            plot(rows, plot_file)
        if not write_json(document(rows, differences), json_file):
            print_selection(rows, differences)


def _named(conditions: Sequence[Condition], names: Sequence[str]) -> list[Condition]:
    """Return the conditions `conditions` with these names, or all without names.

    Raises:
        ConfigError: If there is none of such a name.
    """
    known = list(dict.fromkeys(condition.name for condition in conditions))
    for name in names:
        if name not in known:
            raise ConfigError(f"--condition {name!r}: no such condition; there are: {'; '.join(known)}")
    if not names:
        return list(conditions)
    return [condition for condition in conditions if condition.name in names]


def print_selection(rows: Sequence[SelectionTrialRow], differences: Sequence[Difference]) -> None:
    """Print `rows`, sorted by bench and condition, people after the methods, and `differences`."""
    screen = evaluation_console()
    for bench, group in groupby(rows, key=lambda row: row.bench):
        screen.print(_table(screen, bench, list(group)))
    screen.print(Text(NOTES))
    if differences:
        screen.print(_differences(differences))
        screen.print(Text(DIFFERENCE_NOTES))


def _table(console: Console, bench: str, rows: Sequence[SelectionTrialRow]) -> Table:
    conditions: list[str] = []
    methods: list[str] = []
    figures: list[SelectionMetrics] = []
    for condition, group in groupby(rows, key=lambda row: row.condition):
        condition_rows = list(group)
        for row in condition_rows:
            conditions.append(condition)
            methods.append(row.method)
            figures.append(row.figures)

        # All rows of a condition have the same figures of people.
        for name, human in condition_rows[0].human.items():
            conditions.append(condition)
            methods.append(PEOPLE.get(name, name))
            figures.append(human)
    words = {"condition": conditions, "method": methods}
    return fitted_table(console, bench, words, COLUMNS, figures).table


def _differences(differences: Sequence[Difference]) -> Table:
    table = Table(
        box=box.SIMPLE_HEAD, title="differences", title_justify="left", title_style="bold", pad_edge=False
    )
    for name in ("condition", "methods", "errors", "time", "so"):
        table.add_column(name)
    for difference in differences:
        methods = f"{difference.method} - {difference.other}"
        errors = _interval(difference.errors, 100.0, "%")
        time = "-"
        if difference.time_s is not None:
            time = _interval(difference.time_s, 1.0, "s")
        claims = "; ".join(difference.claims) or "-"
        # As `Text`: brackets of intervals are no markup.
        texts = (difference.condition, methods, errors, time, claims)
        table.add_row(*map(Text, texts))
    return table


def _interval(interval: Interval, scale: float, unit: str) -> str:
    value = scale * interval.value
    low = scale * interval.low
    high = scale * interval.high
    return f"{value:+.2f} [{low:+.2f}, {high:+.2f}] {unit}"
