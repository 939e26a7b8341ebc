"""A Zenoh router in this process: what joins several machines where no zenohd is installed."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.runtime.zenoh_session import Link, close_session, open_session


@asynccontextmanager
async def routing(listen: tuple[str, ...]) -> AsyncGenerator[None]:
    """Route for every site at the addresses `listen` while inside.

    Raises:
        ListenError: an address is taken or not ours.
    """
    session = await open_session(Link(listen=listen, router=True))
    try:
        yield
    finally:
        await close_session(session)
