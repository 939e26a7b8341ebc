"""Malformed bytes are dropped, counted, logged once a second, and never end a reader."""

import asyncio
import logging
import time
from typing import Any

import msgpack
import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import NoAnswerError, RefusedError, RequestError
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Done, ImuSample, Message, SetBrightness, SetPose, UserProfile, encode
from pointit.schemas.topics import (
    CLAIM,
    HEALTH,
    IMU,
    PROFILE,
    SET_BRIGHTNESS,
    SET_POSE,
    STRIPS_FRAME,
    TOPICS,
    USER_ALIVE,
    Topic,
)
from tests.support.bench import until

SITE = "pointit/lab/"

GARBAGE = {
    "nothing": b"",
    "text": b"hello",
    "a list": msgpack.packb([1, 2, 3]),
    "an empty map": msgpack.packb({}),
    "unknown fields": msgpack.packb({"stamp_ns": 1, "surprise": 1}),
    "keys that are no names": msgpack.packb({1: 2}),
    "a map cut short": msgpack.packb({"stamp_ns": 1, "seq": 2})[:-3],
    "more than one value": msgpack.packb({"stamp_ns": 1}) * 2,
    "a list of four milliards": b"\xdd\xff\xff\xff\xff",
    "a thousand lists in each other": b"\x91" * 1000,
    "a name that is not UTF-8": b"\x81\xa2\xff\xfe\x01",
    "not a number": msgpack.packb({"stamp_ns": float("nan")}),
    "too big a number": msgpack.packb({"stamp_ns": 2**64 - 1, "seq": -1}),
    "a norm that overflows": msgpack.packb({"stamp_ns": 1, "orientation_xyzw": [1e154] * 4}),
    "a megabyte of zeros": bytes(1_000_000),
    "a megabyte of text": msgpack.packb({"stamp_ns": 1, "seq": "x" * 1_000_000}),
}


SOME = (IMU, CLAIM, PROFILE, STRIPS_FRAME, HEALTH)
"""Topics of each delivery, of people and of all."""


@pytest.mark.parametrize(
    "topic",
    [*SOME, *(pytest.param(topic, marks=pytest.mark.long) for topic in TOPICS if topic not in SOME)],
    ids=lambda topic: topic.key,
)
async def test_garbage_is_dropped_and_counted(
    bus: ZenohBus, stranger: zenoh.Session, topic: Topic[Message], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    seen: list[Message] = []
    began_s = time.monotonic()
    subscription = bus.subscribe(topic, lambda message, _name: seen.append(message))
    key = SITE + topic.at("anna" if topic.placeholder else "")
    for count, (what, payload) in enumerate(GARBAGE.items(), start=1):
        stranger.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)  # a megabyte needs time
        await until(lambda count=count: subscription.traffic.invalid >= count, what=what)

    assert subscription.traffic.invalid == len(GARBAGE)
    assert not seen
    assert subscription.traffic.errors == 0

    lines = [record for record in caplog.records if f"{topic.key}: dropped" in record.message]
    assert 1 <= len(lines) <= 1 + (time.monotonic() - began_s)
    assert all(len(record.message) < 400 for record in lines), "a megabyte does not belong in a log"
    assert not [record for record in caplog.records if record.exc_info]


async def test_a_key_with_an_invalid_name_is_dropped(bus: ZenohBus, stranger: zenoh.Session) -> None:
    seen: list[str] = []
    subscription = bus.subscribe(IMU, lambda _message, name: seen.append(name))
    told: list[str] = []
    bus.watch(USER_ALIVE, lambda name, **_: told.append(name))
    good = encode(ImuSample(stamp_ns=1, orientation_xyzw=(0, 0, 0, 1)))
    for count, name in enumerate(("ä", "a b", "x" * 65, "-"), start=1):
        stranger.put(f"{SITE}users/{name}/imu", good)
        await until(lambda count=count: subscription.traffic.invalid == count)
    strange = stranger.liveliness().declare_token(f"{SITE}alive/users/a b")
    known = stranger.liveliness().declare_token(f"{SITE}alive/users/anna")
    await until(lambda: bool(told))
    assert (seen, told) == ([], ["anna"])
    strange.undeclare()
    known.undeclare()


async def test_a_delete_is_not_a_message(bus: ZenohBus, stranger: zenoh.Session) -> None:
    subscription = bus.subscribe(IMU, lambda _message, _name: None)
    stranger.delete(SITE + IMU.at("anna"))
    stranger.put(SITE + IMU.at("anna"), b"garbage")
    await until(lambda: subscription.traffic.invalid == 1)
    assert subscription.traffic.received == 1


async def test_a_question_that_does_not_decode_is_refused(bus: ZenohBus, stranger: zenoh.Session) -> None:
    asked: list[str] = []

    async def pose(_query: SetPose, name: str) -> Done:
        asked.append(name)
        return Done(message=name)

    bus.serve(SET_POSE, pose)

    def ask(key: str, payload: bytes | None) -> list[str]:
        return [
            reply.err.payload.to_string() if reply.err else reply.ok.payload.to_bytes().hex()  # pyrefly: ignore[missing-attribute]
            for reply in stranger.get(SITE + key, payload=payload, timeout=30.0)
        ]

    for payload in (None, *GARBAGE.values()):
        answers = await asyncio.to_thread(ask, SET_POSE.at("anna"), payload)
        assert len(answers) == 1
        assert answers[0].startswith("SetPose: ")
    wild = await asyncio.to_thread(ask, SET_POSE.at("*"), encode(SetPose(position_m=(0, 0, 0))))
    assert len(wild) == 1
    assert "user '*'" in wild[0]
    assert not asked
    good = await asyncio.to_thread(ask, SET_POSE.at("anna"), encode(SetPose(position_m=(0, 0, 0))))
    assert bytes.fromhex(good[0]) == encode(Done(message="anna"))


async def test_a_reply_that_does_not_decode_names_the_server(bus: ZenohBus, stranger: zenoh.Session) -> None:
    answers = iter((b"garbage", b"refused"))

    def reply(query: zenoh.Query) -> None:
        with query:
            answer = next(answers)
            if answer == b"refused":
                query.reply_err(b"\xff not UTF-8")
            else:
                query.reply(query.key_expr, answer)

    queryable = stranger.declare_queryable(SITE + SET_BRIGHTNESS.at(), Callback(reply, indirect=False))
    with pytest.raises(RequestError, match="led-driver sent a broken reply to leds/brightness") as caught:
        await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1))
    assert not isinstance(caught.value, NoAnswerError | RefusedError)
    with pytest.raises(RefusedError, match="not UTF-8"):
        await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1))
    queryable.undeclare()


async def test_sender_of_an_endless_id_is_named(bus: ZenohBus, stranger: zenoh.Session) -> None:
    seen: list[Message] = []
    view = ServiceBus(bus, WallClock(), "selector", "selector")
    view.subscribe(CLAIM, lambda claim, _name: seen.append(claim))
    claim = msgpack.packb({"stamp_ns": 1, "object_id": "x" * 15_000, "wish": "toggle"})
    stranger.put(SITE + CLAIM.at("mallory"), claim)
    await until(lambda: bool(view.report().warnings))
    (warning,) = view.report().warnings
    assert warning == (
        "1 messages on users/*/claim were invalid and were dropped, the last of mallory (Claim: "
        "object_id: String should have at most 256 characters (got "
        f"'{'x' * 27}...{'x' * 28}')): look at what writes them there"
    )
    assert not seen


async def test_a_get_returns_a_state_or_a_sentence(bus: ZenohBus, stranger: zenoh.Session) -> None:
    bus.publisher(PROFILE, "anna").put(UserProfile(stamp_ns=1))

    async def refuse(_query: SetBrightness, _name: str) -> Done:
        raise RefusedError("not now")

    bus.serve(SET_BRIGHTNESS, refuse)

    def get(key: str, **query: Any) -> list[zenoh.Reply]:
        return list(stranger.get(SITE + key, timeout=30.0, **query))

    (state,) = await asyncio.to_thread(get, f"{PROFILE.at('anna')}/@adv/**?_anyke")
    assert state.ok is not None
    assert str(state.ok.key_expr).endswith(PROFILE.at("anna"))
    assert msgpack.unpackb(state.ok.payload.to_bytes())["stamp_ns"] == 1
    payload = encode(SetBrightness(brightness=0.5))
    (refused,) = await asyncio.to_thread(get, SET_BRIGHTNESS.key, payload=payload)
    assert refused.err is not None
    assert refused.err.payload.to_bytes() == b"not now"
