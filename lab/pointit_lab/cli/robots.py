"""`pointit evaluate robots`: simulated people steer robots, compared with recorded people."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pointit.cli.common.output import interruptible, progress
from pointit_lab.cli.options import DATA, JOBS, JSON, bench_option, check_writable, write_json
from pointit_lab.evaluation.recordings.data_folder import recordings_folder
from pointit_lab.evaluation.recordings.row import Row

if TYPE_CHECKING:  # SciPy is wanted only by the command
    from pointit_lab.evaluation.localization.trial import LocalizationTrial

IDENTIFICATION, CHOICE, FOLLOWING = "identification", "choice", "following"
BENCHES = ("landing", "workspace", IDENTIFICATION, CHOICE, FOLLOWING)


@click.command("robots")
@bench_option(BENCHES)
@click.option(
    "--people",
    type=click.IntRange(1, 10_000),
    default=24,
    metavar="N",
    help="simulated people in each condition, each with a seed of their own",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    metavar="SEED",
    help="seed of the first person, incremented for each",
)
@JOBS
@click.option("--data", help="folder with recordings of people to compare with; optional", **DATA)
@JSON
def robots(
    *, benches: tuple[str, ...], people: int, seed: int, jobs: int, data: Path | None, json_file: Path | None
) -> None:
    """Simulate people who take a quadrotor by pointing, steer it and land it, and compare with real people.

    The services' own cores run in virtual time: the person sees the robot only, and corrects. Benches:
    landing, from spot to spot as in the recordings hri_landing, which have a joystick, too; workspace, to
    places on a horizontal plane, a cylinder and a sphere about the person; identification, of one of two
    robots; choice, of one of several, by people of whom a share points beside; following, localization by a
    robot's figure. The same seed gives the same rows.

    Example: pointit evaluate robots --bench landing --people 24 --json rows.json
    """
    from pointit_lab.cli.robots_table import print_robots  # noqa: PLC0415 - wanted only here
    from pointit_lab.evaluation.datasets import hri_landing  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.robots import choice, following, identification  # noqa: PLC0415 - SciPy is wanted only here
    from pointit_lab.evaluation.robots.flight_row import recorded_rows  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.robots.flight_setup import CONDITIONS  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.robots.robots import document, flight_rows  # noqa: PLC0415 - as above

    chosen = benches or BENCHES
    check_writable(json_file)
    with interruptible():
        recordings = _present(data, hri_landing.NAME) if "landing" in chosen else None
        recorded = [] if recordings is None else recorded_rows(recordings / hri_landing.NAME)
        trials = _trials(data) if IDENTIFICATION in chosen or FOLLOWING in chosen else []
        flown = [condition for condition in CONDITIONS if condition.bench in chosen]
        with progress(len(flown) * people) as tell_progress:
            flights = flight_rows(
                flown,
                people=people,
                seed=seed,
                jobs=jobs,
                tick=lambda done, _: tell_progress("flights", done),
            )
        flights = sorted([*flights, *recorded], key=lambda row: BENCHES.index(row.bench))
        seeds = range(seed, seed + people)
        rates: list[identification.Rate] = []
        if IDENTIFICATION in chosen:
            results = identification.simulated_results(seeds)
            rates = identification.rates([*results, *identification.recorded_results(trials)])
        rows = choice.reliabilities(choice.choices(seeds)) if CHOICE in chosen else []
        found: list[Row] = []
        if FOLLOWING in chosen:
            found = [*following.simulated_rows(seeds), *following.recorded_rows(trials)]
        if not write_json(document(flights, rates, found, rows), json_file):
            print_robots(flights, rates, found, rows)


def _trials(data: Path | None) -> "list[LocalizationTrial]":
    """Return the trials of people who followed a robot, if there are recordings."""
    from pointit_lab.evaluation.datasets import motion_relloc, proximity_waypoints, read_trials  # noqa: PLC0415 - as above

    sets = (motion_relloc.NAME, proximity_waypoints.NAME)
    recordings = _present(data, *sets)
    return [] if recordings is None else read_trials(recordings, sets).trials


def _present(data: Path | None, *names: str) -> Path | None:
    """Return the folder of recordings if it has one of the sets `names`, else say what is left out.

    Raises:
        ConfigError: If the folder is given, but has no recordings.
    """
    recordings = None if data is None else recordings_folder(data)
    if recordings is not None and any((recordings / name).is_dir() for name in names):
        return recordings
    where = "give --data DIR with the recordings" if recordings is None else f"{recordings} has none"
    click.echo(f"note: no people of {' and '.join(names)} to compare with: {where}", err=True)
    return None
