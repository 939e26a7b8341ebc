"""Iterators over topics, on a bus in memory."""

import asyncio
import gc

import pytest

from pointit.api import feed
from pointit.api.site import Site
from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import AccessDeniedError, BusClosedError, NoAnswerError, VersionError
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import Cursor, Done, KeyNameError, SelectionEvent, SetSpeed, TrackedObject
from pointit.schemas.topics import CURSOR, POSE, SELECTION_EVENTS, SET_SPEED, USER_ALIVE, Presence
from tests.support.bench import until

pytestmark = pytest.mark.wall_time


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
    found = [(user, cursor.seq) async for user, cursor in cursors.during(0).items()]
    assert found == [("anna", 3), ("ben", 30)]
    assert cursors.lost == 0


async def test_feed_of_one_person_has_no_others(bus: MemoryBus, site: Site) -> None:
    cursors = site.cursors("ben")
    put_cursor(bus, "anna", 1)
    put_cursor(bus, "ben", 2)
    assert (await anext(cursors)).seq == 2
    with pytest.raises(KeyNameError, match="user 'an na': use 1 to 64 letters"):
        site.cursors("an na")


async def test_every_event_comes_in_order(bus: MemoryBus, site: Site) -> None:
    everybodys = site.selections()
    annas = site.selections("anna")
    for number in range(5):
        put_event(bus, str(number), user="anna" if number % 2 else "ben")
    await asyncio.sleep(0)
    assert [event.object_id async for event in everybodys.during(0)] == ["0", "1", "2", "3", "4"]
    assert [event.object_id async for event in annas.during(0)] == ["1", "3"]


async def test_events_nobody_takes_count(
    bus: MemoryBus, site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    events = site.selections()
    for number in range(EVENT_CAPACITY + 7):
        put_event(bus, str(number))
        await asyncio.sleep(0)
    assert events.lost == 7
    assert events._buffer.source is not None
    events._buffer.source.traffic.lost = 2  # on the way
    assert events.lost == 9
    assert (await anext(events)).object_id == "7"
    assert "the oldest ones are lost" in caplog.text


async def test_closed_site_ends_waiting_loops_and_forbids_new_ones(bus: MemoryBus) -> None:
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


async def test_dropped_feed_is_unsubscribed(bus: MemoryBus, site: Site) -> None:
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


@pytest.fixture
def _quick_to_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed, "UNREADABLE_TIMEOUT_S", 0.01)


@pytest.mark.usefixtures("_quick_to_doubt")
@pytest.mark.parametrize(
    ("row", "strays"),
    [((CURSOR, "anna"), 3), ((POSE, "anna"), 0), ((CURSOR, None), 3), ((SELECTION_EVENTS, None), 3)],
    ids=["one person's", "one state", "everybody's", "events"],
)
async def test_unreadable_messages_end_a_loop_over_one_writer_only(
    bus: MemoryBus,
    site: Site,
    row: tuple[AnyTopic, str | None],
    strays: int,
    caplog: pytest.LogCaptureFixture,
) -> None:
    messages = site.messages(*row)
    assert messages._buffer.source is not None
    traffic = messages._buffer.source.traffic
    traffic.invalid = strays
    taking = asyncio.create_task(anext(messages))
    await asyncio.sleep(0.1)

    assert not taking.done()
    traffic.invalid += 1
    sentence = f"{traffic.invalid} messages came and none could be read"
    if row[1] is not None:
        with pytest.raises(VersionError, match=sentence):
            await taking
        return

    await until(lambda: sentence in caplog.text, what="a warning")
    put_cursor(bus, "anna", 1)
    put_event(bus, "1")
    assert (await taking).schema_name().startswith(row[0].message.__name__)


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


async def test_person_who_leaves_during_the_listing_is_absent(
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


async def test_objects_leave_with_the_site_that_tracks_them(bus: MemoryBus, site: Site) -> None:
    things = site.objects()
    async with Site.on(bus, WallClock()) as tracking:
        tracking.tracker("camera").update([TrackedObject(id="cup", kind="red", position_m=(1.0, 2.0, 0.8))])
        first = await anext(things)
    last = await anext(things)
    assert [(list(each.objects) != [], each.seq) for each in (first, last)] == [(True, 1), (False, 2)]


class FastClock(VirtualClock):
    speed = 4.0


def test_durations_follow_site_time_but_time_limits_do_not() -> None:
    async def never(_query: SetSpeed, _name: str) -> Done:
        await asyncio.Event().wait()
        raise AssertionError

    async def main() -> list[float]:
        bus = MemoryBus()
        loop = asyncio.get_running_loop()
        bus.serve(SET_SPEED, never)
        async with Site.on(bus, FastClock()) as site:
            await site.sleep(8.0)
            ends_s = [loop.time()]
            assert [cursor async for cursor in site.cursors().during(8.0)] == []

            ends_s.append(loop.time())
            with pytest.raises(NoAnswerError):
                await site.call(SET_SPEED, SetSpeed(speed_mps=0.1), timeout_s=7.0)

            ends_s.append(loop.time())
            with pytest.raises(NoAnswerError):
                await site.conveyor.set_speed(0.1, belts=["a list"])
        await bus.close()
        return ends_s

    assert run_virtually(main()) == [2.0, 4.0, 11.0]
