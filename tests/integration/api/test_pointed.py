"""Functions and loops of programs that react when somebody points at a thing."""

import asyncio
import threading
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from pointit.api.site import Site
from pointit.errors import ConfigError
from pointit.maps.file import load_map
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.schemas import SelectionEvent
from pointit.schemas.topics import MAP, SELECTION_EVENTS
from tests.support.bench import until


@asynccontextmanager
async def shelf() -> AsyncGenerator[tuple[Site, MemoryBus]]:
    """Yield a site whose map is `shelf`, and its bus."""
    bus = MemoryBus()
    bus.publisher(MAP).put(load_map("shelf", 0))
    try:
        async with Site.on(bus, WallClock()) as site:
            yield site, bus
    finally:
        await bus.close()


def fired(bus: MemoryBus, thing: str, event: str = "selected", cause: str = "dwell", seq: int = 1) -> None:
    message = {"stamp_ns": 1, "seq": seq, "event": event, "object_id": thing, "user": "anna", "cause": cause}
    bus.publisher(SELECTION_EVENTS).put(SelectionEvent.model_validate(message))


async def test_events_are_those_of_the_things_and_of_what_somebody_did() -> None:
    async with shelf() as (site, bus):
        some, every = site.pointed("screws", "radio"), site.pointed()
        await site.latest.map.wait()
        for thing, event, cause in (
            ("screws", "selected", "dwell"),
            ("screws", "deselected", ""),  # the button is over
            ("nuts", "selected", "dwell"),
            ("package-7", "selected", "dwell"),
            ("radio", "selected", "dwell"),
            ("radio", "refused", "dwell"),
            ("radio", "deselected", "dwell"),
        ):
            fired(bus, thing, event, cause)
        everything = [
            ("screws", "selected"),
            ("nuts", "selected"),
            ("radio", "selected"),
            ("radio", "deselected"),
        ]
        async with asyncio.timeout(30.0):
            found = [await anext(every) for _ in everything]
            chosen = [await anext(some) for _ in everything[1:]]
        assert [(event.object_id, event.event) for event in found] == everything
        assert chosen == [event for event in found if event.object_id != "nuts"]


async def test_functions_are_called_and_one_that_fails_or_hangs_harms_no_other(
    caplog: pytest.LogCaptureFixture,
) -> None:
    called: list[str] = []
    hanging = threading.Event()
    async with shelf() as (site, bus):

        @site.on_pointed("screws")
        def hangs(_event: SelectionEvent) -> None:
            hanging.wait()

        @site.on_pointed("screws")
        def fails(_event: SelectionEvent) -> None:
            raise ZeroDivisionError

        @site.on_pointed("screws")
        async def works(event: SelectionEvent) -> None:
            await asyncio.sleep(0)
            called.append(f"{event.user} {event.object_id}")

        @site.on_pointed()
        def plain(event: SelectionEvent) -> None:
            called.append(event.object_id)

        await site.latest.map.wait()
        for seq in range(12):  # more than run at once
            fired(bus, "screws", seq=seq)
        try:
            await until(lambda: len(called) >= 2 * 8)
            await until(lambda: "left out screws" in caplog.text and "fails failed for screws" in caplog.text)
        finally:
            hanging.set()
    assert min(called.count("anna screws"), called.count("screws")) >= 8


async def test_a_name_that_the_map_lacks_is_refused_with_those_that_are_similar() -> None:
    async with shelf() as (site, _):
        with pytest.raises(ConfigError, match=r"the map has no thing 'scews'; did you mean screws\?"):
            await anext(site.pointed("scews"))
