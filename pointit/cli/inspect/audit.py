"""`pointit audit`: selections with user, time and confidence, from the selector's journal."""

import datetime as dt
import re
import sqlite3
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.output import OutputSection, json_option, show
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import import_room
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.machine import this_machine
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import check_name
from pointit.services.selector.audit import audit
from pointit.services.selector.journal import FIELDS, FILE
from pointit.services.selector.selection_publisher import Record

DEFAULT_SITE = "lab"
MAX_RECORDS = 1_000_000_000
"""Upper limit of --last."""

AGO = re.compile(r"(\d+(?:\.\d+)?)\s*(s|min|h|d)")
UNITS_S = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


@click.command("audit")
@click.option("--site", default=DEFAULT_SITE, help="name of the site")
@click.option(
    "--user",
    default="",
    show_default=False,
    metavar="NAME",
    help="only events by this person or on their objects",
)
@click.option("--object", "object_id", default="", show_default=False, metavar="ID", help="one object only")
@click.option(
    "--since",
    default="",
    show_default=False,
    metavar="WHEN",
    help="such as 30min, 2h, 7d, 2026-03-01 or 2026-03-01T14:30",
)
@click.option("--last", type=click.IntRange(1, MAX_RECORDS), metavar="N", help="the last N events only")
@click.option("--assistants", is_flag=True, help="instead, show what assistants did by `pointit mcp`")
@json_option
def command(
    *, site: str, user: str, object_id: str, since: str, last: int | None, assistants: bool, as_json: bool
) -> None:
    """Show selections with person, object, time, confidence and outcome.

    Reads the journal of the selector that runs, or ran, on this machine, without disturbing it. A confidence
    of - means unknown. Programs use --json, with stamps in ns.

    Example: pointit audit --user anna --since 2h
    """
    check_name(site, "site")
    if assistants and (user or object_id):
        raise ConfigError("--assistants excludes --user and --object; use --json and filter its arguments")
    oldest_ns = since_ns(since, this_machine().now_ns())
    about = f"of site {site}, the latest last"

    # Calls of assistants are in a file of their own
    if assistants:
        calls = tuple(deque(_calls(site, oldest_ns), maxlen=last))
        if not as_json:
            calls = tuple(_call_row(call) for call in calls)
        show([OutputSection(name="calls", about=about, rows=calls)], as_json=as_json)
        return

    # Selections are in the journal of the selector
    path = site_folder(site, "selector") / FILE
    records = _read(path, site, user=user, object_id=object_id, since_ns=oldest_ns)
    to_row = _plain if as_json else _row
    rows = tuple(to_row(record) for record in deque(records, maxlen=last))
    if not rows and not as_json:
        click.echo(f"no matching entry is in {path}")
        return
    show([OutputSection(name="events", about=about, rows=rows)], as_json=as_json)


def _calls(site: str, since_ns: int) -> Iterator[dict[str, Any]]:
    """Yield what assistants asked of `site` since then, the oldest first."""
    module = import_room("pointit.assistants.audit_file", "mcp")
    for call in module.read_audit(site):
        if call.get("stamp_ns", 0) >= since_ns:
            yield call


def _call_row(call: dict[str, Any]) -> dict[str, Any]:
    row = {"when": _when(call["stamp_ns"])}
    for column in ("call", "caller", "role", "tool", "arguments", "outcome", "text"):
        row[column] = call.get(column, "")
    return row


def since_ns(text: str, now_ns: int) -> int:
    """Return the time in `text`, a duration ago or a date with or without time of day, as Unix ns.

    Raises:
        ConfigError: If it is not a time.
    """
    if not text:
        return 0
    duration = AGO.fullmatch(text.strip())
    try:
        if duration:
            number, unit = duration.groups()
            duration_s = float(number) * UNITS_S[unit]
            time_ns = now_ns - int(duration_s * NS_PER_S)
        else:
            time = dt.datetime.fromisoformat(text.strip())
            time_ns = int(time.timestamp() * NS_PER_S)
    except (ValueError, OverflowError, OSError) as error:
        raise ConfigError(
            f"--since {text!r}: not a time; write a duration ago (30min, 2h, 7d) or a date (2026-03-01T14:30)"
        ) from error
    return max(0, time_ns)


def _read(path: Path, site: str, *, user: str, object_id: str, since_ns: int) -> list[Record]:
    if not path.exists():
        raise ConfigError(
            f"{path}: there is none; no selector of site {site} has kept a journal on this machine, run it "
            "here or name its site with --site"
        )
    try:
        return list(audit(path, user=user, since_ns=since_ns, object_id=object_id))
    except sqlite3.Error as error:
        raise ConfigError(
            f"{path}: cannot be read ({error}); restart the selector, which moves a damaged one aside"
        ) from error


def _row(record: Record) -> dict[str, Any]:
    return {
        "when": _when(record.stamp_ns),
        "who": record.user,
        "event": record.event,
        "what": record.kind,
        "object": record.object_id,
        "by": record.cause,
        "method": record.method,
        "confidence": record.confidence,
        "whose": record.owner,
        "reason": record.reason,
    }


def _when(stamp_ns: int) -> str:
    when = dt.datetime.fromtimestamp(stamp_ns / NS_PER_S).astimezone()
    milliseconds = when.microsecond // 1000
    return f"{when:%Y-%m-%d %H:%M:%S}.{milliseconds:03d}"


def _plain(record: Record) -> dict[str, Any]:
    fields = dict(zip(FIELDS, record, strict=False))
    fields["since_ns"] = record.since_ns or None
    return fields
