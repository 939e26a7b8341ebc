"""Commands that observe a site join it as clients with a short timeout."""

from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager

import click
from click.core import ParameterSource

from pointit.cli.common.waiting import notify_if_slow
from pointit.runtime.errors import PointItError
from pointit.runtime.link.options import link_of, link_options
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.zenoh.zenoh_bus import ZenohBus

CONNECT_PATIENCE_S = 5.0
"""Timeout of finding a site, s: a router on a busy machine may take seconds to answer."""


def site_options() -> list[click.Parameter]:
    """Return the options --credentials, --site and --connect."""
    return [option for option in link_options() if option.name != "listen"]


@asynccontextmanager
async def join_site(
    site: str, connect: Sequence[str], *, patience_s: float = CONNECT_PATIENCE_S
) -> AsyncGenerator[ZenohBus]:
    """Yield a bus that has joined `site`. Errors inside name the address, unless it was given.

    Raises:
        ConnectError: If no router or peer answers within `patience_s`.
    """
    with notify_if_slow(f"looking for {address(site, connect)} …"):
        bus = await ZenohBus.open(link_of(site, connect), patience_s=patience_s)
    try:
        yield bus
    except PointItError as error:
        error.args = (f"{error}{default_address_note(site, connect)}",)
        raise
    finally:
        await bus.close()


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
