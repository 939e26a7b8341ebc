"""The buffer between foreign threads and the loop: nothing lost, nothing twice, nothing stuck."""

import asyncio
import gc
import sys
import threading
from collections.abc import Callable, Iterable, Iterator

import pytest

from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic
from pointit.runtime.bus.mailbox import Dispatcher, Mailbox
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.errors import RefusedError
from pointit.schemas import ButtonEvent, ImuSample, Message
from pointit.schemas.topics import BUTTON, CURSOR, IMU
from tests.support.bench import until

pytestmark = pytest.mark.wall_time
THREADS = 4


def run_threads(work: Callable[[int], None]) -> list[threading.Thread]:
    """Start `work` in threads, each with its number."""
    threads = [threading.Thread(target=work, args=(index,)) for index in range(THREADS)]
    for thread in threads:
        thread.start()
    return threads


@pytest.fixture
def restless() -> Iterator[None]:
    """Switch threads as often as Python can, to meet the races."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


async def settle() -> None:
    """Let the loop do what is due."""
    for _ in range(5):
        await asyncio.sleep(0)


def press(seq: int) -> ButtonEvent:
    return ButtonEvent(stamp_ns=1, seq=seq)


@pytest.mark.usefixtures("restless")
async def test_events_of_many_threads_all_come_each_thread_in_order() -> None:
    seen: list[tuple[str, int]] = []
    mailbox = Mailbox(BUTTON, lambda message, name: seen.append((name, message.seq)), Dispatcher())
    each = 5000
    events = [press(seq) for seq in range(each)]

    def offer(index: int) -> None:
        for event in events:
            mailbox.offer(f"t{index}", event)

    threads = run_threads(offer)
    traffic = mailbox.traffic
    await until(lambda: len(seen) + traffic.dropped >= THREADS * each, 30)
    for thread in threads:
        thread.join()
    assert traffic.received == len(seen) + traffic.dropped == THREADS * each
    for index in range(THREADS):
        mine = [seq for name, seq in seen if name == f"t{index}"]
        assert mine == sorted(set(mine))


@pytest.mark.usefixtures("restless")
async def test_the_newest_of_many_threads_comes_last_and_no_wake_up_is_missed() -> None:
    newest: dict[str, int] = {}
    handled = 0

    def handle(message: Message, name: str) -> None:
        nonlocal handled
        handled += 1
        newest[name] = message.seq

    dispatcher = Dispatcher()
    mailboxes = [Mailbox(IMU, handle, dispatcher) for _ in range(THREADS)]
    each = 5000
    samples = [ImuSample(stamp_ns=1, seq=seq, orientation_xyzw=(0, 0, 0, 1)) for seq in range(each)]

    def offer(index: int) -> None:
        for sample in samples:
            for turn in range(THREADS):
                mailboxes[(index + turn) % THREADS].offer(f"t{index}", sample)

    threads = run_threads(offer)
    while any(thread.is_alive() for thread in threads):  # noqa: ASYNC110 - foreign threads set no event
        await asyncio.sleep(0.01)
    await until(lambda: newest == {f"t{index}": each - 1 for index in range(THREADS)})
    total = sum(mailbox.traffic.received for mailbox in mailboxes)
    assert total == THREADS * THREADS * each
    await until(lambda: handled + sum(mailbox.traffic.dropped for mailbox in mailboxes) == total)


@pytest.mark.usefixtures("restless")
@pytest.mark.parametrize("topic", [BUTTON, IMU])
async def test_nothing_of_the_loop_and_other_threads_is_lost_or_counted_twice(topic: AnyTopic) -> None:
    """Some threads even put what they should offer."""
    seen: list[tuple[str, int]] = []
    mailbox = Mailbox(topic, lambda message, name: seen.append((name, message.seq)), Dispatcher())
    each = 5000
    events = [press(seq) for seq in range(each)]

    def bring(index: int) -> None:
        for event in events:
            (mailbox.put if index % 2 else mailbox.offer)(f"t{index}", event)

    threads = run_threads(bring)
    put = 0
    while put < each or any(thread.is_alive() for thread in threads):
        mailbox.put("loop", press(put))
        put += 1
        if not put % 7:
            await asyncio.sleep(0)
    await settle()
    traffic = mailbox.traffic
    assert traffic.received == len(seen) + traffic.dropped == put + THREADS * each
    for name, count in {"loop": put, **{f"t{index}": each for index in range(THREADS)}}.items():
        mine = [seq for its_name, seq in seen if its_name == name]
        assert mine == sorted(set(mine))
        assert topic is BUTTON or mine[-1] == count - 1, "the newest wins"


@pytest.mark.parametrize(("topic", "left"), [(BUTTON, range(9)), (IMU, [8])])
async def test_what_other_threads_bring_neither_overtakes_nor_is_overtaken(
    topic: AnyTopic, left: Iterable[int]
) -> None:
    seen: list[int] = []
    mailbox = Mailbox(topic, lambda message, _name: seen.append(message.seq), Dispatcher())
    for wakes in range(1, 4):
        for seq in range(9):
            if seq in (2, 3, 6):
                thread = threading.Thread(target=mailbox.offer, args=("anna", press(seq)))
                thread.start()
                thread.join()
            else:
                mailbox.put("anna", press(seq))
        await settle()
        assert seen == list(left)
        assert mailbox.traffic.received == 9 * wakes
        assert mailbox.traffic.dropped == wakes * (9 - len(seen))
        seen.clear()


async def test_an_error_costs_only_its_message() -> None:
    seen: list[int] = []

    def handle(message: Message, _name: str) -> None:
        if message.seq in (0, 3, 4):
            raise LookupError("broken")
        seen.append(message.seq)

    mailbox = Mailbox(BUTTON, handle, Dispatcher())
    for seq in range(6):
        mailbox.put("anna", press(seq))
    await settle()
    assert seen == [1, 2, 5]
    assert mailbox.traffic.errors == 3


async def test_a_handler_that_closes_the_mailbox_gets_nothing_more() -> None:
    seen: list[int] = []

    def handle(message: Message, _name: str) -> None:
        seen.append(message.seq)
        mailbox.put("anna", press(3))
        mailbox.close()
        mailbox.put("anna", press(4))

    mailbox = Mailbox(BUTTON, handle, Dispatcher())
    for seq in range(3):
        mailbox.put("anna", press(seq))
    await settle()
    assert seen == [0]
    assert mailbox.traffic.received == 4


@pytest.mark.usefixtures("restless")
async def test_nothing_is_handled_after_close_whatever_threads_still_offer() -> None:
    handled: list[int] = []
    mailbox = Mailbox(BUTTON, lambda message, _name: handled.append(message.seq), Dispatcher())
    stop = threading.Event()

    def offer(_index: int) -> None:
        while not stop.is_set():
            mailbox.offer("anna", press(0))

    threads = run_threads(offer)
    await until(lambda: len(handled) > 100)
    mailbox.close()
    at_close = len(handled)
    await asyncio.sleep(0.05)
    stop.set()
    for thread in threads:
        thread.join()
    await asyncio.sleep(0)
    assert len(handled) == at_close
    assert len(mailbox._queue) <= EVENT_CAPACITY


async def test_a_closed_mailbox_holds_nothing() -> None:
    mailbox = Mailbox(BUTTON, lambda _message, _name: None, Dispatcher())
    for seq in range(10):
        mailbox.offer("anna", press(seq))
    mailbox.close()
    assert not mailbox._queue


async def test_an_overflow_is_said_once_however_long_ago_the_last_line(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("pointit.runtime.bus.mailbox.LOG_PERIOD_S", 0.0)
    mailbox = Mailbox(BUTTON, lambda _message, _name: None, Dispatcher())
    for round_, count in enumerate((EVENT_CAPACITY + 5, 10, 10, EVENT_CAPACITY + 7)):
        for seq in range(count):
            mailbox.offer("anna", press(seq))
        await until(lambda: not mailbox._queue, what=f"round {round_}")
    said = [record.message for record in caplog.records]
    assert [line.split(", ")[1] for line in said] == ["5 events lost so far", "12 events lost so far"]


async def test_one_wake_up_drains_a_chain_but_lets_others_have_their_turn() -> None:
    dispatcher = Dispatcher()
    turns = 0
    other_ran_at = -1

    def again(message: Message, name: str) -> None:
        nonlocal turns
        turns += 1
        if turns < 1000:
            mailbox.offer(name, message)

    def other() -> None:
        nonlocal other_ran_at
        other_ran_at = turns

    mailbox = Mailbox(BUTTON, again, dispatcher)
    mailbox.offer("anna", press(0))
    asyncio.get_running_loop().call_soon(other)
    await until(lambda: turns == 1000)
    assert 1 < other_ran_at < 50, "neither one hop a wake-up, nor all of an endless chain"


async def test_a_handler_that_ends_the_world_does_not_silence_the_dispatcher() -> None:
    """Even what is no `Exception` leaves the dispatcher awake for the next."""
    loop = asyncio.get_running_loop()
    raised: list[BaseException] = []
    loop.set_exception_handler(lambda _loop, context: raised.append(context["exception"]))
    seen: list[int] = []

    def handle(message: Message, _name: str) -> None:
        if message.seq == 0:
            raise asyncio.CancelledError
        seen.append(message.seq)

    mailbox = Mailbox(BUTTON, handle, Dispatcher())
    mailbox.offer("anna", press(0))
    await until(lambda: bool(raised))
    mailbox.offer("anna", press(1))
    await until(lambda: seen == [1])
    loop.set_exception_handler(None)


async def test_whatever_unpacking_raises_is_counted() -> None:
    def unpack(_item: object) -> Message:
        raise OverflowError("a norm beyond floats")

    mailbox = Mailbox(BUTTON, lambda _message, _name: None, Dispatcher(), unpack)
    for count in range(1, 4):
        mailbox.offer("anna", b"")
        await until(lambda count=count: mailbox.traffic.invalid == count)


def test_offers_after_the_loop_has_ended_do_no_harm() -> None:
    async def make() -> Mailbox:
        return Mailbox(BUTTON, lambda _message, _name: None, Dispatcher())

    mailbox = asyncio.run(make())

    def offer() -> None:
        for seq in range(2000):
            mailbox.offer("anna", press(seq))

    thread = threading.Thread(target=offer)
    thread.start()
    thread.join()
    assert len(mailbox._queue) == EVENT_CAPACITY


async def test_closed_publishers_leave_no_names_behind() -> None:
    broker = LocalBroker()
    bus = MemoryBus(broker)
    readers = broker.readers_of(CURSOR)
    for number in range(1000):
        bus.publisher(CURSOR, f"user{number}").close()
    gc.collect()
    kept = bus.publisher(CURSOR, "anna")
    assert len(readers._by_name) == 1
    kept.close()
    await bus.close()


@pytest.mark.parametrize(("error", "logged"), [(ValueError("oh"), ["look failed"]), (RefusedError("no"), [])])
async def test_tasks_that_fail_are_logged_unless_it_is_a_reply(
    caplog: pytest.LogCaptureFixture, error: Exception, logged: list[str]
) -> None:
    async def fail() -> None:
        raise error

    bus = MemoryBus(LocalBroker())
    await asyncio.wait([bus.spawn(fail(), "look")])
    await asyncio.sleep(0)
    assert [record.message for record in caplog.records] == logged
    await bus.close()
