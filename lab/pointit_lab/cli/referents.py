"""`pointit evaluate referents`: simulated people say "that" and "there" while they point."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich import box
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import interruptible, progress
from pointit_lab.cli.options import JOBS, JSON, check_writable, write_json
from pointit_lab.cli.table import evaluation_console

if TYPE_CHECKING:
    from pointit_lab.evaluation.referents.referents import ReferentRow, ReliabilityRow
    from pointit_lab.evaluation.things.things import Share

FIRST_SEED = 2000
"""First seed for claims; constants of the model were chosen with seeds from 1000 to 1099."""
BATCH = 20
"""People whom a process does at once."""
NOTES = (
    "One person for each seed; per word, %, with 95 % intervals (Wilson). `asked`: which one of two, and "
    "what was meant is among them. `nothing`: not understood, or asked about others. Rules: the thing "
    "nearest to the cursor at the word's onset, at its end, and at a press after the arm has arrived."
)


@click.command("referents")
@click.option(
    "--people", type=click.IntRange(1, 100_000), default=200, metavar="N", help="people for each scene"
)
@click.option("--seed", type=click.IntRange(min=0), default=FIRST_SEED, metavar="SEED", help="first seed")
@JOBS
@JSON
def referents(*, people: int, seed: int, jobs: int, json_file: Path | None) -> None:
    """Simulate people who speak and point, with recorded errors of aim, lags of gestures and recognisers.

    The core of service `listener` judges what each word refers to, beside simpler rules; the second table
    says how often what it states with a probability is right.

    Example: pointit evaluate referents --people 20
    """
    from pointit.services.listener.referents import MODEL  # noqa: PLC0415 - with numpy
    from pointit_lab.evaluation.recordings.parallel import map_parallel  # noqa: PLC0415 - as above
    from pointit_lab.evaluation.referents.referents import (  # noqa: PLC0415 - as above
        SCENES,
        ReferentAnswer,
        answers,
        reliability,
        rows_of,
        times_ms,
    )

    check_writable(json_file)
    pieces = [
        (scene, first, min(BATCH, seed + people - first))
        for scene in SCENES
        for first in range(seed, seed + people, BATCH)
    ]
    found: dict[str, list[ReferentAnswer]] = {scene.name: [] for scene in SCENES}
    with interruptible():
        with progress(len(pieces)) as tell_progress:
            for done, (index, results) in enumerate(map_parallel(partial(answers, MODEL), pieces, jobs)):
                found[pieces[index][0].name] += results
                tell_progress("parts", done + 1)
        rows = [row for scene in SCENES for row in rows_of(scene, found[scene.name])]
        every = [each for scene in found.values() for each in scene]
        bins, median_ms, p99_ms = reliability(every), *times_ms(every)
        document = {
            "rows": [asdict(row) for row in rows],
            "reliability": [asdict(row) for row in bins],
            "median_ms": median_ms,
            "p99_ms": p99_ms,
        }
        if not write_json(document, json_file):
            _print(rows, bins, median_ms, p99_ms)


def _print(
    rows: "Sequence[ReferentRow]", bins: "Sequence[ReliabilityRow]", median_ms: float, p99_ms: float
) -> None:
    screen = evaluation_console()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("things", "by"):
        table.add_column(name, no_wrap=True)
    for name in ("n", "right", "asked", "wrong", "nothing"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        shares = [_share(each) for each in (row.right, row.asked, row.wrong, row.nothing)]
        table.add_row(row.scene, row.rule, str(row.right.of), *shares)
    screen.print(table)
    screen.print(Text(NOTES))
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("stated", "mean", "n", "right"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in bins:
        table.add_row(
            f"{one.low:g} to {one.high:g}", f"{one.stated:.3f}", str(one.right.of), _share(one.right)
        )
    screen.print(table)
    screen.print(
        Text(f"CPU time of one referent: median {median_ms:.1f} ms, 99th percentile {p99_ms:.1f} ms")
    )


def _share(share: "Share") -> str:
    low, high = share.interval
    return f"{100.0 * share.value:.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"
