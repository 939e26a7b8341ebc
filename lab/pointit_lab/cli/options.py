"""Options that the evaluations share, and their result files, checked before the work."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.output import to_json
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import replaced_file
from pointit_lab.evaluation.recordings.data_folder import VARIABLE

MAX_JOBS = 8
"""Limit of processes: more need memory and gain little speed."""

JSON = click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, allow_dash=True),
    metavar="FILE",
    help="write the rows as JSON; `-`: to standard output, instead of the table",
)

DATA: dict[str, Any] = {"type": click.Path(path_type=Path), "envvar": VARIABLE, "show_envvar": True}
"""Arguments of the option for the folder of recordings, without its help."""


def _jobs(_context: click.Context, _option: click.Parameter, jobs: int | None) -> int:
    if jobs is not None:
        return jobs
    cores = len(os.sched_getaffinity(0))
    return min(MAX_JOBS, cores)


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
        "--bench", "benches", multiple=True, type=click.Choice(benches), help="only this one; may be repeated"
    )


def check_writable(file: Path | None, option: str = "--json") -> None:
    """Check before minutes of work that `file` can be written.

    Args:
        file: None: not requested. `-`: standard output.
        option: name of the option, for the message.

    Raises:
        ConfigError: If it is a folder, or its folder is missing or not writable.
    """
    if file is None or str(file) == "-":
        return
    if file.is_dir():
        raise ConfigError(f"{option} {file}: is a folder; give a file")
    existing = file if file.exists() else file.parent
    if not os.access(existing, os.W_OK):
        raise ConfigError(f"{option} {file}: cannot be written; give a file in a folder of yours")


def write_json(document: dict[str, Any], file: Path | None) -> bool:
    """Write `document` to `file`, if given. Return True if that is standard output.

    Raises:
        ConfigError: If the file cannot be written.
    """
    if file is None:
        return False
    text = to_json(document, indent=2)
    if str(file) == "-":
        click.echo(text)
        return True
    with replaced_file(file) as part:
        part.write_text(text + "\n", encoding="utf-8")
    return False
