"""Readers, taps, watchers and a slow server for the participants of a site."""

import asyncio

from pointit.runtime.bus.contract import AnyTopic, Tap, Undecoded
from pointit.schemas import Done, Message, Query
from pointit.schemas.topics import ANY, USER_ALIVE
from tests.support.buses import Site
from tests.support.sinks import Roll, Sink


def readers(site: Site, topic: AnyTopic, name: str = ANY) -> list[Sink]:
    """Return a reader of `topic` at each participant."""
    sinks = [Sink() for _ in site.buses]
    for bus, sink in zip(site.buses, sinks, strict=True):
        bus.subscribe(topic, sink, name)
    return sinks


def taps(site: Site, topic: AnyTopic) -> list[Sink]:
    """Return a tap of `topic` at each participant."""
    sinks = [Sink() for _ in site.buses]
    for bus, sink in zip(site.buses, sinks, strict=True):
        bus.tap(topic, tapped(sink))
    return sinks


def tapped(sink: Sink) -> Tap:
    """Return a handler that decodes at once, on whatever thread it is."""

    def take(arrived: Message | Undecoded, name: str) -> None:
        sink(arrived if isinstance(arrived, Message) else arrived.decode(), name)

    return take


def rolls(site: Site) -> list[Roll]:
    """Return a watcher of people at each participant."""
    made = [Roll() for _ in site.buses]
    for bus, roll in zip(site.buses, made, strict=True):
        bus.watch(USER_ALIVE, roll)
    return made


class SlowServer:
    """Answers when `go_on` is set."""

    def __init__(self) -> None:
        self.asked, self.go_on, self.done = asyncio.Event(), asyncio.Event(), asyncio.Event()

    async def __call__(self, _query: Query, _name: str) -> Done:
        self.asked.set()
        await self.go_on.wait()
        self.done.set()
        return Done()
