"""Limits of incoming requests, which are handled a slice of time per turn, and of names of a reader."""

import asyncio
import contextlib
import threading
import time
from collections.abc import Iterator

import msgpack
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.zenoh.declarations import decoded, encoding_of
from pointit.runtime.zenoh.queries import MAX_WAITING, SHOWN_S, SLICE_S, BoundedWorkQueue, OverflowCounter
from pointit.runtime.zenoh.subscribers import (
    MAX_NAMES,
    MAX_USERS,
    SILENT_S,
    NameAllowlist,
    NameLimiter,
    max_names_for,
)
from pointit.schemas import ClockTick, DecodeError, KeyNameError, encode
from pointit.schemas.codec import MEDIA_TYPE
from pointit.schemas.topics import TOPICS
from tests.support.bench import until

pytestmark = pytest.mark.wall_time


async def test_items_beyond_the_limit_are_rejected_and_the_rest_handled_in_order() -> None:
    seen: list[int] = []
    turned_away = OverflowCounter()

    def work(item: int) -> tuple[()]:
        seen.append(item)
        return ()

    line = BoundedWorkQueue("users/*/profile", work, turned_away)
    taken: list[bool] = []
    items = range(MAX_WAITING + 3)
    thread = threading.Thread(target=lambda: taken.extend(map(line.offer, items)))
    thread.start()
    thread.join()  # the loop is held up meanwhile
    assert taken == [True] * MAX_WAITING + [False] * 3
    sentence = turned_away.problem(time.monotonic())
    assert sentence.startswith("3 questions were turned away, the last for users/*/profile, ")
    assert turned_away.problem(time.monotonic() + SHOWN_S + 1.0) == ""
    await until(lambda: len(seen) == MAX_WAITING)
    assert seen == list(range(MAX_WAITING))
    assert line.offer(7), "there is room again"
    await until(lambda: seen[-1] == 7)


async def test_other_tasks_run_while_a_long_item_is_worked_on() -> None:
    turns = 0
    counts: list[int] = []

    def work(steps: int) -> Iterator[None]:
        for _ in range(steps):
            counts.append(turns)
            time.sleep(SLICE_S)
            yield

    line = BoundedWorkQueue("key", work, OverflowCounter())
    assert line.offer(20)
    while len(counts) < 20:
        await asyncio.sleep(0)
        turns += 1
    assert len(set(counts)) == 20, "a step longer than a slice is the only one of its turn"


async def test_a_failing_item_does_not_stop_the_next(caplog: pytest.LogCaptureFixture) -> None:
    seen: list[int] = []

    def work(item: int) -> Iterator[None]:
        yield
        seen.append(10 // item)

    line = BoundedWorkQueue("led/brightness", work, OverflowCounter())
    assert line.offer(0)
    assert line.offer(5)
    await until(lambda: seen == [2])
    assert "led/brightness" in caplog.text


def names() -> NameLimiter:
    return NameLimiter("user", lambda key: key.removeprefix("users/"), NameAllowlist())


def test_a_flood_of_new_names_does_not_evict_active_names() -> None:
    """The attack: thousands of names in seconds, while one person goes on at 50 Hz."""
    heard = names()
    assert heard.admit("users/anna", 0.0) == "anna"
    admitted = 0
    said: set[str] = set()
    for index in range(10_000):
        now_s = index * 0.002
        if index % 10 == 0:
            assert heard.admit("users/anna", now_s) == "anna"
        try:
            heard.admit(f"users/x{index}", now_s)
        except KeyNameError as error:
            said.add(str(error).partition(": ")[2])
        else:
            admitted += 1
    assert admitted == MAX_USERS - 1
    assert len(said) == 1
    assert f"more than {MAX_USERS} names" in said.pop()


def test_names_of_the_map_have_a_place_whatever_others_make_up() -> None:
    places = NameAllowlist()
    heard = NameLimiter("led", lambda key: key, places)
    places.keep("led", ["lamp"])
    for index in range(MAX_NAMES):
        heard.admit(f"x{index}", 0.0)
    with pytest.raises(KeyNameError, match="led 'y'"):
        heard.admit("y", 0.0)
    assert heard.admit("lamp", 0.0) == "lamp"


def test_the_longest_silent_name_is_evicted_after_a_minute() -> None:
    heard = names()
    for index in range(MAX_USERS):
        heard.admit(f"users/x{index}", 1.0)
    heard.admit("users/x0", 2.0)
    with pytest.raises(KeyNameError, match="user 'new'"):
        heard.admit("users/new", 1.0 + SILENT_S)
    assert heard.admit("users/new", 1.1 + SILENT_S) == "new"  # in place of x1
    assert heard.admit("users/x0", 1.1 + SILENT_S) == "x0"
    assert heard.admit("users/x1", 1.1 + SILENT_S) == "x1"  # in place of x2


def test_a_name_that_is_refused_takes_no_place() -> None:
    def refuse(key: str) -> str:
        if key.startswith("bad"):
            raise KeyNameError(key)
        return key

    heard = NameLimiter("user", refuse, NameAllowlist())
    for index in range(MAX_USERS):
        with pytest.raises(KeyNameError):
            heard.admit(f"bad{index}", 0.0)
    for index in range(MAX_USERS):
        heard.admit(f"good{index}", 0.0)


def test_every_topic_has_a_limit_and_only_people_have_the_small_one() -> None:
    for topic in TOPICS:
        assert max_names_for(topic.placeholder) == (MAX_USERS if "{user}" in topic.key else MAX_NAMES)


@given(st.lists(st.tuples(st.integers(0, 400), st.floats(0, 30)), max_size=600))
def test_never_more_than_the_limit_whatever_comes(arrivals: list[tuple[int, float]]) -> None:
    heard, now_s = names(), 0.0
    for number, wait_s in arrivals:
        now_s += wait_s
        try:
            assert heard.admit(f"users/x{number}", now_s) == f"x{number}"
        except KeyNameError:
            assert len(heard._received) == MAX_USERS
        assert len(heard._received) <= MAX_USERS


def test_many_threads_do_not_exceed_it() -> None:
    heard = names()

    def offer(start: int) -> None:
        for index in range(start, start + 500):
            with contextlib.suppress(KeyNameError):
                heard.admit(f"users/x{index}", 0.0)

    threads = [threading.Thread(target=offer, args=(500 * index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(heard._received) == MAX_USERS


TICK = ClockTick(stamp_ns=1, sim_ns=2, speed=3.0)
GROWN = zenoh.ZBytes(msgpack.packb({**msgpack.unpackb(encode(TICK)), "added_later": 4}))


def test_message_survives_the_way_with_its_encoding() -> None:
    assert decoded(ClockTick, zenoh.ZBytes(encode(TICK)), encoding_of(ClockTick)) == TICK


def test_fields_that_a_newer_version_added_are_ignored() -> None:
    newer = zenoh.Encoding(MEDIA_TYPE).with_schema("ClockTick.v98")
    assert decoded(ClockTick, GROWN, newer) == TICK


@pytest.mark.parametrize("encoding", [None, encoding_of(ClockTick)])
def test_unknown_fields_of_our_own_version_are_refused(encoding: zenoh.Encoding | None) -> None:
    with pytest.raises(DecodeError, match="added_later"):
        decoded(ClockTick, GROWN, encoding)
