"""Connection options of commands, and the credentials that they name."""

import datetime as dt
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import (
    DEFAULT_ENDPOINT,
    DEFAULT_SITE,
    VARIABLE,
    Credentials,
    Link,
    read_credentials,
)


def link_options() -> list[click.Parameter]:
    """Return the options that say how a command joins the network."""
    credentials = click.Option(
        ["--credentials"],
        type=click.Path(path_type=Path),
        envvar=VARIABLE,
        is_eager=True,  # other options take their defaults from them
        expose_value=False,
        callback=_take_credentials,
        help=f"folder of an identity that `pointit site` has made, for a secured site; or {VARIABLE}",
    )
    site = _OfCredentials(["--site"], default=DEFAULT_SITE, help="name of the site")
    connect = _OfCredentials(
        ["--connect"],
        multiple=True,
        default=(DEFAULT_ENDPOINT,),
        help="address of a `pointit run` or `pointit router`",
    )
    listen = click.Option(["--listen"], multiple=True, help="listen here instead of connecting")
    return [credentials, site, connect, listen]


class _OfCredentials(click.Option):
    """An option that credentials answer unless it is given."""

    def get_default(self, ctx: click.Context, call: bool = True) -> Any:  # noqa: FBT002 - click's own
        credentials = ctx.meta.get(VARIABLE)
        if credentials is None or not call:
            return super().get_default(ctx, call=call)
        return credentials.link.site if self.name == "site" else credentials.link.endpoints


def _take_credentials(ctx: click.Context, _parameter: click.Parameter, folder: Path | None) -> None:
    if folder is None or ctx.resilient_parsing:
        return
    now = dt.datetime.now(dt.UTC)
    credentials = read_credentials(folder, now)
    if ending := credentials.expiry_warning(now):
        click.echo(f"Warning: {ending}", err=True)
    ctx.meta[VARIABLE] = credentials
    os.environ[VARIABLE] = str(credentials.folder)  # for the processes that this one starts


def given_credentials() -> Credentials | None:
    """Return the credentials given by --credentials of the running command, or None."""
    context = click.get_current_context(silent=True)
    if context is None:
        return None
    credentials: Credentials | None = context.meta.get(VARIABLE)
    return credentials


def link_of(site: str, connect: Sequence[str], listen: Sequence[str] = ()) -> Link:
    """Return the link of the running command to `site`, with its credentials, if it has any.

    Raises:
        ConfigError: If they are of another site, or there is no router to show them to.
    """
    credentials = given_credentials()
    if credentials is not None and site != credentials.link.site:
        other_site = credentials.link.site
        raise ConfigError(
            f"--site {site}: the credentials in {credentials.folder} are of site {other_site}; "
            "leave --site out, or use that site's credentials"
        )
    if credentials is not None and listen:
        raise ConfigError(
            f"--listen {listen[0]}: credentials are shown to a router; leave --listen out, or --credentials"
        )
    return Link(site=site, connect=tuple(connect), listen=tuple(listen), credentials=credentials)
