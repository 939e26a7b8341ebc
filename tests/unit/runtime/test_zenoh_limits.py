"""Limits of what comes by Zenoh, and mailboxes."""

import asyncio
import gc
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator

import msgpack
import pytest
import zenoh

from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic
from pointit.runtime.bus.mailbox import Dispatcher, Mailbox
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.errors import RefusedError
from pointit.runtime.zenoh.declarations import decoded
from pointit.runtime.zenoh.queries import MAX_WAITING, SHOWN_S, SLICE_S, BoundedWorkQueue, OverflowCounter
from pointit.runtime.zenoh.subscribers import MAX_USERS, SILENT_S, NameAllowlist, NameLimiter
from pointit.schemas import ButtonEvent, ClockTick, ImuSample, KeyNameError, Message, encode
from pointit.schemas.codec import MEDIA_TYPE
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
async def test_newest_item_of_many_threads_comes_last_without_missed_wakeups() -> None:
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
async def test_items_of_all_threads_are_counted_once(topic: AnyTopic) -> None:
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
async def test_items_of_loop_and_other_threads_stay_in_order(topic: AnyTopic, left: Iterable[int]) -> None:
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


@pytest.mark.usefixtures("restless")
async def test_closed_mailbox_handles_nothing_that_threads_still_offer() -> None:
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


async def test_overflow_is_logged_once_for_each_burst(
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


async def test_one_wake_up_drains_a_chain_and_lets_others_run() -> None:
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


async def test_cancelled_handler_does_not_silence_the_dispatcher() -> None:
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


async def test_unpacking_errors_are_counted() -> None:
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
    caplog: pytest.LogCaptureFixture, error: Exception, logged: list[str], bus: MemoryBus
) -> None:
    async def fail() -> None:
        raise error

    await asyncio.wait([bus.spawn(fail(), "look")])
    await asyncio.sleep(0)
    assert [record.message for record in caplog.records] == logged


async def test_queue_rejects_items_beyond_its_limit_and_keeps_the_order() -> None:
    seen: list[int] = []
    turned_away = OverflowCounter()

    def work(item: int) -> tuple[()]:
        seen.append(item)
        return ()

    line = BoundedWorkQueue("users/*/profile", work, turned_away)
    taken: list[bool] = []
    items = range(MAX_WAITING + 3)
    thread = threading.Thread(target=lambda: taken.extend(map(line.offer, items)))
    thread.start()
    thread.join()  # the loop is held up meanwhile
    assert taken == [True] * MAX_WAITING + [False] * 3
    sentence = turned_away.problem(time.monotonic())
    assert sentence.startswith("3 questions were turned away, the last for users/*/profile, ")
    assert turned_away.problem(time.monotonic() + SHOWN_S + 1.0) == ""
    await until(lambda: len(seen) == MAX_WAITING)
    assert seen == list(range(MAX_WAITING))
    assert line.offer(7), "there is room again"
    await until(lambda: seen[-1] == 7)


async def test_other_tasks_run_while_a_long_item_is_worked_on() -> None:
    turns = 0
    counts: list[int] = []

    def work(steps: int) -> Iterator[None]:
        for _ in range(steps):
            counts.append(turns)
            time.sleep(SLICE_S)
            yield

    line = BoundedWorkQueue("key", work, OverflowCounter())
    assert line.offer(20)
    while len(counts) < 20:
        await asyncio.sleep(0)
        turns += 1
    assert len(set(counts)) == 20, "a step longer than a slice is the only one of its turn"


async def test_a_failing_item_does_not_stop_the_next(caplog: pytest.LogCaptureFixture) -> None:
    seen: list[int] = []

    def work(item: int) -> Iterator[None]:
        yield
        seen.append(10 // item)

    line = BoundedWorkQueue("led/brightness", work, OverflowCounter())
    assert line.offer(0)
    assert line.offer(5)
    await until(lambda: seen == [2])
    assert "led/brightness" in caplog.text


def names() -> NameLimiter:
    return NameLimiter("user", lambda key: key.removeprefix("users/"), NameAllowlist())


def test_the_longest_silent_name_is_evicted_after_a_minute() -> None:
    heard = names()
    for index in range(MAX_USERS):
        heard.admit(f"users/x{index}", 1.0)
    heard.admit("users/x0", 2.0)
    with pytest.raises(KeyNameError, match="user 'new'"):
        heard.admit("users/new", 1.0 + SILENT_S)
    assert heard.admit("users/new", 1.1 + SILENT_S) == "new"  # in place of x1
    assert heard.admit("users/x0", 1.1 + SILENT_S) == "x0"
    assert heard.admit("users/x1", 1.1 + SILENT_S) == "x1"  # in place of x2


def test_a_name_that_is_refused_takes_no_place() -> None:
    def refuse(key: str) -> str:
        if key.startswith("bad"):
            raise KeyNameError(key)
        return key

    heard = NameLimiter("user", refuse, NameAllowlist())
    for index in range(MAX_USERS):
        with pytest.raises(KeyNameError):
            heard.admit(f"bad{index}", 0.0)
    for index in range(MAX_USERS):
        heard.admit(f"good{index}", 0.0)


TICK = ClockTick(stamp_ns=1, sim_ns=2, speed=3.0)
GROWN = zenoh.ZBytes(msgpack.packb({**msgpack.unpackb(encode(TICK)), "added_later": 4}))


def test_fields_that_a_newer_version_added_are_ignored() -> None:
    newer = zenoh.Encoding(MEDIA_TYPE).with_schema("ClockTick.v98")
    assert decoded(ClockTick, GROWN, newer) == TICK
