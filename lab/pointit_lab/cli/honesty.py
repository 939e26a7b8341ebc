"""`pointit evaluate honesty`: whether stated uncertainties hold, with faults injected on purpose."""

from pathlib import Path

import click

from pointit.cli.common.output import interruptible, progress
from pointit_lab.cli.command import check_sets
from pointit_lab.cli.options import DATA, JOBS, JSON, check_writable, write_json
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
    from pointit_lab.cli.honesty_table import print_honesty  # noqa: PLC0415 - wanted only here
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
