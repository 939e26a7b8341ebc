"""`pointit evaluate`: what the estimates are worth, measured on recordings of people."""

import os
import signal
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pointit.cli.evaluation_table import print_rows
from pointit.cli.output import console, to_json
from pointit.evaluation.data_folder import VARIABLE, recordings_folder
from pointit.evaluation.row import ALL, Row, document
from pointit.runtime.errors import ConfigError

MOST_JOBS = 8
"""More processes take memory and bring little."""

ABOUT_LOCALIZATION = (
    "`m`: error of the poses that were stated; n counts refused trials too, and `all m` is the error with "
    "the best pose of these. `unsure`: poses with a larger stated sigma than the localizer takes; it asks "
    "for another target then. `2 sigma`: share of errors within twice the stated sigma. `misled`: share of "
    "poses off by more than 1 m with a stated sigma below 0.5 m. `linear`: median error of an unbiased, "
    "linear estimate from the subject's own scatter with 2 independent pointings a second; who knows more of "
    "people beforehand, or whose errors are more alike, can do better. `ms`: processor time of a solve. "
    "Baselines solve at most {trials} trials of a set and condition, evenly taken. In vr_arm_pointing each "
    "trial has a random map origin and yaw origin; the true yaw is, as in the other sets, the arm's mean one."
)


ABOUT_POINTING = (
    "Spreads are of the errors' sizes: median, p90, rms. `none`, `raw`: not corrected; `bound`: as well as "
    "these recordings allow. `2 sigma`: share of errors within twice the stated sigma."
)


def _options(command: Callable[..., None]) -> Callable[..., None]:
    for option in reversed(
        (
            click.option(
                "--data",
                type=click.Path(path_type=Path),
                envvar=VARIABLE,
                show_envvar=True,
                help="folder with the recordings, or the one that has it as `recordings`",
            ),
            click.option(
                "--set", "sets", multiple=True, metavar="NAME", help="only this set; may be repeated"
            ),
            click.option(
                "--subject", "subjects", multiple=True, metavar="S", help="only this person; may be repeated"
            ),
            click.option(
                "--json",
                "json_file",
                type=click.Path(path_type=Path, allow_dash=True),
                metavar="FILE",
                help="write the rows as JSON; `-`: to standard output, instead of the table",
            ),
            click.option("--brief", is_flag=True, help="a table without the rows of single people"),
        )
    ):
        command = option(command)
    return command


@click.group("evaluate")
def command() -> None:
    """Measure on recordings of people how good the estimates are, beside known baselines.

    The recordings are not part of PointIt; say where they are with --data or in POINTIT_DATA.

    Example: pointit evaluate localization --data recordings --set proximity_waypoints
    """


@command.command("localization")
@_options
@click.option(
    "--baselines/--no-baselines",
    " /--only-ours",
    default=True,
    show_default=True,
    help="whether the baselines solve the same trials; they take most of the time",
)
@click.option(
    "--jobs", type=click.IntRange(1, 64), metavar="N", help="processes to use  [default: one a core, up to 8]"
)
def localization(
    *,
    data: Path | None,
    sets: tuple[str, ...],
    subjects: tuple[str, ...],
    json_file: Path | None,
    brief: bool,
    baselines: bool,
    jobs: int | None,
) -> None:
    """Where people stand: errors, honesty and time of our solver and of two baselines.

    People follow a moving robot with the finger for 1 to 20 s (motion_relloc, proximity_waypoints), or point
    once at each of 2 to 6 targets (vr_arm_pointing; each act is given to all solvers as a hold of equal rays,
    2 s long); synth_two_led is simulated. With the baselines it takes minutes.

    Example: pointit evaluate localization --only-ours --set vr_arm_pointing --json rows.json
    """
    from pointit.evaluation.datasets import SETS, read_trials  # noqa: PLC0415 - SciPy is wanted only here
    from pointit.evaluation.localization import BASELINE_TRIALS, localization_rows  # noqa: PLC0415 - as above

    check_sets(sets, list(SETS))
    check_writable(json_file)
    with interruptible():
        reading = read_trials(recordings_folder(data), sets, subjects)
        for note in reading.notes:
            click.echo(f"note: {note}", err=True)
        with _progress() as progress:
            task = progress.add_task("localizations", total=len(reading.trials))
            rows = localization_rows(
                reading.trials,
                baselines=baselines,
                jobs=jobs if jobs is not None else min(MOST_JOBS, len(os.sched_getaffinity(0))),
                tick=lambda done, _: progress.update(task, completed=done),
            )
        tell(rows, json_file, ABOUT_LOCALIZATION.format(trials=BASELINE_TRIALS), brief=brief)


@command.command("pointing")
@_options
def pointing(
    *,
    data: Path | None,
    sets: tuple[str, ...],
    subjects: tuple[str, ...],
    json_file: Path | None,
    brief: bool,
) -> None:
    """What is left of people's systematic error once it is corrected, and of their IMU's drift.

    Systematic error: people point without a cursor, some of it serves as anchors, the rest is measured
    (vr_eyefinger, proximity_feedback). Drift: how far the yaw is off after some time, with anchors in
    between (proximity_feedback; simulated_drift, whose true yaw is known).

    Example: pointit evaluate pointing --data recordings --json rows.json
    """
    from pointit.evaluation.pointing import RECORDED, SETS, pointing_rows  # noqa: PLC0415 - as above

    check_sets(sets, SETS)
    check_writable(json_file)
    with interruptible():
        recordings = recordings_folder(data)
        for name in sets or RECORDED:
            if name in RECORDED and not (recordings / name).is_dir():
                click.echo(f"note: {recordings / name} is skipped: there is no such folder", err=True)
        with _progress() as progress:
            task = progress.add_task("reading", total=None)
            rows = pointing_rows(
                recordings, sets, subjects, tick=lambda what: progress.update(task, description=what)
            )
        tell(rows, json_file, ABOUT_POINTING, brief=brief)


def check_sets(sets: Sequence[str], known: Sequence[str]) -> None:
    """Refuse a set that nobody reads.

    Raises:
        ConfigError: names the sets there are.
    """
    for name in sets:
        if name not in known:
            raise ConfigError(f"--set {name}: there is no such set; there are {', '.join(known)}")


def check_writable(json_file: Path | None) -> None:
    """Refuse, before the work of minutes, a file that cannot be written.

    Raises:
        ConfigError: it is a folder, its folder is not there or not writable.
    """
    if json_file is None or str(json_file) == "-":
        return
    if json_file.is_dir():
        raise ConfigError(f"--json {json_file}: is a folder; give a file")
    there = json_file if json_file.exists() else json_file.parent
    if not os.access(there, os.W_OK):
        raise ConfigError(f"--json {json_file}: cannot be written; give a file in a folder that is yours")


def tell(rows: Sequence[Row], json_file: Path | None, about: str, *, brief: bool) -> None:
    """Print `rows` as tables and write them where asked."""
    text = to_json(document(rows), indent=2)
    if json_file is not None and str(json_file) == "-":
        click.echo(text)
        return
    screen = console()
    print_rows(screen, [row for row in rows if row.subject == ALL] if brief else rows)
    click.echo(about)
    if json_file is not None:
        try:
            json_file.write_text(text + "\n", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{json_file}: cannot be written ({error.strerror or error})") from error


@contextmanager
def interruptible() -> Generator[None]:
    """Have Ctrl-C and SIGTERM raise inside, so that processes are ended and the terminal is as it was."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before: list[Any] = [signal.signal(number, signal.default_int_handler) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _progress() -> Progress:
    screen = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=screen,
        transient=True,
        disable=not screen.is_terminal,
    )
