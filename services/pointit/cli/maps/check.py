"""`pointit map check`: what is wrong with a map."""

from collections.abc import Callable, Sequence
from pathlib import Path

import click

from pointit.cli.common.option_types import Point, person_option
from pointit.cli.common.output import json_option, print_json
from pointit.maps.checks.check import check_map, contents
from pointit.maps.checks.finding import Finding, error
from pointit.maps.file import MapError, map_path, read_clouds, read_map_file, to_message
from pointit.maps.model import MapFile
from pointit.runtime.errors import ConfigError

COLORS = {"error": "red", "warning": "yellow"}
MAX_PRINTED = 100
"""Findings that are printed; a file in millimetres or of another kind has thousands."""
LONGEST = 1000
"""Characters of what is said of one place; the names in it may be anybody's."""


@click.command("check")
@click.argument("name_or_path", metavar="MAP")
@person_option
@click.option("--strict", is_flag=True, help="warnings too make the exit code 1")
@json_option
def command(*, name_or_path: str, person_m: Point | None, strict: bool, as_json: bool) -> None:
    """Say what is wrong with MAP, a shipped one or the path of a file, and what to do.

    Errors make something impossible: belts that do not meet, places off a belt, bays on belts that lead on,
    circles without a way out, lamps that tell no place. Warnings are probably mistakes: strips beside no
    belt, pixels that do not fit a strip's length, belts that nothing links. The exit code is 1 if there is
    an error.

    Example: pointit map check ./site.yaml
    """
    with map_path(name_or_path) as path:
        has, findings = examined(str(path), path, lambda: read_map_file(path), person_m)
    if as_json:
        rows = [{"severity": each.severity, "where": each.where, "text": each.text} for each in findings]
        print_json({"map": name_or_path, "has": has, "findings": rows})
    else:
        print_findings(name_or_path, has, findings)
    if any(strict or each.severity == "error" for each in findings):
        raise SystemExit(1)


def examined(
    name: str, path: Path, read: Callable[[], MapFile], person_m: Point | None = None
) -> tuple[str, list[Finding]]:
    """Return what a map has, and what is wrong with it; all that can be read is looked at.

    Args:
        name: of the map, in findings that are of no section.
        path: where it is, or is to be: its clouds lie beside it.
        read: returns it, or raises `ConfigError`.
        person_m: where the person stands; empty: anywhere.
    """
    has = ""
    try:
        file = read()
        clouds = read_clouds(path, file)
    except MapError as unreadable:
        return has, [error(where, text) for where, text in unreadable.mistakes]
    except ConfigError as unreadable:
        return has, [error(name, str(unreadable).removeprefix(f"{path}: "))]
    has = contents(file, clouds)
    findings = check_map(file, clouds, person_m=person_m)
    if not any(each.severity == "error" for each in findings):
        try:
            to_message(path, file, clouds, 0)
        except ConfigError as too_large:
            findings.append(error(name, str(too_large).removeprefix(f"{path}: ")))
    return has, findings


def print_findings(name: str, has: str, findings: Sequence[Finding], *, err: bool = False) -> None:
    """Print the first `MAX_PRINTED` findings, and how many there are; `err`: on standard error."""
    for each in findings[:MAX_PRINTED]:
        click.echo(
            f"{click.style(each.severity, fg=COLORS[each.severity], bold=True)} "
            f"{_tame(f'{each.where}: {each.text}')}",
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


def _tame(text: str) -> str:
    """Return `text` as a terminal can have it, whoever has written the names in it."""
    return "".join(letter if letter.isprintable() else "?" for letter in text[:LONGEST])
