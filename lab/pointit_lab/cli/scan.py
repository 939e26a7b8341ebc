"""`pointit evaluate scan`: simulated rooms are photographed, scanned and compared with the truth."""

import math
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit_lab.cli.options import JOBS, JSON, check_writable, write_json
from pointit_lab.cli.table import evaluation_console

if TYPE_CHECKING:
    from pointit_lab.evaluation.scan.score import ScanTrial

FIRST_SEED = 200
"""First seed for claims; the method was made with seeds from 0 to 49, and some from 100 to 149."""
NOTES = (
    "`refused`: rooms of which there is no scan, a sentence instead. `strips`: identified, % of all. "
    "`median`, `p95`, `max`: errors of their ends beside the other strips, mm. `wrong`: rooms with an end "
    "or lamp more than 3 cm off at a stated sigma below 1 cm. `in 3 sigma`: ends. `one more`: rooms that ask "
    "for one more view. `lamps`: identified, % of all. `lamp p95`: their errors, mm. `tilt`: error of the "
    "level, median, degrees. `scale`: error of lengths, rms, %. `CPU`: maximum, s."
)


PLACES = (2, 3, 4)
POINTING_NOTES = (
    "`one more`: lamps for which a further place is asked for. `median`, `p90`: distance to the truth, m. "
    "`sigma`: stated, of the worst direction, median, m."
)


@click.command("scan")
@click.option("--rooms", type=click.IntRange(1, 10_000), default=50, metavar="N", help="random rooms")
@click.option("--seed", type=click.IntRange(min=0), default=FIRST_SEED, metavar="SEED", help="first seed")
@click.option("--views", type=click.IntRange(3, 20), default=8, metavar="N", help="views at most")
@click.option(
    "--advised", is_flag=True, help="people go where the scan advises them to, until it is complete"
)
@click.option("--by-pointing", is_flag=True, help="people point at lamps instead, one room each")
@JOBS
@JSON
def scan(
    *, rooms: int, seed: int, views: int, advised: bool, by_pointing: bool, jobs: int, json_file: Path | None
) -> None:
    """Simulate rooms with 2 to 22 strips and up to 4 lamps, photograph and scan them.

    Strips have 30 to 144 pixels a metre, on walls, in one plane or round corners. Some rooms have mirrors,
    glossy floors or furniture in the way. Of the pixels 15 % are unseen and 10 % have wrong numbers.

    People go round, or with --advised where the scan advises them to. With --by-pointing people with errors
    of their own point at five lamps from two to four places.

    Example: pointit evaluate scan --rooms 10
    """
    from pointit_lab.evaluation.recordings.parallel import map_parallel  # noqa: PLC0415 - only when it is run
    from pointit_lab.evaluation.scan.score import trials  # noqa: PLC0415 - as above

    check_writable(json_file)
    if by_pointing:
        _print_pointing(rooms, seed, json_file)
        return
    counts = range(3, views + 1)
    found: dict[int, list[ScanTrial]] = {}
    with interruptible():
        with progress(rooms) as tell_progress:
            work = map_parallel(
                partial(trials, counts=counts, advised=advised), range(seed, seed + rooms), jobs
            )
            for done, (index, results) in enumerate(work):
                found[index] = results
                tell_progress("rooms", done + 1)
        by_views = {
            count: [found[index][number] for index in sorted(found)] for number, count in enumerate(counts)
        }
        document = {str(count): [asdict(trial) for trial in each] for count, each in by_views.items()}
        if not write_json(document, json_file):
            _print(by_views)


def _print(by_views: "dict[int, list[ScanTrial]]") -> None:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in (
        *("views", "rooms", "refused", "strips", "median", "p95", "max", "wrong", "in 3 sigma", "one more"),
        *("lamps", "lamp p95", "tilt", "scale", "CPU"),
    ):
        table.add_column(name, justify="right", no_wrap=True)
    for count, trials in by_views.items():
        table.add_row(str(count), *_cells(trials))
    screen = evaluation_console()
    screen.print(table)
    screen.print(Text(NOTES))


def _cells(trials: "list[ScanTrial]") -> list[str]:
    errors = np.array([error for trial in trials for error in trial.errors_m] or [math.nan])
    sigmas = np.array([sigma for trial in trials for sigma in trial.sigmas_m] or [math.nan])
    identified = sum(trial.identified for trial in trials) / sum(trial.strips for trial in trials)
    lamps = sum(trial.lamps for trial in trials)
    off = np.array([error for trial in trials for error in trial.lamp_errors_m] or [math.nan])
    tilts = [trial.tilt_rad for trial in trials if trial.identified > 1]
    scales = [trial.scale_error for trial in trials if trial.identified > 1]
    return [
        str(len(trials)),
        str(sum(bool(trial.refused) for trial in trials)),
        f"{identified:.0%}",
        *(f"{1000 * value:.1f}" for value in (np.median(errors), np.quantile(errors, 0.95), errors.max())),
        str(sum(trial.wrong > 0 for trial in trials)),
        f"{np.mean(errors < 3.0 * sigmas):.1%}",
        str(sum(not trial.complete for trial in trials)),
        f"{sum(len(trial.lamp_errors_m) for trial in trials) / lamps:.0%}" if lamps else "",
        f"{1000 * np.quantile(off, 0.95):.1f}",
        f"{math.degrees(float(np.median(tilts))):.2f}" if tilts else "",
        f"{100 * math.sqrt(float(np.mean(np.square(scales)))):.2f}" if scales else "",
        f"{max(trial.cpu_s for trial in trials):.1f}",
    ]


def _print_pointing(people: int, seed: int, json_file: Path | None) -> None:
    from pointit_lab.evaluation.scan.people import point_at_lamps  # noqa: PLC0415 - only when it is run

    found = {
        places: [each for person in range(seed, seed + people) for each in point_at_lamps(person, places)]
        for places in PLACES
    }
    if write_json(
        {str(places): [asdict(each) for each in all_of] for places, all_of in found.items()}, json_file
    ):
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in (
        "places",
        "lamps",
        "one more",
        "median",
        "p90",
        "sigma",
        "in 1 sigma",
        "in 2 sigma",
        "in 3 sigma",
    ):
        table.add_column(name, justify="right", no_wrap=True)
    for places, all_of in found.items():
        errors, sigmas = np.array([x.error_m for x in all_of]), np.array([x.sigma_m for x in all_of])
        table.add_row(
            *(str(places), str(len(all_of)), str(sum(x.one_more for x in all_of))),
            *(f"{value:.2f}" for value in (np.median(errors), np.quantile(errors, 0.9), np.median(sigmas))),
            *(f"{np.mean(errors < factor * sigmas):.0%}" for factor in (1, 2, 3)),
        )
    screen = evaluation_console()
    screen.print(table)
    screen.print(Text(POINTING_NOTES))
