"""A link that is slow and breaks again and again: no event is lost, and none comes out of order."""

import asyncio
import contextlib
import itertools
import random
from collections.abc import AsyncGenerator

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import SelectionEvent
from pointit.schemas.topics import SELECTION_EVENTS
from tests.support.bench import START_NS, until
from tests.support.buses import router_process

SLOWEST_S = 0.3
"""Delay of the slowest packet."""
BREAKS = 8
LIVES_S = (0.5, 1.2)
PERIOD_S = 0.02
RECOVERED_S = 60.0


class BadLink:
    """A relay between a router and its clients."""

    def __init__(self, router: str) -> None:
        host, _, port = router.removeprefix("tcp/").rpartition(":")
        self._router = host, int(port)
        self._random = random.Random(2)
        self._open: set[asyncio.StreamWriter] = set()
        self._serving: set[asyncio.Task[None]] = set()

    @contextlib.asynccontextmanager
    async def endpoint(self) -> AsyncGenerator[str]:
        def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._serving.add(asyncio.create_task(self._serve(reader, writer)))

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        try:
            yield f"tcp/127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            server.close()
            self._cut()
            await asyncio.gather(*self._serving)

    async def breaks(self) -> None:
        """Break, again and again; whole afterwards."""
        for _ in range(BREAKS):
            await asyncio.sleep(self._random.uniform(*LIVES_S))
            self._cut()

    def _cut(self) -> None:
        for writer in self._open:
            writer.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection(*self._router)
        self._open |= {writer, far_writer}
        await asyncio.gather(self._carry(reader, far_writer), self._carry(far_reader, writer))

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):  # cut
            while data := await reader.read(65536):
                await asyncio.sleep(self._random.uniform(0.0, SLOWEST_S))
                writer.write(data)
                await writer.drain()
        self._open.discard(writer)
        writer.close()


async def test_no_event_is_lost_and_none_comes_out_of_order() -> None:
    async with router_process() as router:
        link = BadLink(router.endpoint)
        async with link.endpoint() as endpoint, asyncio.timeout(150.0):
            near = await ZenohBus.open(Link(connect=(router.endpoint,)), patience_s=30)
            far = await ZenohBus.open(Link(connect=(endpoint,)), patience_s=30)
            got: list[int] = []
            reader = far.subscribe(SELECTION_EVENTS, lambda event, _name: got.append(event.seq))
            writer = near.publisher(SELECTION_EVENTS)
            numbers = itertools.count(1)

            def tell() -> int:
                seq = next(numbers)
                writer.put(SelectionEvent(stamp_ns=START_NS, seq=seq, event="left", object_id="a"))
                return seq

            while not got:
                tell()
                await asyncio.sleep(PERIOD_S)
            breaking = asyncio.create_task(link.breaks())
            while not breaking.done():
                tell()
                await asyncio.sleep(PERIOD_S)
            last = tell()
            await until(lambda: got[-1] == last, RECOVERED_S, "the last event")
            assert got == list(range(got[0], last + 1))
            assert reader.traffic.lost == 0
            await far.close()
            await near.close()
