"""Contract of every bus for states whose writers are gone: in memory, between peers, through a router."""

import asyncio
from collections.abc import Iterator

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import Message, Selection
from pointit.schemas.topics import IMU, POSE, PROFILE, SELECTION
from tests.support.bench import until
from tests.support.buses import Site
from tests.support.sinks import Sink, profile

TOPICS = (PROFILE, SELECTION)


class Shelf:
    """The retained states, by topic key and name."""

    def __init__(self, **profiles: int) -> None:
        self.values: dict[str, dict[str, Message]] = {
            PROFILE.key: {name: profile(seq) for name, seq in profiles.items()}
        }

    def __call__(self, topic: AnyTopic) -> Iterator[tuple[str, Message]]:
        yield from self.values.get(topic.key, {}).items()


def seen_by_all(sinks: list[Sink], *what: tuple[str, int]) -> bool:
    return all(sorted(sink.seen) == sorted(what) for sink in sinks)


def read(site: Site, name: str = "*") -> list[Sink]:
    sinks = [Sink() for _ in site.buses]
    for bus, sink in zip(site.buses, sinks, strict=True):
        bus.subscribe(PROFILE, sink, name)
    return sinks


async def test_a_late_reader_gets_what_is_kept(site: Site) -> None:
    site.a.serve_retained(TOPICS, Shelf(anna=3, ben=5))
    await site.settle()
    sinks = read(site)
    await until(lambda: seen_by_all(sinks, ("anna", 3), ("ben", 5)))
    one = read(site, "ben")
    await until(lambda: seen_by_all(one, ("ben", 5)))


async def test_a_topic_without_names_is_kept(site: Site) -> None:
    shelf = Shelf()
    shelf.values[SELECTION.key] = {"": Selection(stamp_ns=1, seq=7)}
    site.c.serve_retained(TOPICS, shelf)
    await site.settle()
    sinks = [Sink() for _ in site.buses]
    for bus, sink in zip(site.buses, sinks, strict=True):
        bus.subscribe(SELECTION, sink)
    await until(lambda: seen_by_all(sinks, ("", 7)))


async def test_readers_that_were_there_before_get_it_too(site: Site) -> None:
    sinks = read(site)
    await site.settle()
    site.b.serve_retained(TOPICS, Shelf(anna=3))
    await until(lambda: seen_by_all(sinks, ("anna", 3)))


async def test_a_living_writer_wins_over_what_is_kept(site: Site) -> None:
    writer = site.a.publisher(PROFILE, "anna")
    writer.put(profile(2))
    site.b.serve_retained(TOPICS, Shelf(anna=9, ben=1))  # even if its clock is ahead
    await site.settle()
    sinks = read(site)
    await until(lambda: all(sink.of("anna")[-1:] == [2] and sink.of("ben") == [1] for sink in sinks))
    await asyncio.sleep(0.3)
    assert all(sink.of("anna")[-1] == 2 for sink in sinks), "whichever came first"
    writer.put(profile(3))
    await until(lambda: all(sink.of("anna")[-1] == 3 for sink in sinks))


async def test_a_keeper_that_comes_again_says_nothing_old(site: Site) -> None:
    sinks = read(site)
    writer = site.a.publisher(PROFILE, "anna")
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
    sinks = read(site)
    await until(lambda: seen_by_all(sinks, ("anna", 2)))
    writer = site.b.publisher(PROFILE, "anna")
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
    sinks = read(site)
    await site.settle()
    await asyncio.sleep(0.3)
    assert seen_by_all(sinks)


async def test_only_retained_topics_are_delivered_and_only_on_request(site: Site) -> None:
    shelf = Shelf(anna=2)
    shelf.values[POSE.key] = shelf.values[IMU.key] = shelf.values[PROFILE.key]
    site.a.serve_retained(TOPICS, shelf)
    await site.settle()
    sinks = [Sink() for _ in site.buses]
    wanted = Sink()
    for bus, sink in zip(site.buses, sinks, strict=True):
        bus.subscribe(POSE, sink)
        bus.subscribe(IMU, sink)
        bus.subscribe(PROFILE, sink, kept=False)
    site.c.subscribe(PROFILE, wanted)
    await until(lambda: seen_by_all([wanted], ("anna", 2)))
    assert seen_by_all(sinks)
