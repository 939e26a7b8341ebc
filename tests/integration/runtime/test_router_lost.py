"""Links between processes: a router that is killed, a link that breaks, and what travels on one."""

import asyncio
import contextlib
import itertools
import logging
import random
import re
from collections.abc import AsyncGenerator, AsyncIterator
from dataclasses import dataclass

import psutil
import pytest
import pytest_asyncio

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import NoAnswerError
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import EVENT_CACHE, ZenohBus
from pointit.schemas import ButtonEvent, Done, ImuSample, SelectionEvent, SetBrightness, UserProfile, topics
from tests.support.bench import START_NS, until
from tests.support.buses import RouterProcess, router_process, settled

RECOVERY_S = 15.0


@dataclass
class Two:
    router: RouterProcess
    a: ZenohBus
    b: ZenohBus

    async def cut(self) -> None:
        self.router.stop()
        await until(lambda: not self.a.connected and not self.b.connected)

    async def heal(self) -> None:
        self.router.start()
        await until(lambda: self.a.connected and self.b.connected, RECOVERY_S)


@pytest_asyncio.fixture
async def two() -> AsyncIterator[Two]:
    async with router_process() as router:
        link = Link(connect=(router.endpoint,))
        a = await ZenohBus.open(link, patience_s=30)
        b = await ZenohBus.open(link, patience_s=30)
        try:
            yield Two(router, a, b)
        finally:
            await b.close()
            await a.close()


async def test_router_loss_and_return_are_logged_once_and_shown_meanwhile(
    two: Two, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    third = await ZenohBus.open(Link(connect=(two.router.endpoint,)))
    await settled(two.a, two.b, third)
    assert not [record for record in caplog.records if "router at" in record.message]

    await third.close()
    view = ServiceBus(two.a, WallClock(), "pointing", "pointing.anna", "anna")
    assert view.report().status == "ok"

    for _ in range(2):
        caplog.clear()
        await two.cut()
        report = view.report()
        assert report.status == "degraded"
        assert re.search(f"router at {re.escape(two.router.endpoint)} lost \\d+ s ago", report.warnings[0])
        await two.heal()
        assert view.report().warnings == ()
        said = [(r.levelname, r.message) for r in caplog.records if "router at" in r.message]
        assert said == [
            ("WARNING", f"router at {two.router.endpoint} is lost; trying again until it is back"),
            ("WARNING", f"router at {two.router.endpoint} is lost; trying again until it is back"),
            ("INFO", f"router at {two.router.endpoint} is back"),
            ("INFO", f"router at {two.router.endpoint} is back"),
        ], "one line a bus and a change"


async def test_second_router_takes_over(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    async with router_process() as one, router_process() as other:
        bus = await ZenohBus.open(Link(connect=(one.endpoint, other.endpoint)), patience_s=30)
        joined = {it.raddr.port for it in psutil.Process().net_connections() if it.status == "ESTABLISHED"}
        # a busy machine may answer late at the first, so that the second is taken
        (taken,) = [router for router in (one, other) if router.port in joined]
        taken.stop()
        where = f"router at {one.endpoint} or {other.endpoint}"
        await until(lambda: any(f"{where} is back" in it.message for it in caplog.records), RECOVERY_S)
        assert bus.connected
        said = [record.message for record in caplog.records if where in record.message]
        assert said == [f"{where} is lost; trying again until it is back", f"{where} is back"]
        await bus.close()


async def test_latest_requests_and_presence_work_again(two: Two) -> None:
    async def done(_query: SetBrightness, _name: str) -> Done:
        return Done(message="done")

    samples: list[int] = []
    told: list[tuple[str, bool]] = []
    two.b.subscribe(topics.IMU, lambda message, _name: samples.append(message.seq))
    two.b.watch(topics.USER_ALIVE, lambda name, *, present: told.append((name, present)))
    two.a.serve(topics.SET_BRIGHTNESS, done)
    two.a.announce(topics.USER_ALIVE, "anna")
    writer = two.a.publisher(topics.IMU, "anna")
    await until(lambda: told == [("anna", True)])

    def put(seq: int) -> bool:
        writer.put(ImuSample(stamp_ns=1, seq=seq, orientation_xyzw=(0, 0, 0, 1)))
        return seq in samples

    await until(lambda: put(1))
    await two.cut()
    await until(lambda: told[1:] == [("anna", False)])
    put(2)
    with pytest.raises(NoAnswerError, match="led-driver cannot be asked for leds/brightness: router at"):
        await two.b.call(topics.SET_BRIGHTNESS, SetBrightness(brightness=1))
    await two.heal()
    await until(lambda: told[2:] == [("anna", True)])
    await until(lambda: put(3))
    assert 2 not in samples
    assert (await two.b.call(topics.SET_BRIGHTNESS, SetBrightness(brightness=1))).message == "done"


async def test_states_of_the_meantime_arrive(two: Two) -> None:
    early: list[int] = []
    own: list[int] = []
    two.a.subscribe(topics.PROFILE, lambda message, _name: own.append(message.seq))
    two.b.subscribe(topics.PROFILE, lambda message, _name: early.append(message.seq))
    kept = two.a.publisher(topics.PROFILE, "anna")
    changed = two.a.publisher(topics.PROFILE, "ben")
    kept.put(UserProfile(stamp_ns=1, seq=1))

    changed.put(UserProfile(stamp_ns=1, seq=10))
    await until(lambda: sorted(early) == [1, 10])
    await two.cut()
    changed.put(UserProfile(stamp_ns=1, seq=11))
    late: list[int] = []
    two.b.subscribe(topics.PROFILE, lambda message, _name: late.append(message.seq))
    fresh = two.a.publisher(topics.PROFILE, "carl")
    fresh.put(UserProfile(stamp_ns=1, seq=20))

    await two.heal()
    await until(lambda: sorted(set(early[2:])) == [11, 20] and sorted(late) == [1, 11, 20], RECOVERY_S)
    changed.put(UserProfile(stamp_ns=1, seq=12))
    await until(lambda: early[-1] == late[-1] == 12)
    assert early.count(11) == early.count(20) == 1
    assert sorted(own) == [1, 10, 11, 12, 20], "the writer's own process gets nothing twice"


@pytest.mark.parametrize("during", [20, EVENT_CACHE + 100])
async def test_events_of_the_meantime_arrive_in_order_or_are_counted(two: Two, during: int) -> None:
    seen: list[int] = []
    subscription = two.b.subscribe(topics.BUTTON, lambda message, _name: seen.append(message.seq))
    writer = two.a.publisher(topics.BUTTON, "anna")
    await settled(two.a, two.b)
    for seq in range(10):
        writer.put(ButtonEvent(stamp_ns=1, seq=seq))

    await until(lambda: seen == list(range(10)))
    await two.cut()
    total = 10 + during
    for seq in range(10, total):
        writer.put(ButtonEvent(stamp_ns=1, seq=seq))
    await two.heal()
    traffic = subscription.traffic

    await until(lambda: len(seen) + traffic.lost == total, RECOVERY_S, f"{len(seen)}, {traffic}")
    assert seen == sorted(set(seen))
    assert traffic.lost == max(0, during - EVENT_CACHE)

    writer.put(ButtonEvent(stamp_ns=1, seq=total))
    await until(lambda: seen[-1] == total)
    assert len(seen) + traffic.lost == total + 1


SLOWEST_S = 0.3
"""Delay of the slowest packet."""
BREAKS = 8
LIVES_S = (0.5, 1.2)
PERIOD_S = 0.02
RECOVERED_S = 60.0


class BadLink:
    """Between a router and its clients: delays every packet, and breaks again and again."""

    _random = random.Random(2)

    def __init__(self, router: str) -> None:
        host, _, port = router.removeprefix("tcp/").rpartition(":")
        self._router = host, int(port)
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
            self.cut()
            await asyncio.gather(*self._serving, return_exceptions=True)

    def cut(self) -> None:
        for task in self._serving:
            task.cancel()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection(*self._router)
        try:
            with contextlib.suppress(OSError):
                await asyncio.gather(self.carry(reader, far_writer), self.carry(far_reader, writer))
        finally:
            writer.transport.abort()
            far_writer.transport.abort()

    async def breaks(self) -> None:
        """Break, again and again; whole afterwards."""
        for _ in range(BREAKS):
            await asyncio.sleep(self._random.uniform(*LIVES_S))
            self.cut()

    async def carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(65536):
            await asyncio.sleep(self._random.uniform(0.0, SLOWEST_S))
            writer.write(data)
            await writer.drain()


async def test_no_event_is_lost_and_none_comes_out_of_order() -> None:
    async with router_process() as router:
        link = BadLink(router.endpoint)
        async with link.endpoint() as endpoint, asyncio.timeout(150.0):
            near = await ZenohBus.open(Link(connect=(router.endpoint,)), patience_s=30)
            far = await ZenohBus.open(Link(connect=(endpoint,)), patience_s=30)
            got: list[int] = []
            reader = far.subscribe(topics.SELECTION_EVENTS, lambda event, _name: got.append(event.seq))
            writer = near.publisher(topics.SELECTION_EVENTS)
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
