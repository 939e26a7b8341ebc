"""`pointit evaluate things`: simulated people point at things, and elsewhere."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich import box
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit.runtime.errors import ConfigError
from pointit_lab.cli.options import JOBS, JSON, check_writable, write_json
from pointit_lab.cli.table import evaluation_console

if TYPE_CHECKING:
    from pointit_lab.evaluation.things.listening_reach import AnnounceWay
    from pointit_lab.evaluation.things.things import MissKind, ReachRow, Result, Share

FIRST_SEED = 2000
"""First seed for claims; constants of the method were chosen with seeds from 1000 to 1149."""
PLACES = {"strip": "a strip 0.5 m below", "nothing": "nothing", "among": "points among the things"}
BATCH = 20
"""Reaches that a process does at once."""
WRONG = 0.03
"""Share of wrong things for which the bound is stated."""
NOTES = (
    "`right`, `wrong`, `nothing`: which thing fires within 8 s, %, with 95 % intervals (Wilson). `median`, "
    "`p90`: time from the beginning of the reach until the right one fires, s. `stated`: mean probability "
    "stated of what fires."
)

ASSUMED = (
    "No person was recorded: how people hear, turn, step and press is assumed; false presses 0.5/min is an "
    "assumption, and most unintended firings are due to it."
)


@click.command("things")
@click.option(
    "--trials", type=click.IntRange(1, 100_000), default=400, metavar="N", help="reaches of each row"
)
@click.option(
    "--people", type=click.IntRange(0, 1000), default=20, metavar="N", help="people who point elsewhere"
)
@click.option(
    "--minutes", type=click.FloatRange(0.1, 600), default=10.0, metavar="T", help="duration of each"
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=None,
    metavar="SEED",
    help="first seed  [default: one for claims]",
)
@click.option(
    "--announce",
    type=click.Choice(["names", "names+step", "names+dwell"]),
    default=None,
    help="people hear names instead of seeing lights, and press; names+step: they also step to neighbours; "
    "names+dwell: they have no button",
)
@click.option(
    "--drift",
    type=click.FloatRange(0, 2),
    default=None,
    metavar="DEGPS",
    help="with --announce: ten selections 8 s apart while the yaw drifts, standard deviation between people, "
    "degrees/s; the last one with and without landings as anchors",
)
@click.option("--method", default="estimate", metavar="NAME", help="method of the selector")
@JOBS
@JSON
def things(
    *,
    trials: int,
    people: int,
    minutes: float,
    seed: int | None,
    announce: "AnnounceWay | None",
    drift: float | None,
    method: str,
    jobs: int,
    json_file: Path | None,
) -> None:
    """Simulate people who point at one of several things, with recorded errors.

    The selector's own core judges. People see what lights up and correct towards what they mean; without
    light they cannot. Others hold points of a strip below the things, or of nothing, and nothing should fire.

    Example: pointit evaluate things --trials 100 --people 4
    """
    from pointit.services.selector.config import SelectorConfig  # noqa: PLC0415 - all of the selector
    from pointit.services.selector.selection_methods import METHODS  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.recordings.parallel import map_parallel  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.things.ideal import max_right  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.things.things import (  # noqa: PLC0415 - as above
        MISS_KINDS,
        ROWS,
        Result,
        reaches,
        row_of,
        wrong_selections,
    )

    check_writable(json_file)
    if announce is not None:
        if method != "estimate":
            raise ConfigError(f"--announce works with method estimate, not {method}: leave --method out")
        if drift is not None:
            _drifting(announce, drift, trials, seed, jobs, json_file)
        else:
            _announced(announce, trials, (people, minutes), seed, jobs, json_file)
        return
    if drift is not None:
        raise ConfigError("--drift works with --announce only: give it, too, or leave --drift out")
    seed = FIRST_SEED if seed is None else seed
    if method not in METHODS.names:
        raise ConfigError(f"--method {method}: there is no such method; there are {', '.join(METHODS.names)}")
    config = SelectorConfig(method=method)
    pieces = [
        (row, first, min(BATCH, seed + trials - first))
        for row in ROWS
        for first in range(seed, seed + trials, BATCH)
    ]
    others: list[tuple[MissKind, int, float]] = [
        (kind, seed + index, minutes) for kind in MISS_KINDS for index in range(people)
    ]
    found: dict[str, list[Result]] = {row.name: [] for row in ROWS}
    fired: dict[MissKind, int] = dict.fromkeys(MISS_KINDS, 0)
    with interruptible():
        with progress(len(pieces) + len(others)) as tell_progress:
            for done, (index, results) in enumerate(map_parallel(partial(reaches, config), pieces, jobs)):
                found[pieces[index][0].name] += results
                tell_progress("parts", done + 1)
            for done, (index, count) in enumerate(
                map_parallel(partial(wrong_selections, config), others, jobs)
            ):
                fired[others[index][0]] += count
                tell_progress("parts", len(pieces) + done + 1)
        rows = [row_of(row, found[row.name]) for row in ROWS]
        per_half_hour = {kind: 30.0 * count / (people * minutes) for kind, count in fired.items() if people}
        bounds = {
            row.name: {wrong: max_right(row, seed, trials, wrong) for wrong in (WRONG, judged.wrong.value)}
            for row, judged in zip(ROWS, rows, strict=True)
            if not row.lit
        }
        document = {
            "rows": [asdict(row) for row in rows],
            "unintended_per_30_min": per_half_hour,
            "right_at_best": bounds,
        }
        if not write_json(document, json_file):
            _print(rows, per_half_hour, bounds)


def _announced(  # noqa: PLR0917 - the options of the command
    way: "AnnounceWay",
    trials: int,
    others: tuple[int, float],
    seed: int | None,
    jobs: int,
    json_file: Path | None,
) -> None:
    """Simulate people who hear names, and `others`, who mean nothing: their number, and minutes of each."""
    from pointit_lab.evaluation.recordings.parallel import map_parallel  # noqa: PLC0415 - all of the selector
    from pointit_lab.evaluation.things import announced  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.things.listening_reach import ListenerModel  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.things.things import row_of  # noqa: PLC0415 - as above

    first_seed = announced.FIRST_SEED if seed is None else seed
    pieces = [
        (row, first, min(BATCH, first_seed + trials - first))
        for row in announced.ANNOUNCED_ROWS
        for first in range(first_seed, first_seed + trials, BATCH)
    ]
    people, minutes = others
    waving = [(kind, first_seed + each, minutes) for kind in announced.WAVES for each in range(people)]
    results: dict[str, list[Result]] = {row.name: [] for row in announced.ANNOUNCED_ROWS}
    fired: dict[str, int] = dict.fromkeys(announced.WAVES, 0)
    with interruptible():
        with progress(len(pieces) + len(waving)) as tell_progress:
            ended = map_parallel(partial(announced.announced_reaches, way), pieces, jobs)
            for done, (index, each) in enumerate(ended):
                results[pieces[index][0].name] += each
                tell_progress("parts", done + 1)
            for done, (index, count) in enumerate(map_parallel(partial(announced.waves, way), waving, jobs)):
                fired[waving[index][0]] += count
                tell_progress("parts", len(pieces) + done + 1)
        rows = [row_of(row, results[row.name]) for row in announced.ANNOUNCED_ROWS]
        per_half_hour = {kind: 30.0 * count / (people * minutes) for kind, count in fired.items() if people}
        document = {
            "announce": way,
            "first_seed": first_seed,
            "assumptions": asdict(ListenerModel()),
            "rows": [asdict(row) for row in rows],
            "unintended_per_30_min": per_half_hour,
        }
        if not write_json(document, json_file):
            _print(rows, per_half_hour, {})
            evaluation_console().print(Text(ASSUMED))


def _drifting(  # noqa: PLR0917 - the options of the command
    way: "AnnounceWay", drift_degps: float, people: int, seed: int | None, jobs: int, json_file: Path | None
) -> None:
    """Simulate series of people who hear names while the yaw drifts, with and without landings as anchors."""
    from pointit_lab.evaluation.recordings.parallel import map_parallel  # noqa: PLC0415 - all of the localizer
    from pointit_lab.evaluation.things import drift_series  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.things.announced import FIRST_SEED as ANNOUNCED_SEED  # noqa: PLC0415 - as above

    begin = ANNOUNCED_SEED if seed is None else seed
    pieces = [(first, min(BATCH, begin + people - first)) for first in range(begin, begin + people, BATCH)]
    rows: list[drift_series.SeriesRow] = []
    with interruptible():
        with progress(2 * len(pieces)) as tell_progress:
            for learns in (False, True):
                ends: list[tuple[Result, float]] = []
                simulate = partial(drift_series.drift_series, (way, drift_degps, learns))
                for done, (_, each) in enumerate(map_parallel(simulate, pieces, jobs)):
                    ends += each
                    tell_progress("parts", learns * len(pieces) + done + 1)
                rows.append(drift_series.series_row(drift_degps, learns, ends))
        document = {"announce": way, "first_seed": begin, "series": [asdict(row) for row in rows]}
        if not write_json(document, json_file):
            _print([row.last for row in rows], {}, {})
            for row in rows:
                line = f"{row.last.name}: yaw off by {row.yaw_error_deg:.1f}° (rms) at the last selection"
                evaluation_console().print(Text(line))
            evaluation_console().print(Text(ASSUMED))


def _print(
    rows: "Sequence[ReachRow]",
    per_half_hour: Mapping[Any, float],
    bounds: Mapping[str, Mapping[float, float]],
) -> None:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("things")
    for name in ("n", "right", "wrong", "nothing", "median", "p90", "stated"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        shares = [_share(each) for each in (row.right, row.wrong, row.nothing)]
        times = [f"{row.median_s:.1f}", f"{row.p90_s:.1f}"]
        stated = "-" if math.isnan(row.stated) else f"{row.stated:.0%}"
        table.add_row(row.name, str(row.right.of), *shares, *times, stated)
    screen = evaluation_console()
    screen.print(table)
    screen.print(Text(NOTES))
    for name, at_best in bounds.items():
        best = " or ".join(f"{right:.1%} right, {wrong:.1%} wrong" for wrong, right in at_best.items())
        screen.print(Text(f"{name}: an ideal judge gets {best}"))
    for kind, rate in per_half_hour.items():
        screen.print(Text(f"Unintended firings in 30 min of pointing at {PLACES[kind]}: {rate:.1f}"))


def _share(share: "Share") -> str:
    low, high = share.interval
    return f"{100.0 * share.value:.1f} [{100.0 * low:.0f}, {100.0 * high:.0f}]"
