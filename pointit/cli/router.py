"""`pointit router`: connects several machines."""

import asyncio
import json
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import click
from click.core import ParameterSource

from pointit.access.connection_limits import MAX_CONNECTIONS
from pointit.access.router_configuration import configuration
from pointit.access.router_guard import RouterGuard
from pointit.access.site_folder import SiteFolder
from pointit.cli.common.panels import PanelCommand
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import DEFAULT_ENDPOINT
from pointit.runtime.router import Router, raise_file_limit, running_router
from pointit.runtime.router_log import captured_log
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.process import log_options, run_until_shutdown
from pointit.schemas.text import system_reason

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
    help="maximum number of simultaneous connections of one identity; the newest beyond it are closed",
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

    # --listen has a default, which another option replaces
    source = click.get_current_context().get_parameter_source("listen")
    is_given = source is not ParameterSource.DEFAULT
    if sum((bool(folders), file is not None, is_given)) > 1:
        raise ConfigError(
            "--listen, --site-folder and --config exclude each other: each sets where to listen"
        )
    if uplinks and not folders:
        raise ConfigError(
            "--uplink needs --site-folder: the router authenticates with the site's certificate"
        )

    # A guard needs rules: an open router admits all
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
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read ({system_reason(error)})") from error
        except UnicodeDecodeError as error:
            raise ConfigError(f"{path}: cannot be read (it is not text)") from error

    beside = [path.parent / name for name in BESIDE]
    return Router(make, path.parent, [path, *beside])


def _of_sites(folders: Sequence[Path], uplinks: tuple[str, ...]) -> Router:
    sites = [SiteFolder(folder) for folder in folders]

    def make() -> str:
        router_sites = [site.router_site(uplinks=uplinks) for site in sites]
        return json.dumps(configuration(router_sites))

    files = chain.from_iterable(site.router_files() for site in sites)
    return Router(make, Path(), list(files))


async def _guard(router: Router, max_connections: int) -> int:
    guard = RouterGuard(router, max_connections)
    async with guard.opened(captured_log):
        click.echo(f"router listens on {', '.join(router.listens)}; Ctrl-C ends it")
        await guard.run()
    return 0


async def _route(listen: tuple[str, ...]) -> int:
    async with running_router(listen):
        click.echo(f"router listens on {', '.join(listen)}; Ctrl-C ends it")
        await asyncio.Event().wait()
    return 0
