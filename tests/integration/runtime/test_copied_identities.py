"""Copies of what a sender states about itself change nothing for the one who is copied.

The stranger speaks Zenoh itself, as an attacker would, and writes under a key of its own, which is all that
access rules leave to it.
"""

import asyncio
import time
from collections.abc import Callable, Iterator

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.contract import EVENT_CAPACITY
from pointit.runtime.errors import RefusedError
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.queries import MAX_REPLY_BYTES, ExcessReplies, ReplyLimit, query_replies
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import (
    ButtonEvent,
    Configuration,
    Health,
    HomeSetup,
    Message,
    ServedRequest,
    SetUpHome,
    UserPose,
    encode,
)
from pointit.schemas.home import HomeLamp
from pointit.schemas.topics import BUTTON, CONFIGURATION, HEALTH, POSE, SERVED, SET_UP_HOME, Topic
from tests.support.bench import until
from tests.support.pace import Patience
from tests.support.sinks import Sink

SITE = "pointit/lab/"
FAR = 2**31


def press(seq: int) -> ButtonEvent:
    return ButtonEvent(stamp_ns=1, seq=seq)


def pose(seq: int) -> UserPose:
    return UserPose(stamp_ns=1, seq=seq, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)


WRITTEN = [pytest.param(BUTTON, press, id="event"), pytest.param(POSE, pose, id="state")]
Make = Callable[[int], Message]


@pytest.fixture
def copied(stranger: zenoh.Session) -> Iterator[list[zenoh.Sample]]:
    """Everything that the victim writes, with the source ids that it states."""
    samples: list[zenoh.Sample] = []
    on_sample = Callback(samples.append, indirect=False)
    subscribers = [
        stranger.declare_subscriber(f"{SITE}users/anna/{name}", on_sample) for name in ("button", "pose")
    ]
    yield samples
    for subscriber in subscribers:
        subscriber.undeclare()


async def put_as(stranger: zenoh.Session, key: str, message: Message, source: zenoh.SourceInfo) -> None:
    await asyncio.to_thread(stranger.put, SITE + key, encode(message), source_info=source)


@pytest.mark.parametrize(("topic", "make"), WRITTEN)
async def test_copied_source_and_number_change_nothing_for_their_owner(  # noqa: PLR0917 - fixtures
    bus: ZenohBus,
    stranger: zenoh.Session,
    copied: list[zenoh.Sample],
    endpoint: str,
    topic: Topic[Message],
    make: Make,
) -> None:
    reader = await ZenohBus.open(Link(connect=(endpoint,)))
    sink = Sink()
    reader.subscribe(topic, sink)
    anna = bus.publisher(topic, "anna")
    anna.put(make(0))
    await until(lambda: bool(copied) and sink.of("anna") == [0])
    stated = copied[0].source_info
    assert stated is not None

    # One message under a key of its own, with the number that is never reached
    await put_as(stranger, topic.at("guest"), make(7), zenoh.SourceInfo(stated.source_id, FAR))
    await until(lambda: sink.of("guest") == [7])
    for number in range(1, 6):
        anna.put(make(number))
    await until(lambda: sink.of("anna")[-1:] == [5])
    if topic is BUTTON:
        assert sink.of("anna") == [0, 1, 2, 3, 4, 5]
    (sentence,) = [problem.sentence for problem in reader.problems if problem.code == "copied-source"]
    assert topic.at("guest") in sentence
    await reader.close()


async def test_who_copies_the_source_of_a_process_is_named_by_it(
    bus: ZenohBus, stranger: zenoh.Session, copied: list[zenoh.Sample]
) -> None:
    sink = Sink()
    bus.subscribe(BUTTON, sink)
    bus.publisher(BUTTON, "anna").put(press(0))
    await until(lambda: bool(copied))
    stated = copied[0].source_info
    assert stated is not None
    await put_as(stranger, BUTTON.at("guest"), press(1), stated)
    await until(lambda: sink.of("guest") == [1])
    (problem,) = [problem for problem in bus.problems if problem.code == "copied-source"]
    assert "the writer of users/guest/button states the source id of this process" in problem.sentence


async def test_copied_time_stamp_changes_nothing_for_its_owner(
    bus: ZenohBus, stranger: zenoh.Session, copied: list[zenoh.Sample], endpoint: str
) -> None:
    reader = await ZenohBus.open(Link(connect=(endpoint,)))
    sink = Sink()
    reader.subscribe(POSE, sink)
    anna = bus.publisher(POSE, "anna")
    anna.put(pose(0))
    await until(lambda: bool(copied) and sink.of("anna") == [0])
    stamp = copied[0].timestamp
    assert stamp is not None
    await asyncio.to_thread(stranger.put, SITE + POSE.at("guest"), encode(pose(7)), timestamp=stamp)
    await until(lambda: sink.of("guest") == [7])
    anna.put(pose(1))
    await until(lambda: sink.of("anna")[-1:] == [1])
    await reader.close()


STATED = [
    (HEALTH, Health(stamp_ns=1, service="pui", instance="pui.guest", pid=1, user="guest")),
    (CONFIGURATION, Configuration(stamp_ns=1, service="pui", instance="pui.guest", user="guest")),
    (SERVED, ServedRequest(stamp_ns=1, service="pui", instance="pui.guest", request="a", query="{}")),
]
FALSE = {"service": "selector", "instance": "pui.anna", "user": "anna"}


@pytest.mark.parametrize(("topic", "message"), STATED, ids=lambda value: getattr(value, "key", ""))
async def test_false_name_in_a_message_is_refused_under_the_key_of_its_writer(
    bus: ZenohBus, stranger: zenoh.Session, topic: Topic[Message], message: Message
) -> None:
    sink = Sink()
    subscription = bus.subscribe(topic, sink)
    key = SITE + topic.at("pui.guest")
    fields = [name for name in FALSE if name in type(message).model_fields]
    for number, field in enumerate(fields, 1):
        false = message.model_copy(update={field: FALSE[field]})
        await asyncio.to_thread(stranger.put, key, encode(false))
        await until(lambda number=number: subscription.traffic.invalid == number)
    await asyncio.to_thread(stranger.put, key, encode(message.model_copy(update={"seq": 5})))
    await until(lambda: sink.of("pui.guest") == [5])
    assert {name for name, _ in sink.seen} == {"pui.guest"}


async def test_endless_answers_end_with_those_that_were_asked_for(
    bus: ZenohBus, stranger: zenoh.Session
) -> None:
    """A writer whose cache never stops answering."""
    count = 0

    def answer(query: zenoh.Query) -> None:
        nonlocal count
        with query:
            while count < 3000:
                count += 1
                query.reply(SITE + "users/guest/button", b"x" * 1000)

    queryable = stranger.declare_queryable(
        SITE + "users/guest/button/@adv/**", Callback(answer, indirect=True)
    )
    selector = "users/guest/button/@adv/pub/a/1/**?_sn=0..9"
    none = zenoh.ConsolidationMode.NONE
    anyhow = zenoh.ReplyKeyExpr.ANY
    timeout_s = 60.0  # longer than a busy machine takes for eleven answers

    excess = ExcessReplies()

    async def ask(limit: ReplyLimit) -> int:
        replies = await query_replies(
            bus.session,
            selector,
            limit=limit,
            excess=excess,
            consolidation=none,
            accept_replies=anyhow,
            timeout=timeout_s,
        )
        return len(replies)

    patience = Patience(30.0)
    began_s = time.monotonic()
    while await ask(ReplyLimit(11)) < 11:
        assert not patience.is_over(), "the writer does not answer"
        await asyncio.sleep(0.05)
        began_s = time.monotonic()
    assert excess.problem(time.monotonic()).startswith("the writer of users/guest/button answers more")
    assert time.monotonic() - began_s < timeout_s, "the rest is not waited for"
    count = 0
    assert await ask(ReplyLimit(1000, 999)) == 0, "longer than any message of its kind"
    count = 0
    assert await ask(ReplyLimit(EVENT_CAPACITY, MAX_REPLY_BYTES, max_of_key=4)) == 4
    sentence = excess.problem(time.monotonic())
    assert sentence.startswith("users/guest/button has more than 4 answers"), "they may be of many writers"
    queryable.undeclare()


async def test_answer_that_is_too_long_is_refused_with_its_size(bus: ZenohBus, endpoint: str) -> None:
    """Home with many lamps, whose page is a process of its own."""
    count = 200

    async def answer(_query: SetUpHome, _name: str) -> HomeSetup:
        lamps = [HomeLamp(id=f"light.{number}", label="Lamp in the living room") for number in range(count)]
        return HomeSetup(step="choose", lamps=tuple(lamps))

    bus.serve(SET_UP_HOME, answer)
    page = await ZenohBus.open(Link(connect=(endpoint,)))
    assert len((await page.call(SET_UP_HOME, SetUpHome())).lamps) == 200
    count = 20_000
    with pytest.raises(RefusedError, match=f"would have .* bytes, and readers take {HomeSetup.max_bytes}"):
        await page.call(SET_UP_HOME, SetUpHome(), timeout_s=60.0)  # 20 000 lamps are checked
    await page.close()


async def test_state_that_is_too_long_is_reported_and_not_sent(bus: ZenohBus, endpoint: str) -> None:
    reader = await ZenohBus.open(Link(connect=(endpoint,)))
    sink = Sink()
    reader.subscribe(CONFIGURATION, sink)
    publisher = bus.publisher(CONFIGURATION, "pui")
    stated = Configuration(stamp_ns=1, service="pui", instance="pui")
    publisher.put(stated.model_copy(update={"parameters": "x" * Configuration.max_bytes, "seq": 1}))
    (problem,) = [problem for problem in bus.problems if problem.code == "too-long"]
    assert problem.sentence.startswith("configuration/pui is not sent: Configuration: would have ")
    publisher.put(stated.model_copy(update={"seq": 2}))
    await until(lambda: sink.of("pui") == [2])
    assert all(problem.code != "too-long" for problem in bus.problems)
    await reader.close()
