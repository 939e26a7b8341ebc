"""How commands that look on join a site: as clients that give up soon."""

import asyncio
import contextlib
import logging
from collections.abc import AsyncGenerator, Callable, Generator, Sequence
from contextlib import asynccontextmanager, contextmanager
from typing import Generic, TypeVar

import click
from click.core import ParameterSource

from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import PointItError
from pointit.runtime.link.options import link_of, link_options
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.zenoh import session
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Message
from pointit.schemas.topics import Topic

PATIENCE_S = 2.0
"""How long to look for somebody who answers."""

SILENT_S = 1.0
"""A wait that takes longer is told of."""

M = TypeVar("M", bound=Message)


def site_options() -> list[click.Parameter]:
    """Return the options --credentials, --site and --connect."""
    return [option for option in link_options() if option.name != "listen"]


@asynccontextmanager
async def join_site(
    site: str, connect: Sequence[str], *, patience_s: float = PATIENCE_S
) -> AsyncGenerator[ZenohBus]:
    """Yield a bus that has joined `site`; errors inside name the address, unless it was typed.

    Raises:
        ConnectError: nobody answers within `patience_s`.
    """
    opening = logging.getLogger(session.__name__)
    opening.setLevel(logging.ERROR)  # not "trying again until": who gives up soon says so at the end
    try:
        with notify_if_slow(f"looking for {address(site, connect)} …"):
            bus = await ZenohBus.open(link_of(site, connect), patience_s=patience_s)
    finally:
        opening.setLevel(logging.NOTSET)
    try:
        yield bus
    except PointItError as error:
        error.args = (f"{error}{default_address_note(site, connect)}",)
        raise
    finally:
        await bus.close()


def address(site: str, connect: Sequence[str]) -> str:
    """Return a site and where it is looked for, in words."""
    return f"site {site} at {', '.join(connect)}"


def default_address_note(site: str, connect: Sequence[str]) -> str:
    """Return ` (site lab at ...)` when --connect was not typed, else nothing: who types it knows it."""
    context = click.get_current_context(silent=True)
    if context is None or context.get_parameter_source("connect") is ParameterSource.COMMANDLINE:
        return ""
    return f" ({address(site, connect)})"


@contextmanager
def notify_if_slow(text: str) -> Generator[None]:
    """Say `text` on standard error when what is done inside takes longer than `SILENT_S`."""

    def tell() -> None:
        click.echo(text, err=True)

    handle = asyncio.get_running_loop().call_later(SILENT_S, tell)
    try:
        yield
    finally:
        handle.cancel()


def quiet() -> None:
    """Log only what is wrong: standard output belongs to what was asked for."""
    setup_logging("warning")


def _any(_message: Message) -> bool:
    return True


class LatestMessage(Generic[M]):
    """Follows one key."""

    def __init__(self, bus: Bus, topic: Topic[M], name: str = "") -> None:
        self.value: M | None = None
        self._changed = asyncio.Event()
        bus.subscribe(topic, self._on_message, name)

    async def wait(self, patience_s: float, fits: Callable[[M], bool] = _any) -> M | None:
        """Return the newest message as soon as it `fits`; none when none does within `patience_s`."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while self.value is None or not fits(self.value):
                    self._changed.clear()
                    await self._changed.wait()
        return self.value if self.value is not None and fits(self.value) else None

    def _on_message(self, message: M, _name: str) -> None:
        self.value = message
        self._changed.set()
