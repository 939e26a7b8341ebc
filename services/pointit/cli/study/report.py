"""`pointit study report`: tables and figures of a study."""

import importlib.util
import os
from pathlib import Path

import click

from pointit.commands import ConfigError, interruptible, progress, remedy, replaced_file


@click.command("report")
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.option(
    "--to",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="folder for the report; created if it does not exist  [default: FOLDER]",
)
def command(*, folder: Path, to: Path | None) -> None:
    """Write the report of the study in FOLDER, and its trials as one table.

    report.html has medians with intervals over participants, differences, outcomes, learning, throughput,
    Fitts' law, questionnaires and a mixed model, each with the line of Python that makes it. report.ipynb
    repeats it as a notebook. all_trials.csv has the trials of all participants, also as Parquet if pyarrow is
    installed. Needs the extra `plot`: matplotlib

    Example: pointit study report my_study
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(f"reports need matplotlib, which is not installed; run {remedy('plot')}")
    from pointit import study_report  # noqa: PLC0415 - only what is needed is loaded
    from pointit.study_report import page  # noqa: PLC0415 - takes half a second and an extra

    study = study_report.trials(folder)
    target = to or folder
    try:
        target.mkdir(parents=True, exist_ok=True)
        with interruptible(), progress() as tell:
            html, notebook = page.report(study, _seen_from(target, folder), tell)
        for name, text in (("report.html", html), ("report.ipynb", notebook)):
            with replaced_file(target / name) as part:
                part.write_text(text, encoding="utf-8")
        tables = study_report.write_all_trials(folder, target)
    except OSError as error:
        raise ConfigError(f"{target}: cannot be written ({error.strerror or error})") from error
    for note in page.notes_of(study):
        click.echo(f"note: {note}", err=True)
    for path in (target / "report.html", target / "report.ipynb", *tables):
        click.echo(path)


def _seen_from(target: Path, folder: Path) -> str:
    """Return the path of `folder` from `target`, where notebooks run; absolute on another drive."""
    try:
        return os.path.relpath(folder, target)
    except ValueError:
        return str(folder.resolve())
