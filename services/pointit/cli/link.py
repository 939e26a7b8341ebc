"""How commands that look on join a site: as clients that give up soon."""

import logging
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager

import click

from pointit.runtime import zenoh_session
from pointit.runtime.log import setup_logging
from pointit.runtime.process import link_options
from pointit.runtime.zenoh_bus import ZenohBus
from pointit.runtime.zenoh_session import Link

PATIENCE_S = 2.0
"""How long to look for somebody who answers."""


def site_options() -> list[click.Parameter]:
    """Return the options --site and --connect."""
    return [option for option in link_options() if option.name in ("site", "connect")]


@asynccontextmanager
async def joined(
    site: str, connect: Sequence[str], *, patience_s: float = PATIENCE_S
) -> AsyncGenerator[ZenohBus]:
    """Yield a bus that has joined `site`.

    Raises:
        ConnectError: nobody answers within `patience_s`.
    """
    opening = logging.getLogger(zenoh_session.__name__)
    opening.setLevel(logging.ERROR)  # not "trying again until": who gives up soon says so at the end
    try:
        bus = await ZenohBus.open(Link(site=site, connect=tuple(connect)), patience_s=patience_s)
    finally:
        opening.setLevel(logging.NOTSET)
    try:
        yield bus
    finally:
        await bus.close()


def quiet() -> None:
    """Log only what is wrong: standard output belongs to what was asked for."""
    setup_logging("warning")
