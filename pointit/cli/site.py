"""`pointit site`: identities and rights of a site, and the check that a command has them."""

import asyncio
import datetime as dt
import shlex
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, TypeVar, cast

import click
from rich.text import Text

from pointit.access.rights import ALL, Role, rights_of, shared_services
from pointit.access.site_folder import ROUTER, STATE, Identity, SiteFolder, SiteFolderState
from pointit.cli.common.output import OutputSection, Row, json_option, print_json, show
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.launch.run.run_site import check_names
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.link.link import SOON, Credentials, Link, LinkFile, read_credentials
from pointit.runtime.link.options import given_credentials
from pointit.schemas.system import check_user
from pointit.schemas.topics import USER_ALIVE, check_name
from pointit.services.registry import add_installed

F = TypeVar("F", bound=Callable[..., Any])

ENDING = ("expired", "ends soon")
STYLES = {"expired": "red", "ends soon": "yellow", "revoked": "dim"}
DEFAULT_DAYS = 365.0
DEFAULT_PORT = 7447
DASHBOARD_HZ = 20.0
STANDING: tuple[Role, ...] = ("services", "web", "ros2", "operator", "supervisor")
"""Identities that every site has, called like their roles."""
MAX_GUESTS = 256
LOOK_S = 5.0
"""Timeout of joining the site that a folder is of, s."""

folder_option = click.option(
    "--folder",
    "--site-folder",  # name in `router` and `doctor`
    type=click.Path(path_type=Path),
    default=Path(),
    show_default=False,
    help="the site's folder  [default: this one; for init, ./NAME]",
)


def rows_of(state: SiteFolderState, names: Iterable[str], now: dt.datetime) -> list[dict[str, Any]]:
    """Return a row for each of `names`; identities with a password do not expire."""
    rows: list[dict[str, Any]] = []
    for name in sorted(names):
        identity = state.identities[name]
        columns = _columns_of(identity, _end(state, identity), identity.state, now)
        rows.append({"name": name, **columns})
    return rows


def _columns_of(
    identity: Identity | LinkFile, until: dt.datetime | None, state: str, now: dt.datetime
) -> dict[str, Any]:
    standing = _standing(state, until, now)
    day = until and until.date().isoformat()
    return {"role": identity.role, "generation": identity.generation, "state": standing, "until": day}


def present(state: SiteFolderState) -> list[str]:
    """Return the names that were not removed."""
    names: list[str] = []
    for name, identity in state.identities.items():
        if identity.state != "removed":
            names.append(name)
    return names


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
    # The folder has all identities of the site
    state = SiteFolder(folder).state() if folder is not None else _around(credentials)
    if state is not None:
        own = ""
        if credentials is not None and credentials.link.site == state.site:
            own = credentials.link.name
        rows = rows_of(state, present(state), now)
        return [{**row, "own": row["name"] == own} for row in rows]

    # Without it, a machine knows only its own identity
    if credentials is None:
        return []
    link = credentials.link
    until = None if link.password else link.valid_until
    return [{"name": link.name, **_columns_of(link, until, "valid", now), "own": True}]


def section(rows: Iterable[Row]) -> OutputSection:
    """Return the table of the rows of `rows_of` or `visible_rows`."""
    return OutputSection(
        name="identities",
        about="identities that may join, and the end of each",
        rows=tuple(map(_shown_row, rows)),
        roomy=frozenset({"generation"}),
    )


def _shown_row(row: Row) -> dict[str, Any]:
    name = row["name"]
    if row.get("own"):
        name = f"{name} (this one)"
    state = row["state"]
    return {
        "name": name,
        "role": row["role"],
        "state": Text(state, style=STYLES.get(state, "green")),
        "until": row["until"] or "by password",
        "generation": row["generation"],
    }


def _around(credentials: Credentials | None) -> SiteFolderState | None:
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


def _end(state: SiteFolderState, identity: Identity) -> dt.datetime | None:
    has_password = state.password and identity.role != "router"
    return None if has_password else identity.valid_until


def _standing(state: str, until: dt.datetime | None, now: dt.datetime) -> str:
    if state != "valid" or until is None:
        return state
    remaining = until - now
    if remaining < dt.timedelta():
        return "expired"
    return "ends soon" if remaining < SOON else "valid"


def check_person(name: str) -> None:
    """Check that the credentials are for the person `name`, or the router would reject everything.

    Raises:
        ConfigError: If the running command's credentials are another's.
    """
    credentials = given_credentials()
    if credentials is None:
        return
    link = credentials.link
    rights = rights_of(cast("Role", link.role), link.name)
    if {ALL, USER_ALIVE.at(name)}.isdisjoint(rights.announces):
        raise ConfigError(
            f"--credentials {credentials.folder}: these are of {link.name} (role {link.role}), who may not "
            f"take part as {name}; use those of {name}, made with `pointit site user add {name}`"
        )


@click.command("init", cls=PanelCommand, usual=("users", "guests", "hosts", "port", "password", "folder"))
@click.argument("name")
@folder_option
@click.option(
    "--users",
    default="",
    show_default=False,
    help="names of people, anna,ben, or their number: user1, user2, …",
)
@click.option(
    "--guests",
    default=4,
    type=click.IntRange(0, MAX_GUESTS),
    help="number of spare identities guest1, guest2, … for later use",
)
@click.option(
    "--dashboards", default=1, type=click.IntRange(0, MAX_GUESTS), help="number of view-only identities"
)
@click.option(
    "--host",
    "hosts",
    multiple=True,
    help="name or address of the router; repeatable  [default: 127.0.0.1]",
)
@click.option("--port", default=DEFAULT_PORT, type=click.IntRange(1, 65535), help="the router's port")
@click.option("--days", default=DEFAULT_DAYS, type=Finite(1, 3653), help="lifetime of certificates")
@click.option(
    "--password",
    is_flag=True,
    help="use passwords, which do not expire, instead of certificates for all but the router; "
    "less secure: copies stay valid, and unknown peers get as far as Zenoh's handshake",
)
@click.option(
    "--dashboard-rate",
    default=DASHBOARD_HZ,
    type=Finite(0, 1000),
    help="rate limit of each key for dashboards, Hz; 0: none. With a limit they connect by UDP (QUIC)",
)
@json_option
def init(
    name: str,
    *,
    folder: Path,
    users: str,
    guests: int,
    dashboards: int,
    hosts: tuple[str, ...],
    port: int,
    days: float,
    dashboard_rate: float,
    password: bool,
    as_json: bool,
) -> None:
    """Create the site NAME: its authority, its router's files, and its identities.

    Besides people, guests and dashboards there are `services` (the shared ones), `web` (the page's server),
    `operator` (may send any request to services) and `supervisor` (may do everything).

    Example: pointit site init lab --host 192.168.1.5 --users anna,ben --guests 4
    """
    check_name(name, "site")

    # Identities, of which every site has those of its services
    people = _numbered("user", _count(users)) if users.isdigit() else _names(users)
    roles: dict[str, Role] = {role: role for role in STANDING}
    for person in (*people, *_numbered("guest", guests)):
        _refuse_taken(person, roles)
        roles[person] = "user"
    for dashboard in _numbered("dashboard", dashboards):
        roles[dashboard] = "dashboard"

    path = folder if folder != Path() else Path(name)
    site = SiteFolder(path)
    state = SiteFolderState(
        site=name,
        hosts=hosts or ("127.0.0.1",),
        port=port,
        days=days,
        password=password,
        dashboard_rate_hz=dashboard_rate,
        identities={},
    )
    created = site.create(state, roles, _now())

    # What to do next, since the folder is of no use before its parts are on their machines
    if as_json:
        print_json({"site": name, "folder": str(path), "identities": sorted(created.identities)})
        return
    count = len(roles)
    click.echo(f"site {name} is in {path}: {count} identities and the router's")
    click.echo(f"1. run its router: pointit site router --site-folder {path}")
    click.echo(f"2. copy {path / 'identities'}/NAME to the machine of NAME, and there: --credentials NAME")
    click.echo(f"3. keep {path / 'authority'} secret: with it, anyone can take any identity of this site")


@click.command("add")
@click.argument("names", nargs=-1, required=True)
@folder_option
def add(names: tuple[str, ...], folder: Path) -> None:
    """Add the people NAMES. If the site is running, none may have the name of a shard that serves others.

    Example: pointit site user add carla --folder lab
    """
    site = SiteFolder(folder)
    roles: dict[str, Role] = {}
    for name in names:
        check_user(name)
        _refuse_taken(name, roles)
        roles[name] = "user"
    asyncio.run(_refuse_shards(site, names))
    site.add(roles, _now())
    for name in names:
        click.echo(f"{name} may join with the credentials in {site.identity_folder(name)}")


@click.command("add")
@click.argument("names", nargs=-1, required=True)
@folder_option
def add_service(names: tuple[str, ...], folder: Path) -> None:
    """Add identities that may do what the services NAMES need, and nothing else.

    The router must have the same packages of services installed. `pointit site revoke` removes their rights.

    Example: pointit site service add foxglove --folder lab
    """
    add_installed()
    known = sorted(row.name for row in shared_services())
    for name in names:
        if name not in known:
            raise ConfigError(f"{name} is not a shared service here; there are {', '.join(known)}")
    site = SiteFolder(folder)
    site.add(dict.fromkeys(names, "service"), _now())
    for name in names:
        click.echo(f"{name} may join with the credentials in {site.identity_folder(name)}")


@click.command("remove")
@click.argument("names", nargs=-1, required=True)
@folder_option
def remove(names: tuple[str, ...], folder: Path) -> None:
    """Remove the people NAMES and their certificates; copies elsewhere become invalid.

    Example: pointit site user remove carla --folder lab
    """
    site = SiteFolder(folder)
    for name in names:
        known = site.state().identities.get(name)
        if known is not None and known.role != "user":
            raise ConfigError(
                f"{name} is not a person but the site's {known.role}; "
                f"`pointit site revoke {name} --folder {shlex.quote(str(folder))}`"
            )
        site.remove(name)
        click.echo(f"{name} is removed")


@click.command("list")
@folder_option
@json_option
def list_people(folder: Path, *, as_json: bool) -> None:
    """List the people of a site.

    Example: pointit site user list --folder lab
    """
    state = SiteFolder(folder).state()
    people = [name for name, identity in state.identities.items() if identity.role == "user"]
    _print_identities(people, state, as_json=as_json)


@click.command("renew")
@click.argument("names", nargs=-1)
@folder_option
@click.option("--host", "hosts", multiple=True, help="one more name or address of the router")
def renew(names: tuple[str, ...], folder: Path, hosts: tuple[str, ...]) -> None:
    """Make new certificates for NAMES, or for all that expire within 30 days; copy them to their machines.

    The old ones become invalid; a revoked identity is valid again. On sites with passwords, which do not
    expire, NAMES get new ones.

    Example: pointit site renew anna --folder lab
    """
    site = SiteFolder(folder)
    now = _now()
    state = site.state()
    if not names:
        names = tuple(expiring(rows_of(state, present(state), now)))
        if hosts:
            names = tuple(dict.fromkeys((ROUTER, *names)))
    if not names:
        click.echo("every certificate is valid for 30 days or more; give names to renew them nevertheless")
        return
    site.renew(names, now, hosts)
    for name in names:
        has_password = state.password and name != ROUTER
        proof = "password" if has_password else "certificate"
        identity_folder = site.identity_folder(name)
        click.echo(f"{name} has a new {proof}: copy {identity_folder} to its machine")


@click.command("revoke")
@click.argument("name")
@folder_option
def revoke(name: str, folder: Path) -> None:
    """Revoke all rights of NAME from now on, for example if a machine was lost or a person left.

    Example: pointit site revoke guest2 --folder lab
    """
    SiteFolder(folder).revoke(name)
    command = f"pointit site renew {name} --folder {shlex.quote(str(folder))}"
    click.echo(f"{name} has no rights any more; `{command}` restores them")


@click.command("show")
@folder_option
@json_option
def list_identities(folder: Path, *, as_json: bool) -> None:
    """Show identities, roles and when certificates expire; exit code 1 if one expires within 30 days.

    Example: pointit site show --folder lab
    """
    state = SiteFolder(folder).state()
    code = _print_identities(present(state), state, as_json=as_json)
    click.get_current_context().exit(code)


def _print_identities(names: Iterable[str], state: SiteFolderState, *, as_json: bool) -> int:
    rows = rows_of(state, names, _now())
    ending = expiring(rows)
    if as_json:
        print_json({"site": state.site, "identities": rows})
    else:
        show([section(rows)], as_json=False)
        if ending:
            click.echo(f"Warning: {', '.join(ending)}: renew with `pointit site renew`", err=True)
    return 1 if ending else 0


def _refuse_taken(name: str, roles: dict[str, Role]) -> None:
    if name in {*STANDING, ROUTER} or name.startswith("dashboard"):
        raise ConfigError(f"{name} is a reserved name of the site; choose another for a person")
    if name in roles:
        raise ConfigError(f"{name} is named twice; name each person once, guest1, guest2, … are the guests")


async def _refuse_shards(site: SiteFolder, names: Collection[str]) -> None:
    """Refuse names of shards that run on the site now, if it runs."""
    from pointit.runtime.zenoh.zenoh_bus import ZenohBus  # noqa: PLC0415 - the other commands need no bus

    try:
        credentials = read_credentials(site.identity_folder("supervisor"), _now())
        link = Link(site=credentials.link.site, connect=credentials.link.endpoints, credentials=credentials)
        async with asyncio.timeout(LOOK_S):
            bus = await ZenohBus.open(link, patience_s=0.0)
    except (ConfigError, ConnectError, TimeoutError):
        return  # it does not run, or cannot be joined from here
    try:
        await check_names(bus, names)
    finally:
        await bus.close()


def _count(text: str) -> int:
    count = int(text)
    if count > MAX_GUESTS:
        raise ConfigError(f"--users {count}: at most {MAX_GUESTS} can be made at once")
    return count


def _numbered(word: str, count: int) -> list[str]:
    return [f"{word}{number}" for number in range(1, count + 1)]


def _names(text: str) -> list[str]:
    names = (part.strip() for part in text.split(","))
    return [check_user(name) for name in filter(None, names)]


def _now() -> dt.datetime:
    return dt.datetime.now(dt.UTC)
