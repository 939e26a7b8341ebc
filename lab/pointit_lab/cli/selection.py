"""`pointit evaluate selection`: simulated people select packages, compared with real people."""

from collections.abc import Sequence
from pathlib import Path

import click

from pointit.cli.common.output import interruptible, progress
from pointit.runtime.errors import ConfigError
from pointit_lab.cli.options import DATA, JOBS, JSON, bench_option, check_writable, write_json
from pointit_lab.evaluation.recordings.data_folder import recordings_folder
from pointit_lab.evaluation.selection.condition import Condition

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
    from pointit_lab.cli.selection_table import print_selection  # noqa: PLC0415 - wanted only here
    from pointit_lab.evaluation.selection.condition import conditions  # noqa: PLC0415 - as above
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
