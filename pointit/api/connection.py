"""Joining a site that runs elsewhere."""

import contextlib
import datetime as dt
import functools
import logging
import os
from collections.abc import AsyncGenerator, Sequence
from pathlib import Path

from pointit.api.loop_thread import LoopThread
from pointit.api.requests import as_sequence
from pointit.api.site import Site
from pointit.api.sync_site import SyncSite
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import AccessDeniedError, ConfigError, PointItError, WrongSiteError
from pointit.runtime.link.link import (
    DEFAULT_ENDPOINT,
    DEFAULT_SITE,
    VARIABLE,
    Credentials,
    Link,
    read_credentials,
)
from pointit.runtime.virtual_time import is_virtual
from pointit.runtime.zenoh.connections import sites_at
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import ANY, HEALTH, SERVICE_ALIVE, USER_ALIVE

log = logging.getLogger(__name__)

TIMEOUT_S = 2.0
"""Time limit of finding a site, s."""


def connect(
    address: str | Sequence[str] = (),
    *,
    site: str = "",
    credentials: str | Path | None = None,
    timeout_s: float | None = TIMEOUT_S,
) -> contextlib.AbstractAsyncContextManager[Site]:
    """Join a running site: `async with pointit.connect() as site`.

    Args:
        address: addresses of a `pointit run` or `pointit router`, such as `tcp/192.168.1.5:7447`, to try in
            turn. Default: those of the credentials, else port 7447 of this machine. The log names the
            command that runs there.
        site: name of the site. Default: that of the credentials, else `lab`.
        credentials: folder of an identity on a secured site. Default: `$POINTIT_CREDENTIALS`, if set.
        timeout_s: timeout, s. None: wait without limit.

    Raises:
        ConnectError: If no site answers at the address, or the router refuses the credentials.
        WrongSiteError: If only other sites run there.
        AccessDeniedError: If this identity was revoked.
        ConfigError: If the address or the credentials cannot be used.
    """
    return _join(address, site, credentials, timeout_s)


def open(  # noqa: A001 - `pointit.open`
    address: str | Sequence[str] = (),
    *,
    site: str = "",
    credentials: str | Path | None = None,
    timeout_s: float | None = TIMEOUT_S,
) -> SyncSite:
    """Join a running site without asyncio: in a script, a notebook or a shell.

    The site is also a context manager. Without `with`, close it at the end. Arguments and errors are those of
    `connect`.
    """
    thread = LoopThread()
    try:
        return SyncSite(_join(address, site, credentials, timeout_s), thread)
    except PointItError as error:
        raise error.with_traceback(None) from None  # a script without a site ends with a sentence


@contextlib.asynccontextmanager
async def _join(
    address: str | Sequence[str], site: str, credentials: str | Path | None, timeout_s: float | None
) -> AsyncGenerator[Site]:
    if is_virtual():
        raise ConfigError("a site that runs elsewhere cannot be joined in virtual time; start one with `run`")
    link = _link(as_sequence(address), site, credentials)
    bus = await ZenohBus.open(link, patience_s=timeout_s)
    try:
        await _check_site(bus)
        is_default = not address and not site
        if is_default and not link.credentials:
            people = ", ".join(sorted(await bus.list_present(USER_ALIVE))) or "nobody"
            _log_joined(f"site {bus.site} at {DEFAULT_ENDPOINT}, with {people}")
        async with Site.on(bus, SiteClock(bus)) as joined:
            yield joined
    finally:
        await bus.close()


@functools.cache  # once
def _log_joined(site: str) -> None:
    log.warning("joined %s; to join another run, pass its address, such as tcp/HOST:7447", site)


def _link(connect: Sequence[str], site: str, folder: str | Path | None) -> Link:
    folder = folder or os.environ.get(VARIABLE)
    if not folder:
        addresses = tuple(connect) or (DEFAULT_ENDPOINT,)
        return Link(site=site or DEFAULT_SITE, connect=addresses)
    credentials = _credentials(Path(folder))
    if site and site != credentials.link.site:
        raise ConfigError(
            f"site {site}: the credentials in {credentials.folder} are of site {credentials.link.site}; "
            "leave the site out, or use that site's credentials"
        )
    addresses = tuple(connect) or tuple(credentials.link.endpoints)
    return Link(site=credentials.link.site, connect=addresses, credentials=credentials)


def _credentials(folder: Path) -> Credentials:
    now = dt.datetime.now(dt.UTC)
    credentials = read_credentials(folder, now)
    if ending := credentials.expiry_warning(now):
        log.warning("%s", ending)
    return credentials


async def _check_site(bus: ZenohBus) -> None:
    """Check, if no service is present, that no other site runs there and that this identity may read.

    Raises:
        WrongSiteError: If there are other sites.
        AccessDeniedError: If this identity may do nothing.
    """
    if await bus.list_present(SERVICE_ALIVE):
        return
    addresses = " or ".join(bus.link.connect)
    if bus.is_restricted:
        if denied := await bus.denial_reason("reads", HEALTH, ANY):
            raise AccessDeniedError(denied)
        return
    others = await sites_at(bus.link)
    if others and bus.site not in others:  # it may have come meanwhile
        listed = ", ".join(others)
        raise WrongSiteError(
            f"nothing runs on site {bus.site} at {addresses}; there is site {listed}: give its name, "
            f"or start `pointit run --site {bus.site}`"
        )
