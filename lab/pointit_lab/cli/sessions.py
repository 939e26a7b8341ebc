"""`pointit evaluate localization --recording`: sessions of one's own, scored where the truth is known."""

from collections.abc import Sequence
from pathlib import Path

import click

from pointit.cli.common.output import interruptible, progress
from pointit.runtime.errors import ConfigError
from pointit_lab.cli.options import check_writable, write_json
from pointit_lab.cli.table import evaluation_console, print_over_people, print_rows
from pointit_lab.evaluation.localization.localization import OURS, localization_rows
from pointit_lab.evaluation.localization.over_people import MIN_PEOPLE, OverPeople, over_people
from pointit_lab.evaluation.localization.recorded import read_sessions
from pointit_lab.evaluation.recordings.row import ALL, Row, arranged, document


def evaluate_sessions(
    recordings: Sequence[Path],
    subjects: Sequence[str],
    json_file: Path | None,
    *,
    brief: bool,
    baselines: bool,
    jobs: int,
) -> None:
    """Print the errors of `recordings` by person and over people, and write them to `json_file` if given.

    Raises:
        ConfigError: If there is nothing to score, with what is missing.
    """
    check_writable(json_file)
    with interruptible():
        with progress() as tell:
            sessions = read_sessions(recordings, tell)
        for note in sessions.notes:
            click.echo(f"note: {note}", err=True)
        trials = [trial for trial in sessions.trials if not subjects or trial.subject in subjects]
        with progress(len(trials)) as tell_solved:
            solved = localization_rows(
                trials,
                baselines=baselines,
                jobs=jobs,
                tick=lambda done, _: tell_solved("localizations", done),
            )
    rows = arranged(
        row for row in (*solved, *sessions.rows()) if not subjects or row.subject in (ALL, *subjects)
    )
    if not rows:
        raise ConfigError(f"--subject {subjects[0]}: no person of that name can be scored here")
    over = over_people(rows, OURS)
    if not write_json({**document(rows), "over_people": [each.as_json() for each in over]}, json_file):
        _show([row for row in rows if row.subject == ALL] if brief else rows, over)


def _show(rows: Sequence[Row], over: Sequence[OverPeople]) -> None:
    screen = evaluation_console()
    print_rows(screen, rows, ["`live`: as found in the session; `anchors`: pointing at lamps afterwards."])
    if over:
        print_over_people(screen, "over people", over, OURS)
    else:
        click.echo(f"No interval over people: at least {MIN_PEOPLE} have to be scored.")
