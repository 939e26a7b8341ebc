"""`pointit evaluate selection`: simulated people select packages, compared with real people."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import click
from rich import box
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit.runtime.errors import ConfigError
from pointit_lab.cli.options import DATA, JOBS, JSON, bench_option, check_writable, write_json
from pointit_lab.cli.table import evaluation_console
from pointit_lab.evaluation.recordings.data_folder import recordings_folder
from pointit_lab.evaluation.selection.condition import Condition
from pointit_lab.evaluation.selection.difference import Difference, Interval
from pointit_lab.evaluation.selection.row import SelectionMetrics, SelectionTrialRow
from pointit_lab.evaluation.selection.selection import SimulationSpeed

BENCHES = ("belts_lab", "belts_vr", "conveyor")
METHODS = ("original", "hold", "fraction", "gauge")
"""Methods evaluated by default."""

UNSEEN_SEED = 2000
"""First seed for claims; parameters of methods and people were chosen with smaller seeds."""


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
    belts_lab, packages on two strips; belts_vr, fast belts; conveyor, the paper's demonstrator, one thing
    varied at a time. The same seed gives the same rows. A method is called better than another only if the
    interval of their difference over the same trials excludes zero.

    Example: pointit evaluate selection --bench belts_lab --method gauge --method hold@0.6 --json rows.json
    """
    from pointit_lab.evaluation.selection.condition import conditions  # noqa: PLC0415 - SciPy is wanted only here
    from pointit_lab.evaluation.selection.human import humans  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.selection.method import selector_config  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.selection.plot import check_plot, plot  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.selection.selection import document, selection_rows  # noqa: PLC0415 - SciPy, and all services' cores

    chosen = tuple(dict.fromkeys(methods)) or METHODS
    for name in chosen:
        selector_config(name)
    tried = _named(conditions(benches), names)
    check_writable(json_file)
    check_writable(plot_file, "--plot")
    if plot_file is not None:
        check_plot(plot_file)
    with interruptible():
        notes: list[str] = []
        people = humans(None if data is None else recordings_folder(data), notes)
        for note in notes:
            click.echo(f"note: {note}", err=True)
        with progress(len(tried) * len(chosen) * trials) as tell_progress:
            rows, differences, pace = selection_rows(
                tried,
                chosen,
                trials=trials,
                seed=seed,
                jobs=jobs,
                humans=people,
                tick=lambda done, _: tell_progress("trials", done),
            )
        if plot_file is not None:
            plot(rows, plot_file)
        if not write_json(document(rows, differences), json_file):
            print_selection(rows, differences, pace)


def _named(conditions: Sequence[Condition], names: Sequence[str]) -> list[Condition]:
    """Return the conditions `conditions` with these names, or all without names.

    Raises:
        ConfigError: If there is none of such a name.
    """
    known = list(dict.fromkeys(condition.name for condition in conditions))
    for name in names:
        if name not in known:
            raise ConfigError(f"--condition {name!r}: no such condition; there are: {'; '.join(known)}")
    return [condition for condition in conditions if not names or condition.name in names]


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
