"""`pointit router`: connects several machines."""

import asyncio
import contextlib
import json
import logging
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import click
from click.core import ParameterSource

from pointit.access.denied_operations import FILTER, MARKS, DeniedOperations, RecentDenials
from pointit.access.rights import BURST, MAX_CONNECTIONS, ConnectionLimits, LimitedConnection
from pointit.access.router_configuration import configuration
from pointit.access.site_folder import SiteFolder
from pointit.cli.common.panels import PanelCommand
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import DEFAULT_ENDPOINT
from pointit.runtime.router import Router, raise_file_limit, running_router
from pointit.runtime.router_log import captured_log
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.process import log_options, run_until_shutdown
from pointit.schemas.problems import DENIED, EXCESS, REVOKED

log = logging.getLogger(__name__)

TELL_S = 1.0
"""Interval at which denied operations are reported."""
HOLD_PERIOD_S = 0.1
"""Interval at which questions and declarations are compared with the limit, s."""
BESIDE = ("ca.pem", "cert.pem", "key.pem", "users.txt")
"""Files beside a router configuration of `pointit site` that it refers to."""


@click.command(
    "router", params=log_options(), cls=PanelCommand, usual=("listen", "folders", "file", "uplinks")
)
@click.option(
    "--listen",
    multiple=True,
    default=(DEFAULT_ENDPOINT,),
    help="address to listen on; tcp/0.0.0.0:7447 admits any other machine",
)
@click.option(
    "--site-folder",
    "folders",
    multiple=True,
    type=click.Path(path_type=Path),
    help="folder made by `pointit site init`: route for that site by its access rules; once per site",
)
@click.option(
    "--config",
    "file",
    type=click.Path(path_type=Path),
    help="Zenoh configuration to use, such as a site's router/router.json5",
)
@click.option(
    "--uplink",
    "uplinks",
    multiple=True,
    metavar="ADDRESS",
    help="also join another router of the same site, such as tls/building:7447; with --site-folder",
)
@click.option(
    "--most-connections",
    "max_connections",
    type=click.IntRange(1, 1000),
    default=MAX_CONNECTIONS,
    help="maximum of simultaneous connections of one identity; the newest beyond it are closed",
)
def command(
    *,
    listen: tuple[str, ...],
    folders: tuple[Path, ...],
    file: Path | None,
    uplinks: tuple[str, ...],
    max_connections: int,
    log_level: str,
) -> int:
    """Run a router, to which the processes of any number of sites connect.

    `pointit run` alone needs none. Without --site-folder or --config, anyone who reaches the address may
    join: other machines should reach it only through a trusted network.

    With them it admits only identities of the site, each with the rights of its role. Changes by `pointit
    site` take effect within a second, without a restart. Denied operations are logged and shown by `pointit
    doctor`.

    Example: pointit site init lab --host 192.168.1.5 && pointit router --site-folder lab
    """
    setup_logging(log_level)
    is_given = click.get_current_context().get_parameter_source("listen") is not ParameterSource.DEFAULT
    if sum((bool(folders), file is not None, is_given)) > 1:
        raise ConfigError(
            "--listen, --site-folder and --config exclude each other: each sets where to listen"
        )
    if uplinks and not folders:
        raise ConfigError(
            "--uplink needs --site-folder: the router authenticates with the site's certificate"
        )
    raise_file_limit()
    if folders:
        return run_until_shutdown(_guard(_of_sites(folders, uplinks), max_connections))
    if file is not None:
        return run_until_shutdown(_guard(_of_file(file), max_connections))
    return run_until_shutdown(_route(listen))


def _of_file(path: Path) -> Router:
    def make() -> str:
        try:
            return path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "it is not text"
            raise ConfigError(f"{path}: cannot be read ({reason})") from error

    return Router(make, path.parent, [path, *(path.parent / name for name in BESIDE)])


def _of_sites(folders: Sequence[Path], uplinks: tuple[str, ...]) -> Router:
    sites = [SiteFolder(folder) for folder in folders]

    def make() -> str:
        return json.dumps(configuration([site.router_site(uplinks=uplinks) for site in sites]))

    return Router(make, Path(), [file for site in sites for file in site.router_files()])


async def _guard(router: Router, max_connections: int = MAX_CONNECTIONS) -> int:
    loop = asyncio.get_running_loop()
    limits = ConnectionLimits(max_connections)

    def close_blocked() -> None:
        """Close connections of identities that are cut off, as soon as those by passwords are known."""
        if limits.held:
            held = [each for each in _connections(router, denied) if each.identity in limits.held]
            router.cut(each.address for each in held if each.can_be_cut)

    async def hold() -> None:
        """Cut off who floods, without waiting for the next report."""
        while True:
            await asyncio.sleep(HOLD_PERIOD_S)
            loads = {name: load for name, load in denied.loads().items() if load >= BURST}
            if loads:
                limits.hold(_connections(router, denied), router.roles, loads, loop.time())
                close_blocked()

    def on_identity() -> None:
        with contextlib.suppress(RuntimeError):  # the loop is gone
            loop.call_soon_threadsafe(close_blocked)

    denied = DeniedOperations(on_identity)
    router.is_held = lambda identity: identity in limits.held
    with captured_log(FILTER, denied.take, MARKS):
        await router.open()
        try:
            click.echo(f"router listens on {', '.join(router.listens)}; Ctrl-C ends it")
            async with asyncio.TaskGroup() as group:
                group.create_task(_tell(router, denied, limits), name="refused")
                group.create_task(hold(), name="floods")
                group.create_task(router.reload_on_change(), name="router")
        finally:
            await router.close()
    return 0


def _connections(router: Router, denied: DeniedOperations) -> list[LimitedConnection]:
    return [
        LimitedConnection(
            identity=name.rpartition("/")[0] or denied.identity(session), session=session, address=address
        )
        for session, name, address in router.links()
    ]


async def _tell(router: Router, denied: DeniedOperations, limits: ConnectionLimits) -> None:
    """Report denied operations in the log and to doctor, at most every `TELL_S`.

    Connections beyond the limit of an identity are closed.
    """
    loop = asyncio.get_running_loop()
    recent = RecentDenials()
    before_s = loop.time()
    logged = set[str]()
    while True:
        await asyncio.sleep(TELL_S)
        now_s = loop.time()
        sentences = denied.take_sentences(now_s - before_s, router.former)
        before_s = now_s
        connections = _connections(router, denied)
        excess, exceeding = limits.excess(connections, router.roles, denied.rates_hz, now_s)
        router.cut(each.address for each in excess)
        messages = {DENIED: sentences, REVOKED: denied.revoked, EXCESS: exceeding}
        for kind, told in messages.items():
            for sentence in told.values():
                if sentence not in logged:  # what lasts is logged once
                    log.warning("%s", sentence)
            recent.add(told, now_s, kind)
        logged = {sentence for told in messages.values() for sentence in told.values()}
        sessions = Counter(each.identity.partition("/")[0] for each in connections)
        router.report(recent.of, denied.total, sessions)


async def _route(listen: tuple[str, ...]) -> int:
    async with running_router(listen):
        click.echo(f"router listens on {', '.join(listen)}; Ctrl-C ends it")
        await asyncio.Event().wait()
    return 0
