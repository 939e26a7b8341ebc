"""A person's samples as `pointit trace` hears them: clocks, writers, bytes that are no message."""

import asyncio
from collections.abc import Callable
from typing import Any, cast

import pytest

from pointit.cli.inspect.sample_path import SETTLE_S
from pointit.cli.inspect.trace import Tracer
from pointit.runtime.bus.contract import AnyTopic, Bus, Sent, Tap
from pointit.schemas import ClockTick, Cursor, DecodeError, Health, ImuSample, KeyHealth, Message, StripsFrame
from pointit.schemas.topics import CLOCK, CURSOR, HEALTH, IMU, STRIPS_FRAME
from tests.support.bench import in_virtual_time

LEVEL = (0.0, 0.0, 0.0, 1.0)
NOW_NS = 1_700_000_000_000_000_000
MS = 1_000_000


class Bytes:
    """A message of another process. Without one, it cannot be decoded."""

    def __init__(self, message: Message | None, sent: Sent | None) -> None:
        self.size = 1
        self.sent = sent
        self._message = message

    def decode(self) -> Message:
        if self._message is None:
            raise DecodeError("garbage")
        return self._message


class Wire:
    """The bus of a tracer, with what a test puts on it."""

    def __init__(self) -> None:
        self._taps: dict[str, Tap] = {}
        self._states: dict[str, Callable[[Any, str], None]] = {}
        self.names: dict[str, str] = {}
        self.on_presence: Callable[[str, bool], None] | None = None

    def tap(self, topic: AnyTopic, handler: Tap, name: str = "*") -> None:
        self._taps[topic.key] = handler
        self.names[topic.key] = name

    def subscribe(self, topic: AnyTopic, handler: Callable[[Any, str], None]) -> None:
        self._states[topic.key] = handler

    def watch(self, _presence: object, handler: Callable[[str, bool], None]) -> None:
        self.on_presence = handler

    def tell(self, topic: AnyTopic, message: Message) -> None:
        self._states[topic.key](message, "")

    def put(self, topic: AnyTopic, message: Message | None, sent: Sent | None) -> None:
        self._taps[topic.key](Bytes(message, sent), "")


def health(instance: str, *topics: AnyTopic, user: str = "", host: str = "hall") -> Health:
    keys = tuple(KeyHealth(key=topic.key, direction="out", rate_hz=1.0) for topic in topics)
    service = instance.partition(".")[0]
    return Health(stamp_ns=NOW_NS, service=service, instance=instance, user=user, pid=1, host=host, keys=keys)


def imu(stamp_ns: int = NOW_NS) -> ImuSample:
    return ImuSample(stamp_ns=stamp_ns, orientation_xyzw=LEVEL)


async def begun() -> tuple[Wire, Tracer]:
    wire = Wire()
    tracer = Tracer(cast("Bus", wire), "anna")
    await asyncio.sleep(SETTLE_S)
    return wire, tracer


@in_virtual_time
async def test_it_listens_to_that_person_only() -> None:
    wire, _ = await begun()
    assert wire.names[IMU.key] == wire.names[CURSOR.key] == "anna"
    assert wire.names[STRIPS_FRAME.key] == wire.names[HEALTH.key] == "*"


@in_virtual_time
async def test_capture_in_simulated_time_is_compared_in_wall_time() -> None:
    wire, tracer = await begun()
    sim_ns = 5 * NOW_NS // 4
    wire.tell(CLOCK, ClockTick(stamp_ns=NOW_NS, sim_ns=sim_ns, speed=4.0))
    wire.put(IMU, imu(sim_ns + 40 * MS), Sent(NOW_NS + 13 * MS, "p"))  # captured 10 ms after the tick
    assert tracer.take() == []
    await asyncio.sleep(SETTLE_S)
    trace = tracer.trace(tracer.take())
    assert trace.captured_ns == NOW_NS + 10 * MS
    assert trace.path[0].total_s == pytest.approx(0.003)


@in_virtual_time
async def test_a_hop_is_of_the_service_in_the_process_that_published_it() -> None:
    wire, tracer = await begun()
    for process, report in (
        ("site", health("pui", CURSOR)),
        ("site", health("led-driver", STRIPS_FRAME)),
        ("wrist", health("user-sim.anna", IMU, user="anna", host="wrist")),
        ("wrist", health("pui.ben", CURSOR, user="ben", host="wrist")),
        ("wrist", health("pui.anna", CURSOR, host="wrist")),
        ("wrist", health("pui.hall", CURSOR, host="wrist")),
    ):
        wire.put(HEALTH, report, Sent(NOW_NS, process))
    wire.put(IMU, imu(), Sent(NOW_NS + MS, "wrist"))
    wire.put(CURSOR, Cursor(stamp_ns=NOW_NS), Sent(NOW_NS + 2 * MS, "wrist"))
    frame = StripsFrame(stamp_ns=NOW_NS, strips=(), light_s=0.01)
    wire.put(STRIPS_FRAME, frame, Sent(NOW_NS + 3 * MS, "site"))
    tracer.take()
    await asyncio.sleep(SETTLE_S)
    trace = tracer.trace(tracer.take())
    assert [(hop.hop, hop.service, hop.host) for hop in trace.path] == [
        ("imu", "user-sim.anna", "wrist"),
        ("cursor", "pui.anna", "wrist"),
        ("frame", "led-driver", "hall"),
        ("light", "led-driver", "hall"),
    ]
    assert [hop.total_s for hop in trace.path] == pytest.approx([0.001, 0.002, 0.003, 0.013])


@in_virtual_time
async def test_before_reports_and_without_stamps_presence_and_arrival_have_to_do() -> None:
    wire, tracer = await begun()
    assert wire.on_presence is not None
    for instance in ("pui", "user-sim.anna", "user-sim.ben"):
        wire.on_presence(instance, True)
    wire.put(IMU, imu(), None)
    tracer.take()
    await asyncio.sleep(SETTLE_S)
    (hop,) = tracer.trace(tracer.take()).path
    assert (hop.service, hop.host) == ("user-sim.anna", "")
    assert hop.total_s is not None
    assert hop.total_s > 0


@in_virtual_time
async def test_bytes_that_are_no_message_are_counted() -> None:
    wire, tracer = await begun()
    wire.put(IMU, None, Sent(NOW_NS, "p"))
    wire.put(IMU, imu(), Sent(NOW_NS, "p"))
    tracer.take()
    await asyncio.sleep(SETTLE_S)
    trace = tracer.trace(tracer.take())
    assert (trace.samples, trace.invalid) == (1, 1)
