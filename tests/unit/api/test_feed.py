"""Iterators over topics, on a bus in memory."""

import asyncio
import gc
import weakref
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from pointit.api import feed
from pointit.api.site import Site
from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import AccessDeniedError, BusClosedError, NoMessageError, VersionError
from pointit.schemas import Cursor, KeyNameError, Selection, SelectionEvent, UserPose
from pointit.schemas.topics import ANY, CURSOR, POSE, SELECTION, SELECTION_EVENTS, USER_ALIVE, Presence
from tests.support.bench import until


@pytest_asyncio.fixture
async def bus() -> AsyncIterator[MemoryBus]:
    bus = MemoryBus()
    yield bus
    await bus.close()


@pytest_asyncio.fixture
async def site(bus: MemoryBus) -> AsyncIterator[Site]:
    async with Site.on(bus, WallClock()) as site:
        yield site


@pytest.fixture
def denied(bus: MemoryBus, monkeypatch: pytest.MonkeyPatch) -> None:
    """Deny everything."""

    async def deny(verb: str, topic: AnyTopic, name: str) -> str:
        return f"{verb} {topic.at(name)}"

    monkeypatch.setattr(bus, "denial_reason", deny)
    monkeypatch.setattr(MemoryBus, "is_restricted", True)


def put_cursor(bus: MemoryBus, user: str, seq: int) -> None:
    bus.publisher(CURSOR, user).put(Cursor(stamp_ns=seq, seq=seq))


def put_event(bus: MemoryBus, object_id: str, user: str = "anna") -> None:
    event = SelectionEvent(stamp_ns=1, event="selected", object_id=object_id, user=user)
    bus.publisher(SELECTION_EVENTS).put(event)


async def test_a_slow_loop_gets_the_newest_cursor_of_each_person(bus: MemoryBus, site: Site) -> None:
    cursors = site.cursors()
    for seq in (1, 2, 3):
        put_cursor(bus, "anna", seq)
        put_cursor(bus, "ben", 10 * seq)
        await asyncio.sleep(0)
    found = [(user, cursor.seq) async for user, cursor in cursors.items().during(0)]
    assert found == [("anna", 3), ("ben", 30)]
    assert cursors.lost == 0


async def test_of_one_person_no_others_come(bus: MemoryBus, site: Site) -> None:
    cursors = site.cursors("ben")
    put_cursor(bus, "anna", 1)
    put_cursor(bus, "ben", 2)
    assert (await anext(cursors)).seq == 2
    with pytest.raises(KeyNameError, match="user 'an na': use 1 to 64 letters"):
        site.cursors("an na")


async def test_every_event_comes_in_order(bus: MemoryBus, site: Site) -> None:
    everybodys, annas = site.selections(), site.selections("anna")
    for number in range(5):
        put_event(bus, str(number), user="anna" if number % 2 else "ben")
    await asyncio.sleep(0)
    assert [event.object_id async for event in everybodys.during(0)] == ["0", "1", "2", "3", "4"]
    assert [event.object_id async for event in annas.during(0)] == ["1", "3"]


async def test_events_that_nobody_takes_are_counted(
    bus: MemoryBus, site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    events = site.selections()
    for number in range(EVENT_CAPACITY + 7):
        put_event(bus, str(number))
        await asyncio.sleep(0)
    assert events.lost == 7
    assert (await anext(events)).object_id == "7"
    assert "the oldest ones are lost" in caplog.text


async def test_a_loop_ends_after_its_duration(bus: MemoryBus, site: Site) -> None:
    async def slowly() -> list[int]:
        found: list[int] = []
        async for cursor in site.cursors().during(0.05):
            found.append(cursor.seq)
            put_cursor(bus, "anna", cursor.seq + 1)  # never runs out
        return found

    taking = asyncio.create_task(slowly())
    await asyncio.sleep(0)
    put_cursor(bus, "anna", 1)
    async with asyncio.timeout(30):
        assert await taking


async def test_the_end_of_the_site_ends_waiting_loops_and_forbids_new_ones(bus: MemoryBus) -> None:
    async with Site.on(bus, WallClock()) as site:

        async def take() -> list[Cursor]:
            return [cursor async for cursor in site.cursors()]

        taking = asyncio.create_task(take())
        await asyncio.sleep(0)
    assert await taking == []
    with pytest.raises(BusClosedError, match="the site is closed"):
        site.cursors()
    with pytest.raises(BusClosedError, match="the site is closed"):
        await site.select.undo("anna")
    with pytest.raises(BusClosedError, match="the site is closed"):
        site.tracker("camera")


async def test_a_failure_reaches_all_loops_behind_what_came_before(bus: MemoryBus, site: Site) -> None:
    events = site.selections()
    put_event(bus, "1")
    await asyncio.sleep(0)
    site.fail(ValueError("broken"))
    assert (await anext(events)).object_id == "1"
    with pytest.raises(ValueError, match="broken"):
        await anext(events)


async def test_who_is_no_longer_iterated_over_is_unsubscribed(bus: MemoryBus, site: Site) -> None:
    readers = bus.exchange.readers_of(CURSOR)
    cursors = site.cursors()
    assert len(readers) == 1
    del cursors
    gc.collect()
    put_cursor(bus, "anna", 1)
    await until(lambda: len(readers) == 0, what="the reader to leave")
    closed = site.cursors()
    closed.close()
    assert len(readers) == 0
    assert [cursor async for cursor in closed] == []


@pytest.mark.parametrize("user", ["anna", None])
async def test_unreadable_messages_end_only_a_loop_over_one_person(
    bus: MemoryBus,
    site: Site,
    user: str | None,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(feed, "UNREADABLE_TIMEOUT_S", 0.01)
    cursors = site.cursors(user)
    assert cursors._buffer.source is not None
    cursors._buffer.source.traffic.invalid = 1
    taking = asyncio.create_task(anext(cursors))
    await asyncio.sleep(0.1)
    assert not taking.done()  # a stray one
    cursors._buffer.source.traffic.invalid = 7
    if user is not None:
        with pytest.raises(VersionError, match="7 messages came and none could be read"):
            await taking
        return
    await until(lambda: "7 messages came" in caplog.text, what="a warning")
    put_cursor(bus, "anna", 1)
    assert (await taking).seq == 1


@pytest.mark.usefixtures("denied")
async def test_a_denied_loop_receives_nothing_more(bus: MemoryBus, site: Site) -> None:
    with pytest.raises(AccessDeniedError, match="reads users/anna/cursor"):
        await anext(site.cursors("anna"))
    assert len(bus.exchange.readers_of(CURSOR)) == 0


async def test_people_are_told_at_once_and_on_each_change(bus: MemoryBus) -> None:
    anna = bus.announce(USER_ALIVE, "anna")
    async with Site.on(bus, WallClock()) as site:
        people = site.people()
        assert await anext(people) == {"anna"}
        bus.announce(USER_ALIVE, "ben")
        assert await anext(people) == {"anna", "ben"}
        anna.close()
        assert await anext(people) == {"ben"}
        assert await anext(site.people()) == {"ben"}


async def test_who_leaves_while_people_are_listed_is_gone(
    bus: MemoryBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    anna = bus.announce(USER_ALIVE, "anna")
    bus.announce(USER_ALIVE, "ben")
    list_present = bus.list_present

    async def slowly(presence: Presence) -> set[str]:
        listed = await list_present(presence)
        anna.close()
        bus.announce(USER_ALIVE, "cleo")
        await asyncio.sleep(0.01)
        return listed

    monkeypatch.setattr(bus, "list_present", slowly)
    async with Site.on(bus, WallClock()) as site:
        assert await anext(site.people()) == {"ben", "cleo"}


async def test_a_closed_tracker_is_not_kept(site: Site) -> None:
    tracker = site.tracker("camera")
    closed = weakref.ref(tracker)
    tracker.close()
    del tracker
    gc.collect()
    assert closed() is None


async def test_the_latest_is_kept_from_the_first_use_on(bus: MemoryBus, site: Site) -> None:
    poses = bus.publisher(POSE, "anna")
    poses.put(UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    with pytest.raises(NoMessageError) as raised:
        _ = site.latest.pose["anna"]
    assert str(raised.value).startswith("nothing has come on users/anna/pose yet")
    assert (await site.latest.pose.wait("anna")).stamp_ns == 1
    poses.put(UserPose(stamp_ns=2, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    await until(lambda: site.latest.pose["anna"].stamp_ns == 2, what="the newer pose")
    assert dict(site.latest.pose).keys() == {"anna"}
    assert site.latest.pose.get("ben") is None
    with pytest.raises(NoMessageError, match=r"nothing came on users/ben/pose within 0\.01 s"):
        await site.latest.pose.wait("ben", patience_s=0.01)
    with pytest.raises(NoMessageError, match="nothing has come on selection yet"):
        _ = site.latest.selection.value
    bus.publisher(SELECTION).put(Selection(stamp_ns=1))
    assert (await site.latest.selection.wait()).stamp_ns == 1 == site.latest.selection.value.stamp_ns


async def test_the_latest_ends_with_the_site(bus: MemoryBus, site: Site) -> None:
    bus.publisher(POSE, "anna").put(UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    poses = site.latest.pose
    assert (await poses.wait("anna")).stamp_ns == 1
    sleeping = asyncio.create_task(site.sleep(3600.0))
    await asyncio.sleep(0)
    site.fail(ValueError("broken"))
    for use in (
        lambda: poses["anna"],
        lambda: poses.get("ben"),
        lambda: dict(poses),
        lambda: site.latest.map.value,
    ):
        with pytest.raises(ValueError, match="broken"):
            use()
    with pytest.raises(ValueError, match="broken"):
        await poses.wait("anna")
    with pytest.raises(ValueError, match="broken"):
        await sleeping


async def test_the_latest_says_that_nothing_can_be_read(site: Site) -> None:
    rays = site.latest.ray
    assert len(rays) == 0
    rays._subscriptions[ANY].traffic.invalid = 3
    with pytest.raises(VersionError, match="3 messages came and none could be read"):
        await rays.wait("anna", patience_s=0.01)


@pytest.mark.usefixtures("denied")
async def test_the_latest_says_that_nothing_may_be_read(site: Site) -> None:
    with pytest.raises(AccessDeniedError, match="reads users/anna/ray"):
        await site.latest.ray.wait("anna", patience_s=0.01)
