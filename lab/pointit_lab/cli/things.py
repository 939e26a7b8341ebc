"""`pointit evaluate things`: simulated people point at things, and elsewhere."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit.runtime.errors import ConfigError
from pointit_lab.cli.options import JOBS, JSON, check_writable, write_json
from pointit_lab.cli.table import Column, evaluation_console, fitted_table, number, share

if TYPE_CHECKING:
    from pointit_lab.evaluation.things.things import MissKind, ReachRow, Share, ThingRow

FIRST_SEED = 2000
"""First seed for claims; constants of the method were chosen with seeds from 1000 to 1149."""
PLACES = {"strip": "a strip 0.5 m below", "nothing": "nothing"}
BATCH = 20
"""Reaches that a process does at once."""
NOTES = (
    "`right`, `wrong`, `nothing`: which thing fires within 8 s, %, with 95 % intervals (Wilson). `median`, "
    "`p90`: time from the beginning of the reach until the right one fires, s. `stated`: mean probability "
    "stated of what fires."
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
@click.option("--seed", type=click.IntRange(min=0), default=FIRST_SEED, metavar="SEED", help="first seed")
@click.option("--method", default="estimate", metavar="NAME", help="method of the selector")
@JOBS
@JSON
def things(
    *, trials: int, people: int, minutes: float, seed: int, method: str, jobs: int, json_file: Path | None
) -> None:
    """Simulate people who point at one of several things, with recorded errors.

    The selector's own core judges. People see what lights up and correct towards what they mean; without
    light they cannot. Others hold points of a strip below the things, or of nothing, and nothing should fire.

    Example: pointit evaluate things --trials 100 --people 4
    """
    from pointit.services.selector.config import SelectorConfig  # noqa: PLC0415 - all of the selector
    from pointit.services.selector.selection_methods import METHODS  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.recordings.parallel import map_in_order  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.things.things import (  # noqa: PLC0415 - as above
        MISS_KINDS,
        ROWS,
        ReachResult,
        reaches,
        row_of,
        wrong_selections,
    )

    check_writable(json_file)
    if method not in METHODS.names:
        names = ", ".join(METHODS.names)
        raise ConfigError(f"--method {method}: there is no such method; there are {names}")
    config = SelectorConfig(method=method)

    # A process computes a batch of reaches at once, or one person who points elsewhere.
    reach_batches: list[tuple[ThingRow, int, int]] = []
    end_seed = seed + trials
    for row in ROWS:
        for first in range(seed, end_seed, BATCH):
            count = min(BATCH, end_seed - first)
            reach_batches.append((row, first, count))
    bystanders: list[tuple[MissKind, int, float]] = []
    for kind in MISS_KINDS:
        for index in range(people):
            bystanders.append((kind, seed + index, minutes))

    with interruptible():
        with progress() as tell_progress:
            reach_results = map_in_order(
                partial(reaches, config),
                reach_batches,
                jobs=jobs,
                tick=lambda done, of: tell_progress(f"reaches, part {done} of {of}"),
            )
            wrong_counts = map_in_order(
                partial(wrong_selections, config),
                bystanders,
                jobs=jobs,
                tick=lambda done, of: tell_progress(f"people who point elsewhere, {done} of {of}"),
            )
        results: dict[str, list[ReachResult]] = {row.name: [] for row in ROWS}
        for (row, _, _), batch_results in zip(reach_batches, reach_results, strict=True):
            results[row.name] += batch_results
        rows = [row_of(row, results[row.name]) for row in ROWS]

        # Without people who miss there is no rate.
        per_half_hour: dict[MissKind, float] = {}
        if people:
            counts = dict.fromkeys(MISS_KINDS, 0)
            for (kind, _, _), wrong in zip(bystanders, wrong_counts, strict=True):
                counts[kind] += wrong
            per_half_hour = _rates(counts, people * minutes)
        row_objects = [asdict(row) for row in rows]
        document = {"rows": row_objects, "unintended_per_30_min": per_half_hour}
        if not write_json(document, json_file):
            _print(rows, per_half_hour)


COLUMNS: "tuple[Column[ReachRow], ...]" = (
    Column(name="n", cell=lambda row: str(row.right.of)),
    Column(name="right", cell=lambda row: _interval(row.right)),
    Column(name="wrong", cell=lambda row: _interval(row.wrong)),
    Column(name="nothing", cell=lambda row: _interval(row.nothing)),
    Column(name="median", cell=lambda row: number(row.median_s, 1)),
    Column(name="p90", cell=lambda row: number(row.p90_s, 1)),
    Column(name="stated", cell=lambda row: None if math.isnan(row.stated) else share(row.stated)),
)


def _rates(counts: "Mapping[MissKind, int]", minutes: float) -> "dict[MissKind, float]":
    """Return the unintended firings in 30 minutes, of counts in `minutes`."""
    rates: dict[MissKind, float] = {}
    for kind, wrong in counts.items():
        rates[kind] = 30.0 * wrong / minutes
    return rates


def _print(rows: "Sequence[ReachRow]", per_half_hour: "Mapping[MissKind, float]") -> None:
    screen = evaluation_console()
    words = {"things": [row.name for row in rows]}
    fitted = fitted_table(screen, "", words, COLUMNS, rows)
    screen.print(fitted.table)
    screen.print(Text(NOTES))
    for kind, rate in per_half_hour.items():
        sentence = f"Unintended firings in 30 min of pointing at {PLACES[kind]}: {rate:.1f}"
        screen.print(Text(sentence))


def _interval(share: "Share") -> str:
    low, high = share.interval
    percent = 100.0 * share.value
    low_percent = 100.0 * low
    high_percent = 100.0 * high
    return f"{percent:.1f} [{low_percent:.0f}, {high_percent:.0f}]"
