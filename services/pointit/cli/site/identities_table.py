"""Table of the identities of a site, with role and expiry, for people and programs."""

import datetime as dt
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.text import Text

from pointit.access.site_folder import STATE, SiteFolder
from pointit.access.site_state import Identity, SiteState
from pointit.cli.common.output import OutputSection, Row
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.credentials import SOON, Credentials, LinkFile

ENDING = ("expired", "ends soon")
STYLES = {"expired": "red", "ends soon": "yellow", "revoked": "dim"}


def rows_of(state: SiteState, names: Iterable[str], now: dt.datetime) -> list[dict[str, Any]]:
    """Return a row for each of `names`; identities with a password do not expire."""
    return [
        {"name": name, **_about(one, _end(state, one), one.state, now)}
        for name in sorted(names)
        for one in [state.identities[name]]
    ]


def _about(
    one: Identity | LinkFile, until: dt.datetime | None, state: str, now: dt.datetime
) -> dict[str, Any]:
    standing, day = _standing(state, until, now), until and until.date().isoformat()
    return {"role": one.role, "generation": one.generation, "state": standing, "until": day}


def present(state: SiteState) -> list[str]:
    """Return the names that were not removed."""
    return [name for name, one in state.identities.items() if one.state != "removed"]


def expiring(rows: Iterable[Row]) -> list[str]:
    """Return the names whose certificates have expired or expire within 30 days."""
    return [row["name"] for row in rows if row["state"] in ENDING]


def visible_rows(
    credentials: Credentials | None, folder: Path | None, now: dt.datetime
) -> list[dict[str, Any]]:
    """Return rows of the whole site if its folder is available, else one row of the own identity.

    Args:
        credentials: the own ones, if any; `own` in their row is true.
        folder: folder of the site. None: the one that contains the credentials, if any.
        now: current time, with a time zone.

    Raises:
        ConfigError: If `folder` is not a site's folder.
    """
    own = credentials.link.name if credentials is not None else ""
    state = SiteFolder(folder).state() if folder is not None else _around(credentials)
    if state is not None:
        own = own if credentials is not None and credentials.link.site == state.site else ""
        return [{**row, "own": row["name"] == own} for row in rows_of(state, present(state), now)]
    if credentials is None:
        return []
    link = credentials.link
    until = None if link.password else link.valid_until
    return [{"name": link.name, **_about(link, until, "valid", now), "own": True}]


def section(rows: Iterable[Row]) -> OutputSection:
    """Return the table of the rows of `rows_of` or `visible_rows`."""
    return OutputSection(
        name="identities",
        about="identities that may join, and the end of each",
        rows=tuple(
            {
                "name": f"{row['name']} (this one)" if row.get("own") else row["name"],
                "role": row["role"],
                "state": Text(row["state"], style=STYLES.get(row["state"], "green")),
                "until": row["until"] or "by password",
                "generation": row["generation"],
            }
            for row in rows
        ),
        roomy=frozenset({"generation"}),
    )


def _around(credentials: Credentials | None) -> SiteState | None:
    """Return the site whose folder contains the credentials, if it can be read."""
    if credentials is None:
        return None
    for folder in credentials.folder.parents[:2]:  # identities/NAME, or router
        if (folder / STATE).is_file():
            try:
                return SiteFolder(folder).state()
            except (ConfigError, OSError):
                return None  # perhaps another user's: the own row is enough
    return None


def _end(state: SiteState, one: Identity) -> dt.datetime | None:
    return None if state.password and one.role != "router" else one.valid_until


def _standing(state: str, until: dt.datetime | None, now: dt.datetime) -> str:
    if state != "valid" or until is None:
        return state
    left = until - now
    if left < dt.timedelta():
        return "expired"
    return "ends soon" if left < SOON else "valid"
