"""A service's account of itself."""

import asyncio
import gc
import itertools
import math
import weakref
from collections.abc import AsyncIterator, Callable

import pytest
import pytest_asyncio
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.bus.contract import EVENT_CAPACITY
from pointit.runtime.bus.instrumented import DurationWindow
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.service.plugin_guard import PluginHealth
from pointit.schemas import NS_PER_S, ButtonEvent, ClearSelection, Done, Health, ImuSample, KeyHealth
from pointit.schemas.problems import HANDLER
from pointit.schemas.system import DURATION_BOUNDS_S
from pointit.schemas.topics import BUTTON, CLEAR_SELECTION, HEALTH, IMU, SERVICE_ALIVE, USER_ALIVE
from tests.support.bench import ManualClock, until

LEVEL = (0.0, 0.0, 0.0, 1.0)


class Bench:
    def __init__(self) -> None:
        self.exchange = LocalBroker()
        self.bus = MemoryBus(self.exchange)
        self.clock = ManualClock()
        self.view = ServiceBus(self.bus, self.clock, "pointing", "pointing.anna", "anna")


@pytest.fixture
def now_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the monotonic time, s, as one item to be moved by hand."""
    now = [50.0]
    for module in ("service_bus", "instrumented"):
        monkeypatch.setattr(f"pointit.runtime.bus.{module}.steady_time", lambda: lambda: now[0])
    return now


@pytest_asyncio.fixture
async def bench(now_s: list[float]) -> AsyncIterator[Bench]:
    assert now_s
    bench = Bench()
    yield bench
    await bench.view.close()
    await bench.bus.close()


def of(health: Health, key: str, direction: str) -> KeyHealth:
    return next(entry for entry in health.keys if (entry.key, entry.direction) == (key, direction))


async def test_rates_and_ages(bench: Bench, now_s: list[float]) -> None:
    seen: list[int] = []
    bench.view.subscribe(IMU, lambda message, _name: seen.append(message.seq), "anna")
    out = bench.view.publisher(BUTTON, "anna")
    writer = bench.bus.publisher(IMU, "anna")
    silent = bench.view.report()
    assert (of(silent, IMU.key, "in").rate_hz, of(silent, IMU.key, "in").age_s) == (0, None)

    for seq in range(20):
        now_s[0] += 0.1
        writer.put(ImuSample(stamp_ns=1, seq=seq, orientation_xyzw=LEVEL))
        if seq % 2:
            out.put(ButtonEvent(stamp_ns=1))
        await asyncio.sleep(0)
    now_s[0] += 0.5

    health = bench.view.report()
    assert of(health, IMU.key, "in").rate_hz == pytest.approx(20 / 2.5)
    assert of(health, IMU.key, "in").age_s == pytest.approx(0.5)
    assert of(health, BUTTON.key, "out").rate_hz == pytest.approx(10 / 2.5)
    assert of(health, BUTTON.key, "out").age_s == pytest.approx(0.5)

    now_s[0] += 1
    later = bench.view.report()
    assert of(later, IMU.key, "in").rate_hz == 0
    assert of(later, IMU.key, "in").age_s == pytest.approx(1.5)
    assert later.seq == health.seq + 1
    assert later.uptime_s == pytest.approx(3.5)
    assert (health.service, health.instance, health.user) == ("pointing", "pointing.anna", "anna")


async def test_handler_fails_for_one_sender_only_and_health_names_them(bench: Bench) -> None:
    handled: list[str] = []

    def handle(_message: ImuSample, name: str) -> None:
        if name == "eve":
            raise KeyError("lamp")
        handled.append(name)

    bench.view.subscribe(IMU, handle)
    for name in ("anna", "eve", "ben"):
        bench.bus.publisher(IMU, name).put(ImuSample(stamp_ns=1, orientation_xyzw=LEVEL))
    await asyncio.sleep(0)
    health = bench.view.report()
    assert handled == ["anna", "ben"]
    assert (health.errors, health.status) == (1, "degraded")
    (problem,) = health.problems
    assert (problem.code, problem.topic, problem.subject) == (HANDLER, IMU.key, "eve")
    assert "the last of eve (KeyError: 'lamp')" in problem.sentence


async def test_problem_of_a_failing_handler_ends_and_outlives_its_subscription(
    bench: Bench, now_s: list[float]
) -> None:
    def handle(_message: ImuSample, _name: str) -> None:
        raise ValueError("no")

    subscription = bench.view.subscribe(IMU, handle)
    bench.bus.publisher(IMU, "eve").put(ImuSample(stamp_ns=1, orientation_xyzw=LEVEL))
    await asyncio.sleep(0)
    subscription.close()
    (problem,) = bench.view.report().problems
    assert problem.subject == "eve"
    now_s[0] += 6.0
    assert not bench.view.report().problems


async def test_age_of_tapped_messages_is_by_the_same_clock(bench: Bench, now_s: list[float]) -> None:
    bench.view.tap(IMU, lambda _message, _name: None)
    bench.bus.publisher(IMU, "anna").put(ImuSample(stamp_ns=1, orientation_xyzw=LEVEL))
    now_s[0] += 0.5
    assert of(bench.view.report(), IMU.key, "in").age_s == pytest.approx(0.5)


async def test_times_of_steps_and_of_the_data_put_out(bench: Bench, now_s: list[float]) -> None:
    durations = [0.001 * index for index in range(1, 101)]
    left = iter(durations)

    def step(message: ImuSample, _name: str) -> None:
        now_s[0] += next(left)
        bench.clock.time_ns = message.stamp_ns + 5_000_000 * (message.seq + 1)
        out.put(message)

    out = bench.view.publisher(IMU, "ben")
    bench.view.subscribe(IMU, step, "anna")
    writer = bench.bus.publisher(IMU, "anna")
    for seq in range(100):
        writer.put(ImuSample(stamp_ns=bench.clock.now_ns(), seq=seq, orientation_xyzw=LEVEL))
        await asyncio.sleep(0)
    health = bench.view.report()
    assert health.step is not None
    assert health.latency is not None
    assert (health.step.p50_s, health.step.p99_s) == pytest.approx((0.050, 0.099))
    assert (health.latency.p50_s, health.latency.p99_s) == pytest.approx((0.250, 0.495))
    assert (sum(health.latency.counts), health.latency.sum_s) == pytest.approx((100, 25.25))
    assert bench.view.report().step is None, "of the time since the last report only"


@given(st.lists(st.floats(-1.0, 10.0) | st.sampled_from(DURATION_BOUNDS_S), min_size=1, max_size=100))
def test_counts_are_a_histogram_of_the_durations(values_s: list[float]) -> None:
    window = DurationWindow()
    window.values.extend(values_s)
    taken = window.take()
    assert taken is not None
    up_to = [sum(value_s <= bound_s for value_s in values_s) for bound_s in (*DURATION_BOUNDS_S, math.inf)]
    assert list(itertools.accumulate(taken.counts)) == up_to
    assert taken.sum_s == pytest.approx(sum(values_s))
    assert window.take() is None


async def test_drops_errors_and_broken_watchers_are_counted(bench: Bench) -> None:
    def fail(*_of: object, **_present: bool) -> None:
        raise RuntimeError("broken")

    bench.view.subscribe(BUTTON, fail)
    bench.view.watch(USER_ALIVE, fail)
    writer = bench.bus.publisher(BUTTON, "anna")
    for seq in range(EVENT_CAPACITY + 3):
        writer.put(ButtonEvent(stamp_ns=1, seq=seq))
    bench.bus.announce(USER_ALIVE, "anna")
    await until(lambda: bench.view.report().errors == EVENT_CAPACITY + 1)
    assert of(bench.view.report(), BUTTON.key, "in").dropped == 3


async def test_closed_declarations_are_forgotten_but_still_counted(bench: Bench, now_s: list[float]) -> None:
    async def unheard(_query: ClearSelection, _name: str) -> Done:
        return Done(message="")

    def fail(message: ImuSample, _name: str) -> None:
        if message.seq % 4 == 2:
            raise RuntimeError("broken")

    writer = bench.bus.publisher(IMU, "anna")

    async def come_and_go() -> list[weakref.ref[object]]:
        reader = bench.view.subscribe(IMU, fail, drops_late=lambda _sample: True)
        rest = (
            bench.view.serve(CLEAR_SELECTION, unheard, "anna"),
            bench.view.announce(USER_ALIVE, "anna"),
            bench.view.watch(USER_ALIVE, lambda _name, **_: None),
            bench.view.tap(IMU, lambda _message, _name: None),
        )
        for seq, stamp_ns in enumerate((10, 1, 10, 10)):  # one too old, one that fails
            now_s[0] += 0.01
            writer.put(ImuSample(stamp_ns=stamp_ns * NS_PER_S, seq=seq, orientation_xyzw=LEVEL))
            await asyncio.sleep(0)

        await until(lambda: reader.traffic.received == 4)
        for each in (reader, *rest) * 2:  # the second time changes nothing
            each.close()
        return [weakref.ref(each) for each in (reader, *rest)]

    left: list[weakref.ref[object]] = []
    for times in range(1, 4):
        left += await come_and_go()
        report = bench.view.report()
        assert report.errors == times
        assert report.warnings[0].startswith(f"{times} messages on users/anna/imu were older")
    gc.collect()
    assert not [ref() for ref in left if ref() is not None]


async def test_warnings_stay_until_they_are_cleared(bench: Bench) -> None:
    assert bench.view.report().status == "ok"
    bench.view.warn("imu", "no samples; is the wristband on?")
    bench.view.warn("map", "no map")
    bench.view.warn("imu", "no samples for 2 s")
    for _ in range(2):
        health = bench.view.report()
        assert (health.status, health.warnings) == ("degraded", ("no samples for 2 s", "no map"))
    bench.view.clear("imu")
    bench.view.clear("never warned")
    assert bench.view.report().warnings == ("no map",)
    bench.view.warn("map", "")
    assert bench.view.report().status == "ok"


class Order:
    """Stands for something declared; notes when it is closed, and may fail to."""

    def __init__(self, name: str, closed: list[str], error: Exception | None = None) -> None:
        self.name = name
        self.closed = closed
        self.error = error

    def close(self) -> None:
        self.closed.append(self.name)
        if self.error is not None:
            raise self.error

    def close_nowait(self) -> None:
        self.close()


async def test_plugin_reaches_neither_the_bus_nor_what_others_show(bench: Bench) -> None:
    one = PluginHealth(bench.view, "one")
    other = PluginHealth(bench.view, "other")
    assert {name for name in dir(one) if not name.startswith("_")} == {
        "warn",
        "clear",
        "set_metric",
        "reached",
    }

    bench.view.warn("mounting", "the service's own")
    bench.view.set_metric("drift", 1.0)
    for part, value in ((one, 2.0), (other, 3.0)):
        part.warn("mounting", f"of {value}")
        part.set_metric("drift", value)
    one.set_metric("battery", 82.0, "%")

    health = bench.view.report()
    assert set(health.warnings) == {"the service's own", "of 2.0", "of 3.0"}
    metrics = {figure.name: figure.value for figure in health.figures}
    assert metrics == {"drift": 1.0, "drift of one": 2.0, "drift of other": 3.0, "battery": 82.0}

    one.warn("mounting", "")
    other.clear("mounting")
    one.set_metric("drift", None)
    health = bench.view.report()
    assert set(health.warnings) == {"the service's own"}
    assert {figure.name for figure in health.figures} == {"drift", "drift of other", "battery"}


async def test_closing_is_in_reverse_and_presence_last(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[str] = []
    made = {
        "announce": Order("presence", closed),
        "publisher": Order("publisher", closed),
        "watch": Order("watch", closed, LookupError("broken")),
    }

    def give(order: Order) -> Callable[[object, object], Order]:
        return lambda _row, _more: order

    for method, order in made.items():
        monkeypatch.setattr(bench.bus, method, give(order))
    bench.view.publisher(IMU, "anna")
    bench.view.announce(SERVICE_ALIVE, "pointing.anna")
    bench.view.watch(USER_ALIVE, lambda _name, **_: None)
    bench.view.account(HEALTH)
    with pytest.raises(LookupError):
        await bench.view.close()
    assert closed == ["watch", "publisher", "publisher", "presence"]
    await bench.view.close()
    assert len(closed) == 4


async def test_failing_timer_is_counted_and_reported_once_a_second(
    bench: Bench, now_s: list[float], caplog: pytest.LogCaptureFixture
) -> None:
    def fail() -> None:
        raise RuntimeError("broken")

    for _ in range(3):
        bench.view.call_later(0, fail)
    await until(lambda: bench.view.report().errors == 3)
    now_s[0] += 1.5
    bench.view.call_later(0, fail)
    await until(lambda: bench.view.report().errors == 4)
    said = [record for record in caplog.records if "timer of pointing.anna failed" in record.message]
    assert len(said) == 2
    assert all(record.exc_info for record in said)


async def test_timer_ends_with_its_service_or_when_cancelled(bench: Bench) -> None:
    called: list[str] = []
    bench.view.call_later(0, lambda: called.append("first"))
    await until(lambda: called == ["first"])
    bench.view.call_later(0.01, lambda: called.append("cancelled")).cancel()
    pending = bench.view.call_later(0.01, lambda: called.append("closed"))
    await bench.view.close()
    assert pending.cancelled()
    await asyncio.sleep(0.03)
    assert called == ["first"]


async def test_a_played_recording_is_left_out_and_reported(bench: Bench, now_s: list[float]) -> None:
    seen: list[int] = []
    bench.view.subscribe(IMU, lambda message, _name: seen.append(message.seq), "anna")
    writer = bench.bus.publisher(IMU, "anna")
    for seq in range(10):
        now_s[0] += 0.02
        for stamp_ns, number in ((10_000_000_000 + seq, seq), (1_000_000_000 + seq, 100 + seq)):
            writer.put(ImuSample(stamp_ns=stamp_ns, seq=number, orientation_xyzw=LEVEL))
            await asyncio.sleep(0)

    await until(lambda: len(seen) == 10)
    assert seen == list(range(10))
    report = bench.view.report()
    assert report.status == "degraded"
    assert report.warnings[0].startswith("10 messages on users/anna/imu were older than those before them")

    (problem,) = report.problems
    assert (problem.code, problem.topic, problem.sentence) == ("late", IMU.key, report.warnings[0])
    now_s[0] += 4.0
    assert bench.view.report().warnings

    now_s[0] += 2.0
    assert not bench.view.report().warnings


async def test_message_far_ahead_does_not_make_others_old(bench: Bench) -> None:
    stamps_ns = [10_000_000_000, 20_000_000_000, 10_020_000_000, 10_040_000_000]
    seen: list[int] = []
    bench.view.subscribe(IMU, lambda message, _name: seen.append(message.stamp_ns), "anna")
    writer = bench.bus.publisher(IMU, "anna")
    for stamp_ns in stamps_ns:
        writer.put(ImuSample(stamp_ns=stamp_ns, orientation_xyzw=LEVEL))
        await asyncio.sleep(0)
    assert seen == stamps_ns
    assert not bench.view.report().warnings


async def test_messages_too_late_to_act_on_are_dropped_and_reported(bench: Bench, now_s: list[float]) -> None:
    acts: list[int] = []
    looks: list[int] = []

    def act(sample: ImuSample, _name: str) -> None:
        acts.append(sample.seq)

    bench.view.subscribe(IMU, act, "anna", drops_late=lambda sample: sample.seq != 20)
    bench.view.subscribe(IMU, lambda sample, _name: looks.append(sample.seq), "anna")
    writer = bench.bus.publisher(IMU, "anna")
    began_ns = bench.clock.now_ns()
    waits_s = [0.02] * 10 + [2.02] + [0.001] * 10  # ten in time, then eleven that a link has held up
    for seq, wait_s in enumerate(waits_s):
        now_s[0] += wait_s
        bench.clock.advance(wait_s)
        writer.put(ImuSample(stamp_ns=began_ns + seq * 20_000_000, seq=seq, orientation_xyzw=LEVEL))
        await asyncio.sleep(0)

    await until(lambda: len(looks) == len(waits_s))
    assert acts == [*range(10), 20], "the last one need not be in time"
    report = bench.view.report()
    assert report.status == "degraded"
    assert report.warnings[0].startswith("10 messages on users/anna/imu arrived after newer ones")
    assert "the last by 1.8 s" in report.warnings[0]

    now_s[0] += 6.0
    assert not bench.view.report().warnings
