"""Topics and presence: what every bus must do."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic, Bus, list_present
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import BusClosedError
from pointit.schemas import ButtonEvent, KeyNameError, Message, Selection, SetBrightness, topics
from pointit.schemas.topics import BUTTON, IMU, PROFILE, SELECTION, USER_ALIVE, Topic
from tests.contract.readers import SlowServer, readers, rolls, tapped, taps
from tests.support.bench import until
from tests.support.buses import Site
from tests.support.sinks import Roll, Sink, imu, press, profile, reached

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
        one = Sink()
        everyone = Sink()
        site.b.subscribe(IMU, one, "anna")
        site.b.subscribe(IMU, everyone)
        anna = site.a.publisher(IMU, "anna")
        ben = site.a.publisher(IMU, "ben")
        await reached(anna, one, everyone)
        await reached(ben, everyone)  # anna's may have come by the subscription to her name alone
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
        first = Sink()
        second = Sink()
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
    async def test_messages_arrive_in_order_at_all_readers(self, site: Site) -> None:
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
        gone = site.a.publisher(PROFILE, "anna")
        stays = site.a.publisher(PROFILE, "ben")
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
        first = site.a.publisher(PROFILE, "anna")
        second = site.b.publisher(PROFILE, "anna")
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

        sink = Sink()
        other = Sink()
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

    async def test_handler_never_runs_after_its_subscription_is_closed(self, site: Site) -> None:
        closed = Sink()
        open_ = Sink()
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

    async def test_closed_tap_gets_nothing(self, site: Site) -> None:
        closed = Sink()
        open_one = Sink()
        writer = site.a.publisher(IMU, "anna")
        site.b.tap(IMU, tapped(open_one))
        await reached(writer, open_one)  # not by the subscription that is closed
        tap = site.b.tap(IMU, tapped(closed), "anna")
        await reached(writer, closed, open_one)
        seen = len(closed.seen)
        tap.close()
        writer.put(imu(1000))
        await until(lambda: open_one.seen[-1:] == [("anna", 1000)])
        assert len(closed.seen) == seen


class TestPresence:
    async def test_now_later_and_gone(self, site: Site) -> None:
        await site.settle()  # peers that are still finding each other may lose a token that comes and goes
        site.a.announce(topics.USER_ALIVE, "anna")
        watchers = rolls(site)
        await until(lambda: all(roll.told == [("anna", True)] for roll in watchers))
        ben = site.b.announce(topics.USER_ALIVE, "ben")
        await until(lambda: all(roll.told[1:] == [("ben", True)] for roll in watchers))
        ben.close()
        ben.close()

        def told() -> str:
            return f"ben is gone; {[roll.told for roll in watchers]}"

        await until(lambda: all(roll.told[2:] == [("ben", False)] for roll in watchers), what=told)

    async def test_a_bus_that_closes_is_gone(self, site: Site) -> None:
        roll = Roll()
        site.a.watch(topics.USER_ALIVE, roll)
        site.c.announce(topics.USER_ALIVE, "anna")
        await until(lambda: roll.told == [("anna", True)])
        await site.c.close()
        await until(lambda: roll.told[1:] == [("anna", False)])

    async def test_two_under_one_name_are_gone_with_the_last(self, site: Site) -> None:
        watchers = rolls(site)
        tokens = [bus.announce(topics.USER_ALIVE, "anna") for bus in (site.a, site.a, site.b)]
        await until(lambda: all(roll.told == [("anna", True)] for roll in watchers))
        await site.settle()  # "anna" is told by the first token alone: the third may still be on its way
        for token in tokens[:2]:
            token.close()
        await site.settle()
        assert [roll.told for roll in watchers] == [[("anna", True)]] * 3
        tokens[2].close()
        await until(lambda: all(roll.told[1:] == [("anna", False)] for roll in watchers))

    async def test_a_raising_watcher_is_logged(self, site: Site, caplog: pytest.LogCaptureFixture) -> None:
        def fail(_name: str, **_: bool) -> None:
            raise RuntimeError("broken watcher")

        roll = Roll()
        site.b.watch(topics.USER_ALIVE, fail)
        site.b.watch(topics.USER_ALIVE, roll)
        for name in ("anna", "ben"):
            site.a.announce(topics.USER_ALIVE, name)
        await until(lambda: len(roll.told) == 2)
        await until(lambda: sum("watcher of alive/users" in r.message for r in caplog.records) == 2)
        assert all(record.exc_info for record in caplog.records if "watcher" in record.message)

    async def test_a_closed_watcher_reports_nothing(self, site: Site) -> None:
        roll = Roll()
        other = Roll()
        watching = site.b.watch(topics.USER_ALIVE, roll)
        site.b.watch(topics.USER_ALIVE, other)
        site.a.announce(topics.USER_ALIVE, "anna")
        await until(lambda: bool(roll.told))
        watching.close()
        watching.close()
        site.a.announce(topics.USER_ALIVE, "ben")
        await until(lambda: len(other.told) == 2)
        assert roll.told == [("anna", True)]


class TestClose:
    async def test_closed_bus_does_nothing(self, site: Site) -> None:
        sink = Sink()
        roll = Roll()
        alive = Sink()
        latest = site.b.publisher(topics.IMU, "anna")
        event = site.b.publisher(topics.BUTTON, "anna")
        state = site.b.publisher(topics.PROFILE, "anna")
        site.b.subscribe(topics.BUTTON, sink)
        site.b.watch(topics.USER_ALIVE, roll)
        site.c.subscribe(topics.BUTTON, alive)
        writer = site.a.publisher(topics.BUTTON, "ben")
        await site.settle()
        for seq in range(50):
            writer.put(press(seq))
        closing = asyncio.create_task(site.b.close())
        await asyncio.sleep(0)
        told = (list(sink.seen), list(roll.told))
        await closing
        site.a.announce(topics.USER_ALIVE, "carl")

        writer.put(press(50))
        await until(lambda: alive.of("ben")[-1:] == [50])
        assert (sink.seen, roll.told) == told

        uses: tuple[Callable[[], object], ...] = (
            lambda: latest.put(imu(1)),
            lambda: event.put(press(1)),
            lambda: state.put(profile(1)),
            lambda: site.b.publisher(topics.IMU, "anna"),
            lambda: site.b.subscribe(topics.IMU, sink),
            lambda: site.b.announce(topics.USER_ALIVE, "anna"),
            lambda: site.b.watch(topics.USER_ALIVE, roll),
        )
        for use in uses:
            with pytest.raises(BusClosedError):
                use()
        with pytest.raises(BusClosedError):
            await site.b.call(topics.SET_BRIGHTNESS, SetBrightness(brightness=1))

    async def test_closing_twice_and_closing_what_is_closed_is_fine(self, site: Site) -> None:
        declared = [
            site.b.publisher(topics.IMU, "anna"),
            site.b.subscribe(topics.IMU, Sink()),
            site.b.serve(topics.SET_BRIGHTNESS, SlowServer()),
            site.b.announce(topics.USER_ALIVE, "anna"),
            site.b.watch(topics.USER_ALIVE, Roll()),
        ]
        declared[0].close()
        with pytest.raises(BusClosedError):
            declared[0].put(imu(1))  # pyrefly: ignore[missing-attribute]
        await asyncio.gather(site.b.close(), site.b.close())
        await site.b.close()
        for one in declared:
            one.close()

    async def test_calls_that_wait_end_with_their_bus(self, site: Site) -> None:
        slow = SlowServer()
        site.a.serve(topics.SET_BRIGHTNESS, slow)
        query = SetBrightness(brightness=1)
        call = asyncio.create_task(site.b.call(topics.SET_BRIGHTNESS, query, timeout_s=60))
        async with asyncio.timeout(60):
            await slow.asked.wait()
        began_s = time.monotonic()
        await site.b.close()
        with pytest.raises(BusClosedError):
            await call
        assert time.monotonic() - began_s < 30

    async def test_the_bus_has_no_trouble(self, site: Site, caplog: pytest.LogCaptureFixture) -> None:
        assert [bus.problem for bus in site.buses] == [""] * 3
        buses: tuple[Bus, ...] = site.buses
        for bus in reversed(buses):  # the one that the others are connected to comes last
            await bus.close()
        assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


class TestPresent:
    async def test_list_present_returns_the_present_names(self, site: Site) -> None:
        tokens = [bus.announce(topics.USER_ALIVE, name) for bus, name in ((site.a, "anna"), (site.b, "ben"))]
        site.a.announce(topics.SERVICE_ALIVE, "pui")
        await site.settle()
        assert isinstance(site.c, MemoryBus)
        declared = set(site.c.declarations)
        assert await list_present(site.c, topics.USER_ALIVE, 1.0) == {"anna", "ben"}
        assert set(site.c.declarations) == declared, "it watches no longer"
        tokens[0].close()
        await site.settle()
        asked = (list_present(bus, topics.USER_ALIVE, 1.0) for bus in site.buses)
        assert await asyncio.gather(*asked) == [{"ben"}] * 3


TOPICS = (topics.PROFILE, topics.SELECTION)


class Shelf:
    """The retained states, by topic key and name."""

    def __init__(self, **profiles: int) -> None:
        self.values: dict[str, dict[str, Message]] = {
            topics.PROFILE.key: {name: profile(seq) for name, seq in profiles.items()}
        }

    def __call__(self, topic: AnyTopic) -> Iterator[tuple[str, Message]]:
        yield from self.values.get(topic.key, {}).items()


def seen_by_all(sinks: list[Sink], *what: tuple[str, int]) -> bool:
    return all(sorted(sink.seen) == sorted(what) for sink in sinks)


async def test_a_late_reader_gets_what_is_kept(site: Site) -> None:
    site.a.serve_retained(TOPICS, Shelf(anna=3, ben=5))
    await site.settle()
    sinks = readers(site, topics.PROFILE)
    await until(lambda: seen_by_all(sinks, ("anna", 3), ("ben", 5)))
    one = readers(site, topics.PROFILE, "ben")
    await until(lambda: seen_by_all(one, ("ben", 5)))


async def test_readers_that_were_there_before_get_it_too(site: Site) -> None:
    sinks = readers(site, topics.PROFILE)
    await site.settle()
    site.b.serve_retained(TOPICS, Shelf(anna=3))
    await until(lambda: seen_by_all(sinks, ("anna", 3)))


async def test_a_living_writer_wins_over_what_is_kept(site: Site) -> None:
    writer = site.a.publisher(topics.PROFILE, "anna")
    writer.put(profile(2))
    site.b.serve_retained(TOPICS, Shelf(anna=9, ben=1))  # even if its clock is ahead
    await site.settle()
    sinks = readers(site, topics.PROFILE)
    await until(lambda: all(sink.of("anna")[-1:] == [2] and sink.of("ben") == [1] for sink in sinks))
    await asyncio.sleep(0.3)
    assert all(sink.of("anna")[-1] == 2 for sink in sinks), "whichever came first"
    writer.put(profile(3))
    await until(lambda: all(sink.of("anna")[-1] == 3 for sink in sinks))


async def test_a_keeper_that_comes_again_says_nothing_old(site: Site) -> None:
    sinks = readers(site, topics.PROFILE)
    writer = site.a.publisher(topics.PROFILE, "anna")
    writer.put(profile(2))
    await until(lambda: seen_by_all(sinks, ("anna", 2)))
    writer.close()
    kept = site.b.serve_retained(TOPICS, Shelf(anna=2, ben=4))
    await until(lambda: seen_by_all(sinks, ("anna", 2), ("ben", 4)))
    kept.close()
    await site.settle()
    site.b.serve_retained(TOPICS, Shelf(anna=1, ben=4))
    site.c.serve_retained(TOPICS, Shelf(ben=3, cleo=1))
    await until(lambda: seen_by_all(sinks, ("anna", 2), ("ben", 4), ("cleo", 1)))


async def test_a_retained_value_that_is_then_published_is_handled_once(site: Site) -> None:
    site.a.serve_retained(TOPICS, Shelf(anna=2))
    await site.settle()
    sinks = readers(site, topics.PROFILE)
    await until(lambda: seen_by_all(sinks, ("anna", 2)))
    writer = site.b.publisher(topics.PROFILE, "anna")
    writer.put(profile(2))
    writer.put(profile(3))
    await until(lambda: all(sink.of("anna")[-1] == 3 for sink in sinks))
    assert all(sink.of("anna").count(2) == 1 for sink in sinks)


async def test_a_closed_keeper_delivers_nothing(site: Site) -> None:
    kept = site.a.serve_retained(TOPICS, Shelf(anna=2))
    await site.settle()
    kept.close()
    kept.close()
    await site.settle()
    sinks = readers(site, topics.PROFILE)
    await site.settle()
    await asyncio.sleep(0.3)
    assert seen_by_all(sinks)


async def test_only_retained_topics_are_delivered_and_only_on_request(site: Site) -> None:
    shelf = Shelf(anna=2)
    shelf.values[topics.POSE.key] = shelf.values[topics.IMU.key] = shelf.values[topics.PROFILE.key]
    site.a.serve_retained(TOPICS, shelf)
    await site.settle()
    sinks = [Sink() for _ in site.buses]
    wanted = Sink()
    for bus, sink in zip(site.buses, sinks, strict=True):
        bus.subscribe(topics.POSE, sink)
        bus.subscribe(topics.IMU, sink)
        bus.subscribe(topics.PROFILE, sink, retained=False)
    site.c.subscribe(topics.PROFILE, wanted)
    await until(lambda: seen_by_all([wanted], ("anna", 2)))
    assert seen_by_all(sinks)
