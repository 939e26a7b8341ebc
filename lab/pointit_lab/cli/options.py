"""Options that the evaluations share."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from pointit_lab.evaluation.recordings.data_folder import VARIABLE

MAX_JOBS = 8
"""Limit of processes: more need memory and gain little speed."""


def _jobs(_context: click.Context, _option: click.Parameter, jobs: int | None) -> int:
    return jobs if jobs is not None else min(MAX_JOBS, len(os.sched_getaffinity(0)))


JOBS = click.option(
    "--jobs",
    type=click.IntRange(1, 64),
    metavar="N",
    callback=_jobs,
    help="processes to use  [default: one a core, up to 8]",
)


def bench_option(benches: Sequence[str]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the option `--bench` (`benches`), which chooses among all of them."""
    return click.option(
        "--bench",
        "benches",
        multiple=True,
        type=click.Choice(benches),
        help="only this one; may be repeated",
    )


JSON = click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, allow_dash=True),
    metavar="FILE",
    help="write the rows as JSON; `-`: to standard output, instead of the table",
)

DATA: dict[str, Any] = {"type": click.Path(path_type=Path), "envvar": VARIABLE, "show_envvar": True}
"""Arguments of the option for the folder of recordings, without its help."""
