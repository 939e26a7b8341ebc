"""Samples of a person from messages: as they are joined, timed, and heard by `pointit trace`."""

import asyncio
import itertools
from collections.abc import Callable
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.inspect import trace as trace_command
from pointit.cli.inspect.trace import Trace, Tracer
from pointit.runtime.bus.contract import AnyTopic, Bus, Sent, Tap
from pointit.schemas import ClockTick, Cursor, DecodeError, Health, ImuSample, KeyHealth, Message
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import CLOCK, CURSOR, HEALTH, IMU, SERVICE_ALIVE, STRIPS_FRAME
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
        self._watches: dict[object, PresenceHandler] = {}

    def tap(self, topic: AnyTopic, handler: Tap, name: str = "*") -> None:
        self._taps[topic.key] = handler
        self.names[topic.key] = name

    def subscribe(self, topic: AnyTopic, handler: Callable[[Any, str], None]) -> None:
        self._states[topic.key] = handler

    def watch(self, presence: object, handler: PresenceHandler) -> None:
        self._watches[presence] = handler

    def set_service(self, instance: str) -> None:
        self._watches[SERVICE_ALIVE](instance, present=True)

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
    await asyncio.sleep(trace_command.SETTLE_S)
    return wire, tracer


async def traced(tracer: Tracer) -> Trace:
    """Return the trace of what is on the wire."""
    assert tracer.take() == []
    await asyncio.sleep(trace_command.SETTLE_S)
    return tracer.trace(tracer.take())


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
    trace = await traced(tracer)
    assert trace.captured_ns == NOW_NS + 10 * MS
    assert trace.path[0].total_s == pytest.approx(0.003)


@pytest.mark.parametrize(("own", "service"), [((), "pui.hall"), (("pui.anna",), "pui.anna")])
@in_virtual_time
async def test_hop_belongs_to_the_service_in_the_publishing_process(
    own: tuple[str, ...], service: str
) -> None:
    wire, tracer = await begun()
    wire.put(HEALTH, health("pui", CURSOR), Sent(NOW_NS, "site"))
    wire.put(HEALTH, health("pui.ben", CURSOR, user="ben", host="wrist"), Sent(NOW_NS, "wrist"))
    for instance in ("pui.hall", *own):
        wire.put(HEALTH, health(instance, CURSOR, host="wrist"), Sent(NOW_NS, "wrist"))
    wire.put(CURSOR, Cursor(stamp_ns=NOW_NS), Sent(NOW_NS + 2 * MS, "wrist"))
    (hop,) = (await traced(tracer)).path
    assert (hop.hop, hop.service, hop.host) == ("cursor", service, "wrist")
    assert hop.total_s == pytest.approx(0.002)


@in_virtual_time
async def test_hop_without_reports_or_stamps_uses_presence_and_arrival() -> None:
    wire, tracer = await begun()
    for instance in ("pui", "user-sim.anna", "user-sim.ben"):
        wire.set_service(instance)
    wire.put(IMU, imu(), None)
    (hop,) = (await traced(tracer)).path
    assert (hop.service, hop.host) == ("user-sim.anna", "")
    assert hop.total_s is not None
    assert hop.total_s > 0


@in_virtual_time
async def test_bytes_that_are_no_message_are_counted() -> None:
    wire, tracer = await begun()
    wire.put(IMU, None, Sent(NOW_NS, "p"))
    wire.put(IMU, imu(), Sent(NOW_NS, "p"))
    trace = await traced(tracer)
    assert (trace.samples, trace.invalid) == (1, 1)


STAMP = 1_700_000_000_000_000_000
READY_S = trace_command.SETTLE_S + 0.1
LATER_S = READY_S + trace_command.SETTLE_S
TIMES_MS = {"imu": 1, "ray": 3, "cursor": 6, "hover": 7, "frame": 10, "light": 30}


def joiner() -> trace_command.PathJoiner:
    return trace_command.PathJoiner(lambda stamp_ns: stamp_ns, began_s=0.0)


def add(
    joined: trace_command.PathJoiner, hop: str, at_ms: float, *, stamp_ns: int = STAMP, now_s: float = READY_S
) -> None:
    joined.add(hop, stamp_ns, stamp_ns + round(at_ms * MS), f"process of {hop}", now_s)


def test_messages_of_one_capture_are_one_sample_in_any_order() -> None:
    for hops in itertools.permutations(TIMES_MS):
        joined = joiner()
        for hop in hops:
            add(joined, hop, TIMES_MS[hop])
        (path,) = joined.settled(LATER_S)
        assert {hop: path.total_s(hop) for hop in TIMES_MS} == pytest.approx(
            {hop: ms / 1e3 for hop, ms in TIMES_MS.items()}
        )
        assert {hop: path.delta_s(hop) for hop in TIMES_MS} == pytest.approx(
            {"imu": 0.001, "ray": 0.002, "cursor": 0.003, "hover": 0.001, "frame": 0.004, "light": 0.02}
        )
        assert path.processes["ray"] == "process of ray"


def test_sample_is_judged_once_and_later_messages_are_no_sample() -> None:
    joined = joiner()
    add(joined, "imu", 1)
    assert joined.settled(LATER_S - 0.001) == []
    (path,) = joined.settled(LATER_S)
    add(joined, "ray", 3, now_s=LATER_S)
    assert joined.settled(LATER_S + 10) == []
    assert (path.stamp_ns, path.total_s("ray")) == (STAMP, None)


def test_of_two_messages_for_a_hop_the_first_published_counts() -> None:
    joined = joiner()
    add(joined, "cursor", 6)
    add(joined, "cursor", 4)
    add(joined, "cursor", 9)
    (path,) = joined.settled(LATER_S)
    assert path.total_s("cursor") == pytest.approx(0.004)


def test_lost_hop_has_no_time_and_the_next_no_delta() -> None:
    joined = joiner()
    add(joined, "imu", 1)
    add(joined, "cursor", 6)
    (path,) = joined.settled(LATER_S)
    assert path.total_s("ray") is None
    assert path.delta_s("ray") is None
    assert path.delta_s("cursor") is None
    assert path.total_s("cursor") == pytest.approx(0.006)


def test_frames_of_other_people_are_no_samples() -> None:
    joined = joiner()
    add(joined, "frame", 10)
    add(joined, "light", 12)
    assert joined.settled(LATER_S) == []


def test_samples_first_heard_at_the_start_are_left_out() -> None:
    joined = joiner()
    add(joined, "ray", 3, now_s=trace_command.SETTLE_S - 0.01)
    add(joined, "hover", 7, now_s=READY_S)
    add(joined, "imu", 1, stamp_ns=STAMP + MS)
    assert [path.stamp_ns for path in joined.settled(LATER_S)] == [STAMP + MS]


def test_memory_is_bounded() -> None:
    joined = joiner()
    for k in range(trace_command.MAX_OPEN + 10):
        add(joined, "imu", 1, stamp_ns=STAMP + k)
    stamps = [path.stamp_ns for path in joined.settled(LATER_S)]
    assert stamps == [STAMP + k for k in range(10, trace_command.MAX_OPEN + 10)]


def test_figures_count_what_reached_each_hop() -> None:
    paths = [
        trace_command.SamplePath(STAMP, {trace_command.CAPTURE: 0, "imu": 1 * MS, "ray": 2 * MS}),
        trace_command.SamplePath(STAMP + 1, {trace_command.CAPTURE: 0, "imu": 3 * MS}),
        trace_command.SamplePath(STAMP + 2, {trace_command.CAPTURE: 0, "ray": 9 * MS, "hover": 9 * MS}),
    ]
    imu, ray, hover = trace_command.hop_figures(paths)
    assert (imu.hop, imu.after, imu.samples) == ("imu", trace_command.CAPTURE, 2)
    assert (imu.total_p50_s, imu.total_p99_s) == pytest.approx((0.001, 0.003))
    assert (ray.hop, ray.after, ray.samples) == ("ray", "imu", 2)
    assert (ray.delta_p50_s, ray.delta_p99_s) == pytest.approx((0.001, 0.001))
    assert (ray.total_p50_s, ray.total_p99_s) == pytest.approx((0.002, 0.009))
    assert (hover.delta_p50_s, hover.delta_p99_s, hover.total_p50_s) == (None, None, 0.009)


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=300))
def test_percentiles_are_nearest_ranks(values_ns: list[int]) -> None:
    (imu,) = trace_command.hop_figures(
        [trace_command.SamplePath(k, {trace_command.CAPTURE: 0, "imu": ns}) for k, ns in enumerate(values_ns)]
    )
    ranked = sorted(values_ns)
    count = len(ranked)
    assert imu.delta_p50_s == pytest.approx(ranked[(count + 1) // 2 - 1] / 1e9)
    assert imu.delta_p99_s == pytest.approx(ranked[-(-99 * count // 100) - 1] / 1e9)


def test_the_sample_shown_is_the_newest_that_came_farthest() -> None:
    short = trace_command.SamplePath(STAMP + 9, {trace_command.CAPTURE: 0, "imu": 1})
    far = trace_command.SamplePath(STAMP + 1, {trace_command.CAPTURE: 0, "imu": 1, "ray": 2})
    newer = trace_command.SamplePath(STAMP + 2, {trace_command.CAPTURE: 0, "imu": 1, "ray": 2})
    assert trace_command.farthest([far, newer, short]) is newer
