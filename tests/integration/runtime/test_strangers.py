"""Strangers on the network who flood a site: with names, with long payloads, with large messages."""

import asyncio
import functools
import time
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.runtime.zenoh import declarations
from pointit.runtime.zenoh.queries import MAX_WAITING
from pointit.runtime.zenoh.subscribers import BUSY, MAX_NAMES, MAX_USERS
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Environment, Lamp, LampColor, SetBrightness, UserProfile, encode
from pointit.schemas.topics import BUTTON, CURSOR, IMU, LAMP_COLOR, MAP, PROFILE, SET_BRIGHTNESS
from tests.support.bench import until
from tests.support.sinks import Sink, imu

SITE = "pointit/lab/"
LAMP = Lamp(id="lamp", position_m=(0.0, 0.0, 2.0))


async def test_new_names_evict_no_active_ones(
    bus: ZenohBus, stranger: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    sink = Sink()
    subscription = bus.subscribe(CURSOR, sink)

    def point(user: str, seq: int) -> None:
        cursor = Cursor(stamp_ns=1, seq=seq)
        stranger.put(SITE + CURSOR.at(user), encode(cursor), congestion_control=zenoh.CongestionControl.BLOCK)

    def flood() -> None:
        point("anna", 0)
        for index in range(2000):
            point(f"x{index}", index)
        point("anna", 1)

    await asyncio.to_thread(flood)
    await until(lambda: sink.of("anna")[-1:] == [1], what="the person to be heard after the flood")
    await until(lambda: len({name for name, _ in sink.seen}) == MAX_USERS, what="the others")
    assert subscription.traffic.invalid == 2001 - MAX_USERS
    assert any(f"more than {MAX_USERS} names" in record.message for record in caplog.records)


async def test_lamps_of_the_map_are_heard_after_a_flood(bus: ZenohBus, stranger: zenoh.Session) -> None:
    """`pointit run`: the map and its readers are in one process, people's lamps come from elsewhere."""
    maps = Sink()
    lamps = Sink()
    bus.subscribe(MAP, maps)
    subscription = bus.subscribe(LAMP_COLOR, lamps)
    bus.publisher(MAP).put(Environment(stamp_ns=1, name="lab", lamps=(LAMP,)))
    await until(lambda: bool(maps.seen), what="the map")

    def flood() -> None:
        for index, name in enumerate([*(f"x{number}" for number in range(MAX_NAMES + 1)), LAMP.id]):
            light = LampColor(stamp_ns=1, seq=index, color=(0, 0, 0))
            block = zenoh.CongestionControl.BLOCK
            stranger.put(SITE + LAMP_COLOR.at(name), encode(light), congestion_control=block)

    await asyncio.to_thread(flood)
    await until(lambda: subscription.traffic.received + subscription.traffic.invalid == MAX_NAMES + 2)
    assert subscription.traffic.invalid == 1
    await until(lambda: bool(lamps.of(LAMP.id)), what="the map's lamp to be heard")


@pytest.mark.parametrize("topic", [IMU, BUTTON], ids=lambda topic: topic.key)
async def test_a_long_payload_is_refused_where_it_arrives(
    bus: ZenohBus, stranger: zenoh.Session, topic: Any
) -> None:
    """Nothing of it waits for the loop: a queue of events could hold gigabytes."""
    subscription = bus.subscribe(topic, Sink())
    stranger.put(SITE + topic.at("anna"), bytes(topic.message.max_bytes + 1))
    await until(lambda: subscription.traffic.invalid == 1)
    assert subscription.traffic.received == 0
    stranger.put(SITE + topic.at("anna"), bytes(topic.message.max_bytes))
    await until(lambda: subscription.traffic.invalid == 2)
    assert subscription.traffic.received == 1


async def test_a_long_question_is_refused_where_it_arrives(bus: ZenohBus, stranger: zenoh.Session) -> None:

    async def never(_query: SetBrightness, _name: str) -> Any:
        raise AssertionError

    bus.serve(SET_BRIGHTNESS, never)
    size = SetBrightness.max_bytes + 1
    # blocks the loop, which need not look at it
    [reply] = list(stranger.get(SITE + SET_BRIGHTNESS.at(), payload=bytes(size), timeout=30.0))
    assert reply.err is not None
    assert reply.err.payload.to_string() == (
        f"SetBrightness: has {size} bytes, at most {SetBrightness.max_bytes} are taken"
    )


async def test_thousands_of_questions_are_bounded_and_spare_the_loop(
    bus: ZenohBus, stranger: zenoh.Session
) -> None:
    """Once 2000 questions for all profiles stalled a loop for 25 s."""
    kept = [(f"u{index}", UserProfile(stamp_ns=1, seq=1)) for index in range(50)]
    turns = 0
    worked: set[int] = set()

    def recall(_topic: object) -> Iterator[tuple[str, UserProfile]]:
        for each in kept:
            worked.add(turns)
            yield each

    bus.serve_retained((PROFILE,), recall)
    [first] = await asyncio.to_thread(lambda: list(stranger.get(SITE + PROFILE.at("u7"), timeout=30.0)))
    assert first.ok is not None
    refused: list[str] = []
    done: list[int] = []

    def take(reply: zenoh.Reply) -> None:
        if reply.err is not None:
            refused.append(reply.err.payload.to_string())

    count = 3 * MAX_WAITING
    for index in range(count):
        finish = functools.partial(done.append, index)
        stranger.get(SITE + PROFILE.at("*"), Callback(take, finish, indirect=False), timeout=120.0)

    def hold_up() -> None:
        """Let the loop look at none of them meanwhile."""
        began_s = time.monotonic()
        while len(refused) < count - MAX_WAITING and time.monotonic() < began_s + 60.0:
            time.sleep(0.01)

    hold_up()
    worked.clear()
    assert set(refused) == {BUSY}
    assert "questions were turned away, the last for users/{user}/profile" in bus.problem
    until_s = time.monotonic() + 90.0
    while len(done) < count and time.monotonic() < until_s:
        await asyncio.sleep(0)
        turns += 1
    assert len(done) == count
    assert len(worked) > 50, "everybody else has turns between the answers"


async def test_sample_is_decoded_once_for_all_readers_of_a_process(
    bus: ZenohBus, stranger: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[object] = []
    inner = declarations.decoded

    def counted(*arguments: Any) -> Any:
        decoded.append(arguments)
        return inner(*arguments)

    monkeypatch.setattr("pointit.runtime.zenoh.subscribers.decoded", counted)
    sinks = [Sink() for _ in range(3)]
    subscriptions = [bus.subscribe(IMU, sink) for sink in sinks]
    key = SITE + IMU.at("anna")
    stranger.put(key, encode(imu(1)))
    await until(lambda: all(sink.seen for sink in sinks))
    assert len(decoded) == 1
    assert sinks[0].messages[0] is sinks[1].messages[0] is sinks[2].messages[0]

    stranger.put(key, b"garbage")
    await until(lambda: all(subscription.traffic.invalid == 1 for subscription in subscriptions))
    assert len(decoded) == 2

    subscriptions[0].close()
    stranger.put(key, encode(imu(2)))
    await until(lambda: sinks[1].of("anna") == sinks[2].of("anna") == [1, 2])
    assert sinks[0].of("anna") == [1]
