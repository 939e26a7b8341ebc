"""A tracker of a script states its latency and its frame."""

import contextlib
from collections.abc import Generator

import pytest

from pointit.api.site import Site
from pointit.api.tracker import Tracker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import ConfigError, NoMessageError
from pointit.schemas import Environment, TrackedObject, TrackedObjects
from pointit.schemas.environment import Frame
from pointit.schemas.topics import MAP, OBJECTS
from tests.support.bench import until

ROOM = Environment(stamp_ns=1, name="room", frames=(Frame(id="optitrack", position_m=(1.0, 2.0, 0.0)),))
CUP = TrackedObject(id="cup", kind="red", position_m=(0.5, 0.0, 1.0), position_sigma_m=0.02)


@pytest.fixture
def heard(bus: MemoryBus) -> list[TrackedObjects]:
    heard: list[TrackedObjects] = []
    bus.subscribe(OBJECTS, lambda message, _name: heard.append(message))
    return heard


@contextlib.contextmanager
def tracked(site: Site, **how: float | str | None) -> Generator[Tracker]:
    with contextlib.closing(site.tracker("camera", **how)) as tracker:  # type: ignore[arg-type]
        yield tracker


async def test_known_latency_corrects_the_stamp_and_its_sigma_is_sent(
    site: Site, heard: list[TrackedObjects]
) -> None:
    with tracked(site, latency_s=10.0, latency_sigma_s=0.02) as tracker:
        tracker.update([CUP])
        await until(lambda: len(heard) == 1, what="the first message")
        tracker.update([CUP], stamp_ns=5)
        await until(lambda: len(heard) == 2, what="the second message")
    assert heard[0].latency_sigma_s == 0.02
    assert 9.9e9 < site.now_ns() - heard[0].stamp_ns < 20e9
    assert heard[1].stamp_ns == 5
    assert heard[1].objects == (CUP,)


async def test_places_in_a_frame_are_sent_in_the_room(
    bus: MemoryBus, site: Site, heard: list[TrackedObjects]
) -> None:
    with tracked(site, frame="optitrack") as tracker:
        with pytest.raises(NoMessageError, match="nothing has come on map yet"):
            tracker.update([CUP])
        bus.publisher(MAP).put(ROOM)
        await site.latest.map.wait()
        tracker.update([CUP])
        await until(lambda: len(heard) == 1, what="the objects")
    assert heard[0].objects[0].position_m == (1.5, 2.0, 1.0)
    assert heard[0].objects[0].position_sigma_m == 0.02


async def test_a_frame_that_the_map_has_not_is_an_error(bus: MemoryBus, site: Site) -> None:
    bus.publisher(MAP).put(ROOM)
    await site.latest.map.wait()
    with (
        tracked(site, frame="slam") as tracker,
        pytest.raises(ConfigError, match="the map room has no frame 'slam'; it has optitrack"),
    ):
        tracker.update([CUP])
