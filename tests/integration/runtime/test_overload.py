"""A reader that is too slow harms only itself."""

import asyncio
import threading
import time

import psutil
import pytest

from pointit.runtime.link.link import Link
from pointit.runtime.router import running_router
from pointit.runtime.zenoh.subscribers import ZenohSubscription
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ButtonEvent, ImuSample
from pointit.schemas.topics import BUTTON, IMU
from tests.support.bench import until
from tests.support.buses import free_port

RATE_HZ = 1000
STEP_S = 0.05
NAMES = ("anna", "ben")


class SlowReader:
    """Reads in a thread of its own, with its own loop and session, and takes 50 ms a message."""

    def __init__(self, endpoint: str) -> None:
        self.seen: list[tuple[str, int]] = []
        self.most_waiting = 0
        self.ready = threading.Event()
        self.subscription: ZenohSubscription | None = None
        self._endpoint = endpoint
        self._stop: asyncio.Event | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=lambda: asyncio.run(self._read()))

    def start(self) -> None:
        self._thread.start()
        assert self.ready.wait(60)

    def stop(self) -> None:
        assert self._loop is not None
        assert self._stop is not None
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(60)
        assert not self._thread.is_alive()

    async def _read(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        bus = await ZenohBus.open(Link(connect=(self._endpoint,)), patience_s=30)
        subscription = bus.subscribe(IMU, self._handle)
        assert isinstance(subscription, ZenohSubscription)
        self.subscription = subscription
        self.ready.set()
        await self._stop.wait()
        await bus.close()

    def _handle(self, message: ImuSample, name: str) -> None:
        time.sleep(STEP_S)
        assert self.subscription is not None
        self.most_waiting = max(self.most_waiting, len(self.subscription._mailbox._newest))
        self.seen.append((name, message.seq))


async def test_slow_reader_delays_nobody_and_gets_the_newest() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    async with running_router((endpoint,)):
        writer = await ZenohBus.open(Link(connect=(endpoint,)), patience_s=30)
        fast = await ZenohBus.open(Link(connect=(endpoint,)), patience_s=30)
        slow = SlowReader(endpoint)
        await asyncio.to_thread(slow.start)
        got = fast.subscribe(IMU, lambda _message, _name: None).traffic
        publishers = {name: writer.publisher(IMU, name) for name in NAMES}

        def put(seq: int) -> None:
            for publisher in publishers.values():
                publisher.put(ImuSample(stamp_ns=1, seq=seq, orientation_xyzw=(0, 0, 0, 1)))

        def known() -> bool:
            put(0)
            return bool(slow.seen) and got.received > 0

        await until(known)
        before = got.received
        handled_before = len(slow.seen)
        count = 2 * RATE_HZ
        for seq in range(1, count + 1):
            put(seq)
            await asyncio.sleep(1 / RATE_HZ)
        handled = len(slow.seen) - handled_before

        # had the writer waited for the slow one, it would have handled everything by now, twice the count
        assert handled < count
        await until(lambda: got.received >= before + count * len(NAMES), what="the fast reader to get all")
        await until(lambda: {(name, count) for name in NAMES} <= set(slow.seen), what="the newest")
        assert slow.most_waiting <= len(NAMES), "one a key, however slow the reader"
        assert slow.subscription is not None
        assert slow.subscription.traffic.dropped > count

        await asyncio.to_thread(slow.stop)
        await fast.close()
        await writer.close()


@pytest.mark.slow
async def test_memory_stays_flat() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    reader = await ZenohBus.open(Link(listen=(endpoint,)))
    writer = await ZenohBus.open(Link(connect=(endpoint,)), patience_s=30)
    event_traffic = reader.subscribe(BUTTON, lambda _message, _name: None).traffic
    traffic = reader.subscribe(IMU, lambda _message, _name: None).traffic
    samples = writer.publisher(IMU, "anna")
    events = writer.publisher(BUTTON, "anna")
    process = psutil.Process()

    async def burst(count: int) -> None:
        for seq in range(count):
            samples.put(ImuSample(stamp_ns=1, seq=seq, orientation_xyzw=(0, 0, 0, 1)))
            events.put(ButtonEvent(stamp_ns=1, seq=seq))
            if not seq % 20:
                await asyncio.sleep(0)

    grown: list[int] = []
    for _ in range(4):  # what is kept grows with each; what was only on its way, on a busy machine, does not
        before = process.memory_info().rss
        received = traffic.received
        await burst(10_000)
        await until(lambda: traffic.received > received, what="samples")  # noqa: B023 - awaited at once
        await asyncio.sleep(0.5)
        grown.append(process.memory_info().rss - before)
    assert event_traffic.received > 1000
    assert min(grown) < 4e6, f"{[round(each / 1e6, 1) for each in grown]} MB for 20000 messages of 100 bytes"
    await writer.close()
    await reader.close()
