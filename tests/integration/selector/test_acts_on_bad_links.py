"""A carrier behind a link that stalls or is slow, on real Zenoh: nothing is done that was told as failed."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator

import pytest

from pointit.runtime.clock import WallClock
from pointit.runtime.errors import NoAnswerError, RefusedError
from pointit.runtime.link.link import Link
from pointit.runtime.service.carrier import Carrier
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ActOutcome, ClearSelection, SetThing, topics
from pointit.services.pui.tracked_objects import TRACKER, listing
from pointit.services.selector.service import Selector
from tests.support.bench import background, until
from tests.unit.selector.shop import ROOM, Device

pytestmark = pytest.mark.slow


class StallingLink:
    """A TCP proxy by which each byte takes `delay_s`. While it is cut, none passes."""

    def __init__(self, endpoint: str, delay_s: float = 0.0) -> None:
        self._host, _, self._port = endpoint.removeprefix("tcp/").rpartition(":")
        self._delay_s = delay_s
        self._whole = asyncio.Event()
        self._whole.set()
        self._serving: set[asyncio.Task[None]] = set()
        self._writers: list[asyncio.StreamWriter] = []

    @contextlib.asynccontextmanager
    async def endpoint(self) -> AsyncGenerator[str]:
        def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._serving.add(asyncio.create_task(self._serve(reader, writer)))

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        try:
            yield f"tcp/127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            server.close()
            for task in self._serving:
                task.cancel()
            await asyncio.gather(*self._serving, return_exceptions=True)

    def cut(self) -> None:
        self._whole.clear()

    def mend(self) -> None:
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()
        self._whole.set()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._whole.wait()
        far_reader, far_writer = await asyncio.open_connection(self._host, int(self._port))
        self._writers += [writer, far_writer]
        try:
            with contextlib.suppress(OSError):
                await asyncio.gather(self._carry(reader, far_writer), self._carry(far_reader, writer))
        finally:
            writer.transport.abort()
            far_writer.transport.abort()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        loop = asyncio.get_running_loop()
        while data := await reader.read(65536):
            await self._whole.wait()
            loop.call_later(self._delay_s, writer.write, data)


async def list_things(bus: ZenohBus) -> None:
    """List the things as pui does."""
    bus.publisher(topics.MAP).put(ROOM)
    publisher = bus.publisher(topics.OBJECTS, TRACKER)
    while True:
        publisher.put(listing(ROOM, WallClock().now_ns()))
        await asyncio.sleep(0.1)


async def asked(bus: ZenohBus, thing: str) -> str:
    """Switch or fire a thing as soon as the selector lets it. Return the reply."""
    while True:
        try:
            return (await bus.call(topics.SET_THING, SetThing(thing=thing), "anna")).message
        except (RefusedError, NoAnswerError):
            await asyncio.sleep(0.05)


async def run_selector(bus: ZenohBus) -> None:
    await run_service(Launch(service=Selector, config=Selector.CONFIG()), bus, WallClock())


async def test_bell_rings_once_when_the_link_was_cut_during_its_first_act(endpoint: str) -> None:
    """The cut is longer than the lease of 3 s, and shorter than the 6 s for which an act may be begun."""
    hub = await ZenohBus.open(Link(listen=(endpoint,)), patience_s=30)
    link = StallingLink(endpoint)
    bell = Device(reports=False)
    outcomes: list[ActOutcome] = []
    presences: list[bool] = []
    hub.subscribe(topics.OUTCOMES, lambda outcome, _: outcomes.append(outcome))
    hub.watch(topics.CARRIER_ALIVE, lambda _name, *, present: presences.append(present))
    async with link.endpoint() as far_endpoint, contextlib.AsyncExitStack() as stack:
        far = await ZenohBus.open(Link(connect=(far_endpoint,)), patience_s=30)
        stack.push_async_callback(hub.close)
        stack.push_async_callback(far.close)
        await stack.enter_async_context(background(list_things(hub)))
        await stack.enter_async_context(background(run_selector(hub)))
        carrier = Carrier(far, WallClock(), "home")
        carrier.use({"bell": [bell]})
        await asked(hub, "bell")
        await until(lambda: [each.result for each in outcomes] == ["done"], what="the first ring")
        await asyncio.sleep(1.0)  # the button is shown for a moment

        link.cut()
        await asked(hub, "bell")
        await until(lambda: len(outcomes) == 2, what="the end of the lease")
        assert (outcomes[1].result, outcomes[1].code) == ("failed", "unavailable")
        assert outcomes[1].text == "home has ended before it began: start it again"

        link.mend()
        await until(lambda: presences[-1:] == [True] and len(presences) == 3, what="the carrier to be back")
        await asked(hub, "bell")
        await until(lambda: len(outcomes) == 3, what="the second try")
        await carrier.close()
        assert bell.acts == [True, True], "the first ring, and the one of the second try"


async def test_lamp_behind_a_slow_link_is_never_cleared_without_it(endpoint: str) -> None:
    """The states of its carrier take two round trips to a selector that has just started."""
    hub = await ZenohBus.open(Link(listen=(endpoint,)), patience_s=30)
    lamp = Device()
    async with StallingLink(endpoint, 0.15).endpoint() as far_endpoint, contextlib.AsyncExitStack() as stack:
        far = await ZenohBus.open(Link(connect=(far_endpoint,)), patience_s=30)
        stack.push_async_callback(hub.close)
        stack.push_async_callback(far.close)
        await stack.enter_async_context(background(list_things(hub)))
        carrier = Carrier(far, WallClock(), "home")
        carrier.use({"lamp": [lamp]})
        for _ in range(3):
            near = await ZenohBus.open(Link(connect=(endpoint,)), patience_s=30)
            async with background(run_selector(near)):
                while not lamp.is_on:
                    await asked(hub, "lamp")
            await near.close()

            near = await ZenohBus.open(Link(connect=(endpoint,)), patience_s=30)
            async with background(run_selector(near)):
                reply = ""
                while not reply:
                    with contextlib.suppress(NoAnswerError, RefusedError):
                        reply = (await hub.call(topics.CLEAR_SELECTION, ClearSelection(), "anna")).message
                if reply.startswith("1 "):
                    await until(lambda: not lamp.is_on, what=f"the lamp to go off: {reply}")
            await near.close()
        await carrier.close()
