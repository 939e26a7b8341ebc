"""`pointit evaluate`: accuracy of the estimates, measured on recordings of people."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pointit.cli.common.output import interruptible, progress
from pointit.runtime.errors import ConfigError
from pointit_lab.cli.options import DATA, JOBS, JSON, check_writable, write_json
from pointit_lab.cli.table import evaluation_console, print_rows
from pointit_lab.evaluation.datasets.proximity_feedback import NAME as FEEDBACK
from pointit_lab.evaluation.pointing.drift import CHAINED, CHAINS_REMARK
from pointit_lab.evaluation.recordings.data_folder import recordings_folder
from pointit_lab.evaluation.recordings.row import ALL, Row, arranged, document

if TYPE_CHECKING:
    from pointit_lab.evaluation.localization.over_people import OverPeople

OURS = "pointit"

BASELINES_REMARK = "Baselines solve at most {trials} trials of a set and condition, evenly taken."
ACTS_REMARK = (
    "In vr_arm_pointing each trial has a random map origin and yaw origin; the true yaw is, as in the other "
    "sets, the arm's mean one."
)
UNCORRECTED_REMARK = "`raw`: not corrected."
BOUND_REMARK = "`bound`: as well as these recordings allow."


def _localization_remarks(rows: Sequence[Row], baseline_trials: int) -> list[str]:
    """Return remarks on `rows` beside the notes on their columns."""
    remarks: list[str] = []
    if any(row.solver != OURS for row in rows):
        remarks.append(BASELINES_REMARK.format(trials=baseline_trials))
    if any(row.set == "vr_arm_pointing" for row in rows):
        remarks.append(ACTS_REMARK)
    return remarks


def _pointing_remarks(rows: Sequence[Row]) -> list[str]:
    remarks = [UNCORRECTED_REMARK]
    conditions = {(row.set, row.condition) for row in rows}
    if (FEEDBACK, CHAINED) in conditions:
        remarks.append(CHAINS_REMARK)
    if any(row.solver == "bound" for row in rows):
        remarks.append(BOUND_REMARK)
    return remarks


def _options(command: Callable[..., None]) -> Callable[..., None]:
    options = (
        click.option(
            "--data", help="folder with the recordings, or the one that has it as `recordings`", **DATA
        ),
        click.option("--set", "sets", multiple=True, metavar="NAME", help="only this set; may be repeated"),
        click.option(
            "--subject", "subjects", multiple=True, metavar="S", help="only this person; may be repeated"
        ),
        JSON,
        click.option("--brief", is_flag=True, help="a table without the rows of single people"),
    )
    # As decorators, of which the last is applied first: the help lists them in this order.
    for option in reversed(options):
        command = option(command)
    return command


@click.command("localization")
@_options
@click.option(
    "--baselines/--no-baselines",
    " /--only-ours",
    default=True,
    help="also run the baselines on the same trials, which needs most of the time",
)
@click.option(
    "--recording",
    "recordings",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="FILE",
    help="score this recorded session instead of the sets; may be repeated",
)
@JOBS
def localization(
    *,
    recordings: tuple[Path, ...],
    data: Path | None,
    sets: tuple[str, ...],
    subjects: tuple[str, ...],
    json_file: Path | None,
    brief: bool,
    baselines: bool,
    jobs: int,
) -> None:
    """Evaluate poses of people: errors, stated sigma and time of our solver and of two baselines.

    People follow a moving robot with the finger for 1 to 20 s (motion_relloc, proximity_waypoints), or point
    once at each of 2 to 6 targets (vr_arm_pointing; each act is given to all solvers as a hold of equal rays,
    2 s long). With the baselines this needs minutes.

    With --recording, localizations of your own sessions are solved again and compared with a tracker's
    positions of the people, beside the poses found `live` and the pointing at `anchors`.

    Example: pointit evaluate localization --only-ours --set vr_arm_pointing --json rows.json
    """
    if recordings:
        if sets:
            raise ConfigError("--set: not of recordings; leave it out with --recording")
        _evaluate_sessions(recordings, subjects, json_file, brief=brief, baselines=baselines, jobs=jobs)
        return
    from pointit_lab.cli.table import print_over_people  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.datasets import SETS, read_trials  # noqa: PLC0415 - SciPy is wanted only here
    from pointit_lab.evaluation.localization.localization import BASELINE_TRIALS, localization_rows  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.localization.over_people import over_people  # noqa: PLC0415 - as above

    check_sets(sets, list(SETS))
    check_writable(json_file)
    with interruptible():
        reading = read_trials(recordings_folder(data), sets, subjects)
        for note in reading.notes:
            click.echo(f"note: {note}", err=True)
        total = len(reading.trials)
        with progress(total) as tell_progress:
            rows = localization_rows(
                reading.trials,
                baselines=baselines,
                jobs=jobs,
                tick=lambda done, _: tell_progress("localizations", done),
            )
        rows = arranged(rows)

        # Sets with too few people have no figures over people.
        figures_by_set: dict[str, list[OverPeople]] = {}
        for name in sets_of(rows):
            set_rows = [row for row in rows if row.set == name]
            figures = over_people(set_rows, OURS)
            if figures:
                figures_by_set[name] = figures
        over_document: dict[str, Any] = {}
        for name, figures in figures_by_set.items():
            over_document[name] = [solver.as_json() for solver in figures]
        if write_json({**document(rows), "over_people": over_document}, json_file):
            return

        screen = evaluation_console()
        remarks = _localization_remarks(rows, BASELINE_TRIALS)
        print_rows(screen, shown(rows, brief=brief), remarks)
        for name, figures in figures_by_set.items():
            print_over_people(screen, f"{name}, over people", figures, OURS)


def _evaluate_sessions(
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
    from pointit_lab.cli.table import print_over_people  # noqa: PLC0415 - SciPy is wanted only here
    from pointit_lab.evaluation.localization.localization import localization_rows  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.localization.over_people import MIN_PEOPLE, over_people  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.localization.recorded import read_sessions  # noqa: PLC0415 - as above

    check_writable(json_file)
    with interruptible():
        with progress() as tell:
            sessions = read_sessions(recordings, tell)
        for note in sessions.notes:
            click.echo(f"note: {note}", err=True)
        trials = list(sessions.trials)
        if subjects:
            trials = [trial for trial in trials if trial.subject in subjects]
        with progress(len(trials)) as tell_solved:
            solved = localization_rows(
                trials,
                baselines=baselines,
                jobs=jobs,
                tick=lambda done, _: tell_solved("localizations", done),
            )

    # Beside the poses solved again are those found live. Rows over all people stay with any --subject.
    rows: Sequence[Row] = (*solved, *sessions.rows())
    if subjects:
        rows = [row for row in rows if row.subject in (ALL, *subjects)]
    rows = arranged(rows)
    if not rows:
        raise ConfigError(f"--subject {subjects[0]}: no person of that name can be scored here")
    over = over_people(rows, OURS)
    over_document = [figures.as_json() for figures in over]
    if write_json({**document(rows), "over_people": over_document}, json_file):
        return

    screen = evaluation_console()
    remarks = ["`live`: as found in the session; `anchors`: pointing at lamps afterwards."]
    print_rows(screen, shown(rows, brief=brief), remarks)
    if over:
        print_over_people(screen, "over people", over, OURS)
    else:
        click.echo(f"No interval over people: at least {MIN_PEOPLE} have to be scored.")


@click.command("pointing")
@_options
def pointing(
    *,
    data: Path | None,
    sets: tuple[str, ...],
    subjects: tuple[str, ...],
    json_file: Path | None,
    brief: bool,
) -> None:
    """Evaluate the yaw error of a drifting IMU after some time, with anchors in between.

    People of proximity_feedback point without a cursor at known positions; those of simulated_drift are
    simulated, and their true yaw is known.

    Example: pointit evaluate pointing --data recordings --json rows.json
    """
    from pointit_lab.evaluation.pointing.drift import SETS, drift_rows  # noqa: PLC0415 - as above

    check_sets(sets, SETS)
    check_writable(json_file)
    with interruptible():
        recordings = recordings_folder(data)
        with progress() as tell_progress:
            rows = drift_rows(recordings, sets, subjects, tick=tell_progress)
        tell(rows, json_file, _pointing_remarks(rows), brief=brief)


def check_sets(sets: Sequence[str], known: Sequence[str], option: str = "--set") -> None:
    """Check that all `sets`, or other names given by `option`, are `known`.

    Raises:
        ConfigError: If one is not; lists the known ones.
    """
    for name in sets:
        if name not in known:
            noun = option.removeprefix("--")
            names = ", ".join(known)
            raise ConfigError(f"{option} {name}: there is no such {noun}; there are {names}")


def tell(rows: Sequence[Row], json_file: Path | None, remarks: Sequence[str], *, brief: bool) -> None:
    """Print `rows` as tables, and write them to `json_file` if given."""
    if not write_json(document(rows), json_file):
        print_rows(evaluation_console(), shown(rows, brief=brief), remarks)


def shown(rows: Sequence[Row], *, brief: bool) -> list[Row]:
    """Return `rows`, without those of single people if `brief`."""
    if not brief:
        return list(rows)
    return [row for row in rows if row.subject == ALL]


def sets_of(rows: Sequence[Row]) -> list[str]:
    """Return the names of the sets of `rows`, in order."""
    names = dict.fromkeys(row.set for row in rows)
    return list(names)
