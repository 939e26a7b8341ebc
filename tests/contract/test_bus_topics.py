"""Contract of every bus for topics: in memory, between peers and through a router."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

import pytest

from pointit.runtime.bus.contract import EVENT_CAPACITY
from pointit.runtime.errors import BusClosedError
from pointit.schemas import ButtonEvent, KeyNameError, Message, Selection
from pointit.schemas.topics import BUTTON, IMU, PROFILE, SELECTION, USER_ALIVE, Topic
from tests.contract.readers import readers, tapped, taps
from tests.support.bench import until
from tests.support.buses import Site
from tests.support.sinks import Sink, imu, press, profile, reached

RETIRED_S = 1.0
"""Four times the bus's delay to undeclare a retired writer."""


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

    async def test_a_subscription_to_one_name_gets_no_other(self, site: Site) -> None:
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
        deadline_s = time.monotonic() + 30
        while not sink.seen and time.monotonic() < deadline_s:
            writer.put(imu(2))
            await asyncio.sleep(0.01)
        assert set(sink.seen) == {("anna", 2)}

    async def test_readers_of_the_writers_process_get_the_very_object_later(self, site: Site) -> None:
        first, second = Sink(), Sink()
        site.a.subscribe(IMU, first)
        site.a.subscribe(IMU, second, "anna")
        message = imu(1)
        site.a.publisher(IMU, "anna").put(message)
        assert not first.seen
        assert not second.seen
        await until(lambda: bool(first.messages and second.messages))
        assert first.messages[0] is message
        assert second.messages[0] is message

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
        sinks = readers(site, BUTTON)
        await site.settle()
        await asyncio.sleep(0.5)  # two heartbeats of the writer, which make Zenoh fetch old ones
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
        writer, other = site.a.publisher(PROFILE, "anna"), site.b.publisher(PROFILE, "ben")
        for seq in range(1, 4):
            writer.put(profile(seq))
            other.put(profile(10 * seq))
        await site.settle()
        sinks = readers(site, PROFILE)
        await until(lambda: all(set(sink.seen) >= {("anna", 3), ("ben", 30)} for sink in sinks))
        await asyncio.sleep(0.5)  # two heartbeats: whatever makes Zenoh fetch the same again
        assert [sorted(sink.seen) for sink in sinks] == [[("anna", 3), ("ben", 30)]] * 3, "each once"

    async def test_a_topic_without_names(self, site: Site) -> None:
        site.a.publisher(SELECTION).put(Selection(stamp_ns=1, seq=7))
        sink = Sink()
        site.b.subscribe(SELECTION, sink)
        await until(lambda: sink.seen == [("", 7)])

    async def test_a_writer_may_come_after_the_reader(self, site: Site) -> None:
        sinks = readers(site, PROFILE)
        await site.settle()
        site.a.publisher(PROFILE, "anna").put(profile(1))  # at once, before others know of it
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
            await until(lambda sink=sink: bool(sink.seen))
            await site.settle()
            assert sink.seen == [("ben", 2)]

    async def test_a_retired_writer_is_gone_from_everywhere_a_moment_later(self, site: Site) -> None:
        retired = site.a.publisher(PROFILE, "anna")
        retired.put(profile(1))
        retired.close_nowait()
        with pytest.raises(BusClosedError):
            retired.put(profile(2))
        await asyncio.sleep(RETIRED_S)
        for bus in site.buses:
            sink = Sink()
            bus.subscribe(PROFILE, sink)
            await site.settle()
            assert not sink.seen

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
    async def test_a_raising_handler_does_not_stop_others(
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
            await until(lambda seq=seq: sink.of("anna")[-1:] == other.of("anna")[-1:] == [seq])
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


class TestTap:
    async def test_every_message_comes_also_where_readers_get_the_newest_alone(self, site: Site) -> None:
        sinks = taps(site, IMU)
        writer = site.a.publisher(IMU, "anna")
        await reached(writer, *sinks)
        for seq in range(1, 101):
            writer.put(imu(seq))
        expected = [("anna", seq) for seq in range(1, 101)]
        await until(lambda: all(sink.seen[-100:] == expected for sink in sinks))

    async def test_states_from_before_come_once(self, site: Site) -> None:
        writer = site.a.publisher(PROFILE, "anna")
        writer.put(profile(1))
        await site.settle()
        sinks = taps(site, PROFILE)
        await until(lambda: all(sink.seen == [("anna", 1)] for sink in sinks))
        writer.put(profile(2))
        await until(lambda: all(sink.seen == [("anna", 1), ("anna", 2)] for sink in sinks))

    async def test_nothing_comes_after_it_is_closed(self, site: Site) -> None:
        closed, open_one = Sink(), Sink()
        tap = site.b.tap(IMU, tapped(closed), "anna")
        site.b.tap(IMU, tapped(open_one))
        writer = site.a.publisher(IMU, "anna")
        await reached(writer, closed, open_one)
        seen = len(closed.seen)
        tap.close()
        writer.put(imu(1000))
        await until(lambda: open_one.seen[-1:] == [("anna", 1000)])
        assert len(closed.seen) == seen
