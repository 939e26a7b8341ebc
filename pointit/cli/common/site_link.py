"""Commands that observe a site join it as clients with a short timeout."""

import asyncio
import socket
from collections.abc import AsyncGenerator, Callable, Coroutine, Generator, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager
from dataclasses import dataclass
from functools import partial, wraps
from typing import Any

import click
from click.core import ParameterSource

from pointit.runtime.errors import ConnectError, PointItError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.link.link import ENDPOINT, Link
from pointit.runtime.link.options import link_of, link_options
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.process import run_until_shutdown
from pointit.runtime.zenoh.zenoh_bus import ZenohBus

CONNECT_TIMEOUT_S = 5.0
"""Timeout of finding a site, s: a router on a busy machine may take seconds to answer."""

REFUSED_TIMEOUT_S = 2.0
"""Timeout of finding a site where nobody listens, s: it may be about to start."""

PROBE_S = 1.0
"""Timeout of finding out whether somebody listens, s."""

TIMEOUT_S = 2.0
"""Timeout of a site's first message, s."""

SILENT_S = 1.0
"""Wait after which a notice is printed, s."""


@dataclass(frozen=True)
class SiteAddress:
    """The site that a command joins, by its options --site and --connect."""

    name: str
    connect: tuple[str, ...]

    def join(self) -> AbstractAsyncContextManager[ZenohBus]:
        """Return `join_site` of this site."""
        return join_site(self.name, self.connect)

    @property
    def note(self) -> str:
        """Return `default_address_note` of this site."""
        return default_address_note(self.name, self.connect)


def site_command(
    name: str, *, params: Sequence[click.Parameter] = (), **attributes: Any
) -> Callable[[Callable[..., Coroutine[Any, Any, int]]], click.Command]:
    """Return a decorator that makes a coroutine function a command with the options of a site.

    The function gets the `SiteAddress` first. It runs, with a quiet log, until it returns its exit code or is
    cancelled by Ctrl-C.
    """

    def decorate(work: Callable[..., Coroutine[Any, Any, int]]) -> click.Command:
        @wraps(work)
        def run(*, site: str, connect: tuple[str, ...], **values: Any) -> int:
            quiet()
            return run_until_shutdown(work(SiteAddress(site, connect), **values))

        return click.command(name, params=[*params, *site_options()], **attributes)(run)

    return decorate


def site_options() -> list[click.Parameter]:
    """Return the options --credentials, --site and --connect."""
    return [option for option in link_options() if option.name != "listen"]


@contextmanager
def notify_if_slow(text: str) -> Generator[None]:
    """Print `text` to standard error if the block takes longer than `SILENT_S`."""
    handle = asyncio.get_running_loop().call_later(SILENT_S, partial(click.echo, text, err=True))
    try:
        yield
    finally:
        handle.cancel()


@asynccontextmanager
async def join_site(
    site: str, connect: Sequence[str], *, timeout_s: float = CONNECT_TIMEOUT_S
) -> AsyncGenerator[ZenohBus]:
    """Yield a bus that has joined `site`. Errors inside name the address, unless it was given.

    Raises:
        ConnectError: If no router or peer answers within `timeout_s`.
    """
    with notify_if_slow(f"looking for {address(site, connect)} …"):
        bus = await _open(link_of(site, connect), timeout_s)
    try:
        yield bus
    except PointItError as error:
        error.args = (f"{error}{default_address_note(site, connect)}",)
        raise
    finally:
        await bus.close()


async def _open(link: Link, timeout_s: float) -> ZenohBus:
    """Return a bus that has joined, tried for long only where somebody listens."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    try:
        return await ZenohBus.open(link, patience_s=min(timeout_s, REFUSED_TIMEOUT_S))
    except ConnectError:
        spent_s = loop.time() - began_s
        is_final = spent_s < REFUSED_TIMEOUT_S or spent_s >= timeout_s
        # A listener that has not answered yet may be a router on a busy machine
        if is_final or await in_daemon_thread(lambda: _are_refused(link.connect), "probe"):
            raise
    return await ZenohBus.open(link, patience_s=timeout_s - spent_s)


def _are_refused(endpoints: Sequence[str]) -> bool:
    return all(listens(endpoint) is False for endpoint in endpoints)


def listens(endpoint: str) -> bool | None:
    """Return True if a TCP port is open, False if it refuses, None if unknown. Blocks for up to `PROBE_S`."""
    parts = ENDPOINT.fullmatch(endpoint)
    if not parts or parts[1] not in ("tcp", "tls", "ws"):
        return None
    host = parts[2].strip("[]")
    port = int(parts["port"])
    try:
        socket.create_connection((host, port), timeout=PROBE_S).close()
    except ConnectionRefusedError:
        return False
    except OSError:
        return None
    return True


def address(site: str, connect: Sequence[str]) -> str:
    """Return a description of a site and its addresses."""
    return f"site {site} at {', '.join(connect)}"


def default_address_note(site: str, connect: Sequence[str]) -> str:
    """Return ` (site lab at ...)` if --connect was not given, else `""`."""
    context = click.get_current_context(silent=True)
    if context is None or context.get_parameter_source("connect") is ParameterSource.COMMANDLINE:
        return ""
    return f" ({address(site, connect)})"


def quiet() -> None:
    """Log only warnings and errors, so that the command's output stays readable."""
    setup_logging("warning")
