"""`pointit map check`: errors and warnings of a map."""

import re
import threading
from collections.abc import Generator, Sequence
from contextlib import contextmanager

import click

from pointit.cli.common.completed_names import maps
from pointit.cli.common.output import json_option, print_json
from pointit.cli.maps.person_option import Point, person_option, point
from pointit.maps.checks.examine import examined
from pointit.maps.checks.finding import MapFinding
from pointit.maps.file import map_path, read_map_file

COLORS = {"error": "red", "warning": "yellow"}
MAX_PRINTED = 100
"""Maximum of printed findings; a file in millimetres or of another kind has thousands."""
OLD_LAMPS = re.compile(rb"^leds:", re.MULTILINE)
"""Section of lamps in maps of the ROS toolkit and of version 0.1."""
SLOW_S = 2.0
"""Time after which a notice says that the map is being read, s."""
LONGEST = 1000
"""Limit of one finding in characters, since it contains names from the file."""


def _points(ctx: click.Context, parameter: click.Parameter, texts: Sequence[str]) -> list[Point | None]:
    return [point(ctx, parameter, text) for text in texts]


@click.command("check")
@click.argument("name_or_path", metavar="MAP", shell_complete=maps)
@person_option
@click.option(
    "--pose",
    "poses_m",
    metavar="X,Y",
    multiple=True,
    callback=_points,
    help="position from which people point at things, m: names those that are hard to tell apart; repeatable",
)
@click.option("--strict", is_flag=True, help="exit with code 1 also for warnings")
@json_option
def command(
    *, name_or_path: str, person_m: Point | None, poses_m: Sequence[Point], strict: bool, as_json: bool
) -> None:
    """Show errors and warnings of MAP, a shipped one or the path of a file, with remedies.

    Errors make something impossible: belts that do not meet, positions off a belt, bays on belts that
    continue, loops without an exit, lamps that determine no position. Warnings are probably mistakes: strips
    beside no belt, pixels that do not fit a strip's length, belts without links. The exit code is 1 if there
    is an error.

    Example: pointit map check ./site.yaml
    """
    with map_path(name_or_path) as path, notify_if_slow(f"reading {name_or_path} …"):
        has, findings = examined(str(path), path, lambda: read_map_file(path), person_m, poses_m)
        if has and OLD_LAMPS.search(path.read_bytes()):
            click.echo(f"note: {name_or_path}: `leds` is now `lamps`; both are read", err=True)
    if as_json:
        rows = [{"severity": each.severity, "where": each.where, "text": each.text} for each in findings]
        print_json({"map": name_or_path, "has": has, "findings": rows})
    else:
        print_findings(name_or_path, has, findings)
    if any(strict or each.severity == "error" for each in findings):
        raise SystemExit(1)


@contextmanager
def notify_if_slow(text: str) -> Generator[None]:
    """Print `text` to standard error if the block takes longer than `SLOW_S`."""
    timer = threading.Timer(SLOW_S, lambda: click.echo(text, err=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def print_findings(name: str, has: str, findings: Sequence[MapFinding], *, err: bool = False) -> None:
    """Print the first `MAX_PRINTED` findings, and their number; `err`: to standard error."""
    for each in findings[:MAX_PRINTED]:
        click.echo(
            f"{click.style(each.severity, fg=COLORS[each.severity], bold=True)} "
            f"{_escape_control_characters(f'{each.where}: {each.text}')}",
            err=err,
        )
    if len(findings) > MAX_PRINTED:
        click.echo(f"... and {len(findings) - MAX_PRINTED} more: --json lists all", err=err)
    errors = sum(each.severity == "error" for each in findings)
    warnings = len(findings) - errors
    counts = [
        f"{count} {word}{'s' * (count > 1)}"
        for count, word in ((errors, "error"), (warnings, "warning"))
        if count
    ]
    click.echo(f"{name}: {', '.join(counts) or 'no findings'}{f'; {has}' if has else ''}", err=err)


def _escape_control_characters(text: str) -> str:
    """Return `text`, which contains names from the file, without terminal control characters, shortened."""
    return "".join(letter if letter.isprintable() else "?" for letter in text[:LONGEST])
