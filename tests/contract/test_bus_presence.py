"""Contract of every bus for presence, its end, and states whose writers are gone."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterator

import pytest

from pointit.runtime.bus.contract import AnyTopic, Bus, list_present
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import BusClosedError
from pointit.schemas import Message, SetBrightness, topics
from tests.contract.readers import SlowServer, readers, rolls
from tests.support.bench import until
from tests.support.buses import Site
from tests.support.sinks import Roll, Sink, imu, press, profile


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
        def fail(_name: str, _present: bool) -> None:  # noqa: FBT001
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
        roll, other = Roll(), Roll()
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
    async def test_nothing_works_and_nothing_runs_afterwards(self, site: Site) -> None:
        sink, roll, alive = Sink(), Roll(), Sink()
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
