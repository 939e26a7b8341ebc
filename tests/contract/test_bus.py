"""What every bus promises: one suite, passed in memory, between peers and through a router."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest
import pytest_asyncio

from pointit.runtime import (
    Bus,
    BusClosedError,
    NoAnswerError,
    Publisher,
    RefusedError,
)
from pointit.runtime.bus import EVENT_CAPACITY, MAX_IN_FLIGHT
from pointit.schemas import (
    AddPackage,
    AddPackageReply,
    ButtonEvent,
    Done,
    ImuSample,
    KeyNameError,
    Message,
    Selection,
    SetBrightness,
    SetPose,
    UserProfile,
)
from pointit.schemas.topics import (
    ADD_PACKAGE,
    BUTTON,
    IMU,
    PROFILE,
    SELECTION,
    SET_BRIGHTNESS,
    SET_POSE,
    USER_ALIVE,
    Topic,
)
from tests.support.bench import until
from tests.support.buses import KINDS, Site, site_of

LEVEL = (0.0, 0.0, 0.0, 1.0)


@pytest_asyncio.fixture(params=KINDS)
async def site(request: pytest.FixtureRequest) -> AsyncIterator[Site]:
    async with site_of(request.param) as site:
        yield site


def imu(seq: int) -> ImuSample:
    return ImuSample(stamp_ns=seq, seq=seq, orientation_xyzw=LEVEL)


def press(seq: int) -> ButtonEvent:
    return ButtonEvent(stamp_ns=seq, seq=seq)


def profile(seq: int) -> UserProfile:
    return UserProfile(stamp_ns=seq, seq=seq)


class Sink:
    """Keeps what a subscription hands over, as (name, seq)."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.seen: list[tuple[str, int]] = []

    def __call__(self, message: Message, name: str) -> None:
        self.messages.append(message)
        self.seen.append((name, message.seq))

    def of(self, name: str) -> list[int]:
        return [seq for key, seq in self.seen if key == name]


async def reached(publisher: Publisher[ImuSample], *sinks: Sink) -> None:
    """Put until everybody has got something: *latest* promises nothing to who is not known yet."""
    deadline_s = time.monotonic() + 5
    while not all(sink.seen for sink in sinks):
        assert time.monotonic() < deadline_s
        publisher.put(imu(0))
        await asyncio.sleep(0.01)
    publisher.put(imu(1))
    await until(lambda: all(sink.seen[-1][1] == 1 for sink in sinks))  # nothing is on its way any more
    for sink in sinks:
        sink.seen.clear()
        sink.messages.clear()


class TestLatest:
    async def test_the_newest_wins_for_each_key(self, site: Site) -> None:
        sinks = [Sink() for _ in site.buses]
        subscriptions = [bus.subscribe(IMU, sink) for bus, sink in zip(site.buses, sinks, strict=True)]
        writers = {name: site.a.publisher(IMU, name) for name in ("anna", "ben")}
        for writer in writers.values():
            await reached(writer, *sinks)
        for seq in range(1, 101):
            for writer in writers.values():
                writer.put(imu(seq))
        await until(lambda: all(sink.of(name)[-1:] == [100] for sink in sinks for name in writers))
        for sink, subscription in zip(sinks, subscriptions, strict=True):
            for name in writers:
                assert sink.of(name) == sorted(set(sink.of(name)))  # in order, none twice
            assert subscription.traffic.received - subscription.traffic.dropped >= len(sink.seen)
        assert sinks[0].seen == [("anna", 100), ("ben", 100)]  # its own loop never saw the others
        assert subscriptions[0].traffic.dropped >= 2 * 99

    async def test_a_single_name_hears_nobody_else(self, site: Site) -> None:
        one, everyone = Sink(), Sink()
        site.b.subscribe(IMU, one, "anna")
        site.b.subscribe(IMU, everyone)
        anna, ben = site.a.publisher(IMU, "anna"), site.a.publisher(IMU, "ben")
        await reached(anna, one, everyone)
        ben.put(imu(1))
        anna.put(imu(2))
        await until(lambda: set(everyone.seen) == {("ben", 1), ("anna", 2)} and bool(one.seen))
        assert one.seen == [("anna", 2)]

    async def test_late_readers_get_nothing_old(self, site: Site) -> None:
        writer = site.a.publisher(IMU, "anna")
        writer.put(imu(1))
        sink = Sink()
        site.b.subscribe(IMU, sink)
        await site.settle()
        deadline_s = time.monotonic() + 5
        while not sink.seen and time.monotonic() < deadline_s:
            writer.put(imu(2))
            await asyncio.sleep(0.01)
        assert set(sink.seen) == {("anna", 2)}

    async def test_readers_of_the_writers_process_get_the_very_object(self, site: Site) -> None:
        first, second = Sink(), Sink()
        site.a.subscribe(IMU, first)
        site.a.subscribe(IMU, second, "anna")
        message = imu(1)
        site.a.publisher(IMU, "anna").put(message)
        await until(lambda: bool(first.messages and second.messages))
        assert first.messages[0] is message
        assert second.messages[0] is message

    async def test_nothing_is_handled_from_within_put(self, site: Site) -> None:
        sink = Sink()
        site.a.subscribe(IMU, sink)
        site.a.publisher(IMU, "anna").put(imu(1))
        assert not sink.seen
        await until(lambda: bool(sink.seen))

    async def test_a_name_that_cannot_stand_in_a_key_is_refused(self, site: Site) -> None:
        for name in ("", "a/b", "a*", "ä", "x" * 65):
            with pytest.raises(KeyNameError):
                site.a.publisher(IMU, name)
            with pytest.raises(KeyNameError):
                site.a.subscribe(IMU, Sink(), name)
            with pytest.raises(KeyNameError):
                site.a.announce(USER_ALIVE, name)


class TestEvent:
    async def test_all_arrive_in_order_at_all_readers(self, site: Site) -> None:
        sinks = [Sink() for _ in site.buses]
        subscriptions = [bus.subscribe(BUTTON, sink) for bus, sink in zip(site.buses, sinks, strict=True)]
        writer = site.a.publisher(BUTTON, "anna")
        await site.settle()
        for seq in range(300):
            writer.put(press(seq))
            if not seq % 50:
                await asyncio.sleep(0)
        await until(lambda: all(len(sink.seen) >= 300 for sink in sinks))
        for sink, subscription in zip(sinks, subscriptions, strict=True):
            assert sink.of("anna") == list(range(300))
            assert (subscription.traffic.dropped, subscription.traffic.lost) == (0, 0)

    async def test_a_late_reader_gets_what_comes_from_now_on(self, site: Site) -> None:
        writer = site.a.publisher(BUTTON, "anna")
        for seq in range(5):
            writer.put(press(seq))
        await site.settle()  # nothing is on its way any more
        sinks = [Sink() for _ in site.buses]
        for bus, sink in zip(site.buses, sinks, strict=True):
            bus.subscribe(BUTTON, sink)
        await site.settle()
        await asyncio.sleep(0.5)  # two heartbeats of the writer: what makes Zenoh fetch old ones
        writer.put(press(5))
        await until(lambda: all(sink.seen for sink in sinks))
        assert [sink.of("anna") for sink in sinks] == [[5]] * 3

    async def test_overflow_is_counted_and_said(self, site: Site, caplog: pytest.LogCaptureFixture) -> None:
        sink = Sink()
        subscription = site.a.subscribe(BUTTON, sink)
        writer = site.a.publisher(BUTTON, "anna")
        count = EVENT_CAPACITY + 500
        for seq in range(count):  # the loop, and with it the reader, does not run meanwhile
            writer.put(press(seq))
        await until(lambda: len(sink.seen) == EVENT_CAPACITY)
        assert sink.of("anna") == list(range(500, count))
        assert subscription.traffic.received == count
        assert subscription.traffic.dropped == 500
        said = [record for record in caplog.records if "500 events lost" in record.message]
        assert len(said) == 1
        writer.put(press(count))
        await until(lambda: sink.of("anna")[-1] == count)
        assert [record for record in caplog.records if "events lost" in record.message] == said

    async def test_overflow_of_a_remote_reader_is_counted(self, site: Site) -> None:
        sink = Sink()
        subscription = site.b.subscribe(BUTTON, sink)
        writer = site.a.publisher(BUTTON, "anna")
        await site.settle()
        count = 3 * EVENT_CAPACITY
        for seq in range(count):
            writer.put(press(seq))
        traffic = subscription.traffic
        await until(lambda: len(sink.seen) + traffic.dropped + traffic.lost >= count)
        assert len(sink.seen) + traffic.dropped + traffic.lost == count
        assert sink.of("anna") == sorted(sink.of("anna"))
        assert sink.of("anna")[-1] == count - 1


class TestState:
    async def test_a_late_reader_gets_the_last_value_at_once(self, site: Site) -> None:
        writer = site.a.publisher(PROFILE, "anna")
        other = site.b.publisher(PROFILE, "ben")
        for seq in range(1, 4):
            writer.put(profile(seq))
            other.put(profile(10 * seq))
        await site.settle()
        sinks = [Sink() for _ in site.buses]
        for bus, sink in zip(site.buses, sinks, strict=True):
            bus.subscribe(PROFILE, sink)
        await until(lambda: all(set(sink.seen) >= {("anna", 3), ("ben", 30)} for sink in sinks))
        await asyncio.sleep(0.5)  # two heartbeats: whatever makes Zenoh fetch the same again
        assert [sorted(sink.seen) for sink in sinks] == [[("anna", 3), ("ben", 30)]] * 3, "each once"

    async def test_a_late_reader_of_one_name_gets_that_one(self, site: Site) -> None:
        for name, seq in (("anna", 1), ("ben", 2)):
            site.a.publisher(PROFILE, name).put(profile(seq))
        sinks = {bus: Sink() for bus in site.buses}
        for bus, sink in sinks.items():
            bus.subscribe(PROFILE, sink, "ben")
        await until(lambda: all(sink.seen for sink in sinks.values()))
        await site.settle()
        assert [sink.seen for sink in sinks.values()] == [[("ben", 2)]] * 3

    async def test_a_topic_without_names(self, site: Site) -> None:
        site.a.publisher(SELECTION).put(Selection(stamp_ns=1, seq=7))
        sink = Sink()
        site.b.subscribe(SELECTION, sink)
        await until(lambda: sink.seen == [("", 7)])

    async def test_a_writer_may_come_after_the_reader(self, site: Site) -> None:
        sinks = [Sink() for _ in site.buses]
        for bus, sink in zip(site.buses, sinks, strict=True):
            bus.subscribe(PROFILE, sink)
        await site.settle()
        site.a.publisher(PROFILE, "anna").put(profile(1))  # at once, before anybody has heard of it
        await until(lambda: all(sink.seen == [("anna", 1)] for sink in sinks))

    async def test_the_value_goes_with_its_writer(self, site: Site) -> None:
        gone, stays = site.a.publisher(PROFILE, "anna"), site.a.publisher(PROFILE, "ben")
        gone.put(profile(1))
        stays.put(profile(2))
        gone.close()
        await site.settle()
        for bus in site.buses:
            sink = Sink()
            bus.subscribe(PROFILE, sink)
            await until(lambda sink=sink: bool(sink.seen))  # type: ignore[misc]
            await site.settle()
            assert sink.seen == [("ben", 2)]

    async def test_a_second_writer_takes_over_and_keeps_its_value(self, site: Site) -> None:
        first, second = site.a.publisher(PROFILE, "anna"), site.b.publisher(PROFILE, "anna")
        first.put(profile(1))
        second.put(profile(2))
        first.close()
        await site.settle()
        sink = Sink()
        site.c.subscribe(PROFILE, sink)
        await until(lambda: sink.seen == [("anna", 2)])


class TestReaders:
    @pytest.mark.parametrize(("topic", "make"), [(BUTTON, press), (PROFILE, profile)])
    async def test_a_handler_that_raises_stops_nobody(
        self, site: Site, topic: Topic[Any], make: Callable[[int], Message], caplog: pytest.LogCaptureFixture
    ) -> None:
        def fail(_message: Message, _name: str) -> None:
            raise RuntimeError("broken handler")

        sink, other = Sink(), Sink()
        failing = site.b.subscribe(topic, fail)
        site.b.subscribe(topic, sink)
        site.c.subscribe(topic, other)
        writer = site.a.publisher(topic, "anna")
        await site.settle()
        for seq in range(3):
            writer.put(make(seq))
            await until(lambda seq=seq: sink.of("anna")[-1:] == other.of("anna")[-1:] == [seq])  # type: ignore[misc]
        assert failing.traffic.errors == 3
        said = [record for record in caplog.records if record.exc_info and topic.key in record.message]
        assert len(said) == 1, "at most once a second"

    async def test_nothing_runs_after_a_subscription_is_closed(self, site: Site) -> None:
        closed, open_ = Sink(), Sink()
        subscription = site.b.subscribe(BUTTON, closed)
        site.b.subscribe(BUTTON, open_)
        writer = site.a.publisher(BUTTON, "anna")
        await site.settle()
        for seq in range(10):
            writer.put(press(seq))
        await until(lambda: subscription.traffic.received == 10 or bool(closed.seen))
        subscription.close()
        seen = list(closed.seen)
        subscription.close()
        writer.put(press(10))
        await until(lambda: open_.of("anna")[-1:] == [10])
        assert closed.seen == seen

    async def test_a_handler_may_close_its_own_subscription(self, site: Site) -> None:
        sink = Sink()

        def once(message: ButtonEvent, name: str) -> None:
            sink(message, name)
            subscription.close()

        subscription = site.a.subscribe(BUTTON, once)
        other = Sink()
        site.a.subscribe(BUTTON, other)
        writer = site.a.publisher(BUTTON, "anna")
        for seq in range(3):
            writer.put(press(seq))
        await until(lambda: len(other.seen) == 3)
        assert sink.seen == [("anna", 0)]

    async def test_a_chain_of_handlers_is_followed(self, site: Site) -> None:
        sink = Sink()
        rays = site.b.publisher(PROFILE, "anna")
        site.b.subscribe(BUTTON, lambda event, _name: rays.put(profile(event.seq)))
        site.a.subscribe(PROFILE, sink)
        await site.settle()
        site.a.publisher(BUTTON, "anna").put(press(4))
        await until(lambda: sink.seen == [("anna", 4)])


class TestRequests:
    async def test_the_reply_comes_back_typed(self, site: Site) -> None:
        async def add(query: AddPackage, name: str) -> AddPackageReply:
            assert name == ""
            return AddPackageReply(object_id=f"{query.kind}-1", message="added")

        site.a.serve(ADD_PACKAGE, add)
        for bus in site.buses:
            reply = await bus.call(ADD_PACKAGE, AddPackage(kind="red"))
            assert reply == AddPackageReply(object_id="red-1", message="added")

    async def test_the_name_tells_whom_it_is_about(self, site: Site) -> None:
        async def pose(_query: SetPose, name: str) -> Done:
            return Done(message=name)

        async def own(_query: SetPose, name: str) -> Done:
            return Done(message=f"only {name}")

        site.a.serve(SET_POSE, pose, "anna")
        site.b.serve(SET_POSE, own, "ben")
        for bus in site.buses:
            for name, said in (("anna", "anna"), ("ben", "only ben")):
                assert (await bus.call(SET_POSE, SetPose(position_m=(0, 0, 0)), name)).message == said
        with pytest.raises(NoAnswerError):
            await site.c.call(SET_POSE, SetPose(position_m=(0, 0, 0)), "carl")

    async def test_a_server_of_every_name_is_told_which(self, site: Site) -> None:
        async def pose(_query: SetPose, name: str) -> Done:
            return Done(message=name)

        site.a.serve(SET_POSE, pose)
        for bus in site.buses:
            assert (await bus.call(SET_POSE, SetPose(position_m=(0, 0, 0)), "dora")).message == "dora"

    async def test_a_refusal_comes_with_the_servers_sentence(self, site: Site) -> None:
        async def refuse(_query: SetBrightness, _name: str) -> Done:
            raise RefusedError("the strips are off; switch them on")

        site.a.serve(SET_BRIGHTNESS, refuse)
        for bus in site.buses:
            with pytest.raises(RefusedError, match=r"^the strips are off; switch them on$"):
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1))

    async def test_a_server_that_fails_says_so_in_a_sentence(
        self, site: Site, caplog: pytest.LogCaptureFixture
    ) -> None:
        async def fail(_query: SetBrightness, _name: str) -> Done:
            raise ZeroDivisionError("oops")

        site.a.serve(SET_BRIGHTNESS, fail)
        for bus in site.buses:
            caplog.clear()
            with pytest.raises(RefusedError) as caught:
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1))
            assert str(caught.value) == "led-driver failed on leds/brightness: ZeroDivisionError: oops"
            assert any(record.exc_info for record in caplog.records), "the traceback is the server's"

    async def test_a_server_that_asks_another_in_vain_passes_the_sentence_on(self, site: Site) -> None:
        async def forward(_query: SetBrightness, _name: str) -> Done:
            raise NoAnswerError("conveyor-sim does not answer")

        site.a.serve(SET_BRIGHTNESS, forward)
        for bus in site.buses:
            with pytest.raises(RefusedError, match=r"^conveyor-sim does not answer$"):
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1))

    async def test_a_wrong_reply_is_an_error_that_names_both(self, site: Site) -> None:
        async def wrong(_query: AddPackage, _name: str) -> AddPackageReply:
            return Done()  # type: ignore[return-value]  # the defect under test

        site.a.serve(ADD_PACKAGE, wrong)
        for bus in site.buses:
            with pytest.raises(RefusedError, match="Done, not a AddPackageReply"):
                await bus.call(ADD_PACKAGE, AddPackage(kind="red"))

    async def test_nobody_there_is_known_within_a_second(self, site: Site) -> None:
        for bus in site.buses:
            began_s = time.monotonic()
            with pytest.raises(NoAnswerError, match="led-driver does not answer leds/brightness"):
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1))
            assert time.monotonic() - began_s < 1

    async def test_too_slow_is_no_answer_and_the_server_goes_on(self, site: Site) -> None:
        go_on, done = asyncio.Event(), asyncio.Event()

        async def slow(_query: SetBrightness, _name: str) -> Done:
            await go_on.wait()
            done.set()
            return Done()

        site.a.serve(SET_BRIGHTNESS, slow)
        await site.settle()
        for bus in site.buses:
            with pytest.raises(
                NoAnswerError, match=r"led-driver does not answer leds/brightness within 0\.1 s"
            ):
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1), timeout_s=0.1)
        go_on.set()
        await asyncio.wait_for(done.wait(), 2)

    async def test_a_caller_may_give_up(self, site: Site) -> None:
        asked, go_on, done = asyncio.Event(), asyncio.Event(), asyncio.Event()

        async def slow(_query: SetBrightness, _name: str) -> Done:
            asked.set()
            await go_on.wait()
            done.set()
            return Done()

        site.a.serve(SET_BRIGHTNESS, slow)
        for bus in site.buses:
            for event in (asked, go_on, done):
                event.clear()
            call = asyncio.create_task(bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1)))
            await asyncio.wait_for(asked.wait(), 2)
            began_s = time.monotonic()
            call.cancel()
            with pytest.raises(asyncio.CancelledError):
                await call
            assert time.monotonic() - began_s < 1
            go_on.set()
            await asyncio.wait_for(done.wait(), 2)

    async def test_a_hundred_calls_at_once_each_get_their_own_reply(self, site: Site) -> None:
        together = asyncio.Barrier(100)

        async def pose(query: SetPose, name: str) -> Done:
            await together.wait()  # nobody is answered before all have asked
            return Done(message=f"{name} {query.yaw_rad:g}")

        site.a.serve(SET_POSE, pose)
        await site.settle()
        for bus in site.buses:
            replies = await asyncio.gather(
                *(
                    bus.call(SET_POSE, SetPose(position_m=(0, 0, 0), yaw_rad=i), f"u{i}", timeout_s=10)
                    for i in range(100)
                )
            )
            assert [reply.message for reply in replies] == [f"u{i} {i}" for i in range(100)]

    async def test_too_many_at_once_are_refused_and_not_queued(self, site: Site) -> None:
        go_on = asyncio.Event()

        async def slow(_query: SetBrightness, _name: str) -> Done:
            await go_on.wait()
            return Done()

        site.a.serve(SET_BRIGHTNESS, slow)
        await site.settle()
        calls = [
            asyncio.create_task(site.b.call(SET_BRIGHTNESS, SetBrightness(brightness=1), timeout_s=10))
            for _ in range(MAX_IN_FLIGHT + 20)
        ]
        await until(lambda: sum(call.done() for call in calls) == 20)
        go_on.set()
        results = await asyncio.gather(*calls, return_exceptions=True)
        refused = [str(result) for result in results if isinstance(result, RefusedError)]
        assert len(refused) == 20
        assert all("led-driver is busy with 256 other requests" in sentence for sentence in refused)

    async def test_a_server_that_ends_tells_those_who_wait(self, site: Site) -> None:
        stopped: list[str] = []

        async def slow(_query: SetPose, name: str) -> Done:
            try:
                await asyncio.Event().wait()
            finally:
                stopped.append(name)
            return Done()

        served = site.a.serve(SET_POSE, slow)
        await site.settle()
        calls = [
            asyncio.create_task(bus.call(SET_POSE, SetPose(position_m=(0, 0, 0)), "anna"))
            for bus in site.buses
        ]
        await asyncio.sleep(0.2)
        served.close()
        served.close()
        for call in calls:
            with pytest.raises(RefusedError, match="localizer is shutting down"):
                await call
        assert stopped == ["anna"] * 3
        with pytest.raises(NoAnswerError):
            await site.b.call(SET_POSE, SetPose(position_m=(0, 0, 0)), "anna")


class Roll:
    """Who is present, as a watcher was told."""

    def __init__(self) -> None:
        self.told: list[tuple[str, bool]] = []

    def __call__(self, name: str, present: bool) -> None:  # noqa: FBT001 - the handler's own signature
        self.told.append((name, present))


class TestPresence:
    async def test_now_later_and_gone(self, site: Site) -> None:
        site.a.announce(USER_ALIVE, "anna")
        rolls = [Roll() for _ in site.buses]
        for bus, roll in zip(site.buses, rolls, strict=True):
            bus.watch(USER_ALIVE, roll)
        await until(lambda: all(roll.told == [("anna", True)] for roll in rolls))
        ben = site.b.announce(USER_ALIVE, "ben")
        await until(lambda: all(roll.told[1:] == [("ben", True)] for roll in rolls))
        ben.close()
        ben.close()
        await until(lambda: all(roll.told[2:] == [("ben", False)] for roll in rolls))

    async def test_a_bus_that_closes_is_gone(self, site: Site) -> None:
        roll = Roll()
        site.a.watch(USER_ALIVE, roll)
        site.c.announce(USER_ALIVE, "anna")
        await until(lambda: roll.told == [("anna", True)])
        await site.c.close()
        await until(lambda: roll.told[1:] == [("anna", False)])

    async def test_two_under_one_name_are_gone_with_the_last(self, site: Site) -> None:
        rolls = [Roll() for _ in site.buses]
        for bus, roll in zip(site.buses, rolls, strict=True):
            bus.watch(USER_ALIVE, roll)
        tokens = [bus.announce(USER_ALIVE, "anna") for bus in (site.a, site.a, site.b)]
        await until(lambda: all(roll.told == [("anna", True)] for roll in rolls))
        for token in tokens[:2]:
            token.close()
        await site.settle()
        assert [roll.told for roll in rolls] == [[("anna", True)]] * 3
        tokens[2].close()
        await until(lambda: all(roll.told[1:] == [("anna", False)] for roll in rolls))

    async def test_a_watcher_that_raises_is_logged_and_stops_nobody(
        self, site: Site, caplog: pytest.LogCaptureFixture
    ) -> None:
        def fail(_name: str, _present: bool) -> None:  # noqa: FBT001
            raise RuntimeError("broken watcher")

        roll = Roll()
        site.b.watch(USER_ALIVE, fail)
        site.b.watch(USER_ALIVE, roll)
        for name in ("anna", "ben"):
            site.a.announce(USER_ALIVE, name)
        await until(lambda: len(roll.told) == 2)
        await until(lambda: sum("watcher of alive/users" in r.message for r in caplog.records) == 2)
        assert all(record.exc_info for record in caplog.records if "watcher" in record.message)

    async def test_nothing_is_told_after_close(self, site: Site) -> None:
        roll, other = Roll(), Roll()
        watching = site.b.watch(USER_ALIVE, roll)
        site.b.watch(USER_ALIVE, other)
        site.a.announce(USER_ALIVE, "anna")
        await until(lambda: bool(roll.told))
        watching.close()
        watching.close()
        site.a.announce(USER_ALIVE, "ben")
        await until(lambda: len(other.told) == 2)
        assert roll.told == [("anna", True)]


class TestClose:
    async def test_nothing_works_and_nothing_runs_afterwards(self, site: Site) -> None:
        sink, roll, alive = Sink(), Roll(), Sink()
        latest, event, state = (
            site.b.publisher(IMU, "anna"),
            site.b.publisher(BUTTON, "anna"),
            site.b.publisher(PROFILE, "anna"),
        )
        site.b.subscribe(BUTTON, sink)
        site.b.watch(USER_ALIVE, roll)
        site.c.subscribe(BUTTON, alive)
        writer = site.a.publisher(BUTTON, "ben")
        await site.settle()
        for seq in range(50):
            writer.put(press(seq))
        closing = asyncio.create_task(site.b.close())
        await asyncio.sleep(0)
        told = (list(sink.seen), list(roll.told))
        await closing
        site.a.announce(USER_ALIVE, "carl")
        writer.put(press(50))
        await until(lambda: alive.of("ben")[-1:] == [50])
        assert (sink.seen, roll.told) == told
        with pytest.raises(BusClosedError):
            latest.put(imu(1))
        with pytest.raises(BusClosedError):
            event.put(press(1))
        with pytest.raises(BusClosedError):
            state.put(profile(1))
        with pytest.raises(BusClosedError):
            site.b.publisher(IMU, "anna")
        with pytest.raises(BusClosedError):
            site.b.subscribe(IMU, sink)
        with pytest.raises(BusClosedError):
            site.b.announce(USER_ALIVE, "anna")
        with pytest.raises(BusClosedError):
            site.b.watch(USER_ALIVE, roll)
        with pytest.raises(BusClosedError):
            await site.b.call(SET_BRIGHTNESS, SetBrightness(brightness=1))

    async def test_closing_twice_and_closing_what_is_closed_is_fine(self, site: Site) -> None:
        async def done(_query: SetBrightness, _name: str) -> Done:
            return Done()

        declared = [
            site.b.publisher(IMU, "anna"),
            site.b.subscribe(IMU, Sink()),
            site.b.serve(SET_BRIGHTNESS, done),
            site.b.announce(USER_ALIVE, "anna"),
            site.b.watch(USER_ALIVE, Roll()),
        ]
        declared[0].close()
        with pytest.raises(BusClosedError):
            declared[0].put(imu(1))  # type: ignore[attr-defined]
        await asyncio.gather(site.b.close(), site.b.close())
        await site.b.close()
        for one in declared:
            one.close()

    async def test_calls_that_wait_end_with_their_bus(self, site: Site) -> None:
        asked = asyncio.Event()

        async def slow(_query: SetBrightness, _name: str) -> Done:
            asked.set()
            await asyncio.Event().wait()
            return Done()

        site.a.serve(SET_BRIGHTNESS, slow)
        call = asyncio.create_task(site.b.call(SET_BRIGHTNESS, SetBrightness(brightness=1)))
        await asyncio.wait_for(asked.wait(), 2)
        began_s = time.monotonic()
        await site.b.close()
        with pytest.raises(BusClosedError):
            await call
        assert time.monotonic() - began_s < 1.5

    async def test_the_bus_has_no_trouble(self, site: Site, caplog: pytest.LogCaptureFixture) -> None:
        assert [bus.trouble for bus in site.buses] == [""] * 3
        buses: tuple[Bus, ...] = site.buses
        for bus in reversed(buses):  # the one that the others are connected to comes last
            await bus.close()
        assert not [record for record in caplog.records if record.levelno >= logging.WARNING]
