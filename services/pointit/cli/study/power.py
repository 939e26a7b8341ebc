"""`pointit study power`: how many participants find a stated effect."""

import tempfile
from pathlib import Path

import click

from pointit.commands import (
    ConfigError,
    OutputSection,
    ProgressCallback,
    interruptible,
    json_option,
    progress,
    show,
)
from pointit.study.model import read_study
from pointit.study.simulated import simulate
from pointit.study.study_folder import StudyFolder


@click.command("power")
@click.argument("file", required=False, metavar="[FILE]", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--pilot",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    metavar="FOLDER",
    help="draw participants from the data of a study instead",
)
@click.option("--factor", required=True, metavar="NAME", help="factor whose effect is sought")
@click.option(
    "--levels", type=(str, str), metavar="A B", help="levels that are compared  [default: the first two]"
)
@click.option(
    "--effect",
    metavar="SIZE",
    help="mean of B minus mean of A, in the unit of the measure, or as a share of A, such as -10%"
    "  [default: that of the pilot]",
)
@click.option("--measure", default="selection_s", help="column of trials.csv")
@click.option("--most", default=100, type=click.IntRange(4, 1000), help="maximum number of participants")
@click.option("--runs", default=2000, type=click.IntRange(100, 100_000), help="studies of each size")
@click.option("--seed", default=0, type=click.IntRange(0), help="of the draws")
@json_option
def command(
    *,
    file: Path | None,
    pilot: Path | None,
    factor: str,
    levels: tuple[str, str] | None,
    effect: str | None,
    measure: str,
    most: int,
    runs: int,
    seed: int,
    as_json: bool,
) -> None:
    """Print the number of participants that find an effect of a stated size with 80 and with 90 %.

    Simulated participants run the study FILE, as many as it names. Participants are drawn from them, or from
    --pilot, with replacement. Their differences are centred, and the effect is added. Each drawn study is
    tested at 5 %: by a paired two-sided t-test of the participants' medians, or by Welch's test if the factor
    is between participants (then numbers are of each group). Intervals are of the number of runs. They ignore
    how representative the pilot is.

    Example: pointit study power my_study.yaml --factor method --levels dwell press --effect -10%
    """
    from pointit import study_report  # noqa: PLC0415 - only what is needed is loaded
    from pointit.study_report import power  # noqa: PLC0415

    if (file is None) == (pilot is None):
        raise ConfigError("give either the FILE of a study or --pilot FOLDER")
    with interruptible(), progress() as on_progress:
        if pilot is not None:
            study = study_report.trials(pilot)
        else:
            with tempfile.TemporaryDirectory() as folder:
                _simulate(file or Path(), Path(folder), on_progress)
                study = study_report.trials(folder)
        named = levels or study.levels(factor)[:2]
        if len(named) < 2:
            raise ConfigError(f"--factor {factor}: has one level only; give a factor with two")
        people = power.spread(study, factor, named[0], named[1], measure)
        size = people.difference if effect is None else _size(effect, people.mean)
        table = power.power(
            people,
            size,
            range(4, most + 1),
            runs=runs,
            seed=seed,
            tell=lambda count: on_progress(f"{count} participants"),
        )
    about = (
        f"{people.test}, {measure}: {named[1]} - {named[0]} = {size:+.4g}, {runs} studies each, seed {seed}"
    )
    show([OutputSection(name="power", about=about, rows=tuple(table))], as_json=as_json)
    if as_json:
        return
    group = "" if people.is_within else " in each group"
    for goal in power.GOALS:
        needed, low, high = power.needed(table, goal)
        if needed is None:
            click.echo(f"{goal:.0%} of studies: not with {most} participants{group}; try --most")
        else:
            between = f"{low} to {high if high is not None else f'more than {most}'}"
            click.echo(f"{goal:.0%} of studies: {needed} participants{group} ({between})")


def _simulate(file: Path, folder: Path, on_progress: ProgressCallback) -> None:
    study = read_study(file)
    data = StudyFolder(folder, study, file.read_text(encoding="utf-8"))
    for participant in study.people:
        on_progress(f"simulated participant {participant}")
        simulate(study, data, participant, lambda _: None)


def _size(text: str, mean: float) -> float:
    number = text.removesuffix("%")
    try:
        size = float(number) * (mean / 100 if number != text else 1)
    except ValueError:
        raise ConfigError(f"--effect {text}: not a number or a share such as -10%") from None
    if not abs(size) < float("inf"):
        raise ConfigError(f"--effect {text}: not a finite number")
    return size
