"""Items of a source through imu-bridge: battery, connection, raw readings, time of capture; and cues back."""

import asyncio
import itertools
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from unittest import mock

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.runtime.config.config import Config
from pointit.runtime.service.plugin_guard import HealthSink, NullHealth, Surroundings
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import NS_PER_S, Feedback, Health, ImuSample
from pointit.schemas.topics import FEEDBACK, HEALTH, IMU
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.imu_bridge.sources import (
    SOURCES,
    Battery,
    Deliver,
    Disconnected,
    ImuSource,
    Item,
    Press,
    RawReading,
    Reading,
    Reconnected,
    Signal,
)
from tests.support.bench import Bench, memory_bench

LEVEL = rotation.IDENTITY
NAN = float("nan")
OTHER = rotation.from_yaw(0.1)
INSTANCE = "imu-bridge.anna"


class Puppet:
    """Delivers what a test says, and remembers cues with their time."""

    def __init__(self) -> None:
        self.deliver: Deliver | None = None
        self.health: HealthSink = NullHealth()
        self.cues: list[tuple[float, Feedback]] = []

    async def run(self, deliver: Deliver) -> None:
        self.deliver = deliver
        await asyncio.Event().wait()

    def cue(self, cue: Feedback) -> None:
        self.cues.append((asyncio.get_running_loop().time(), cue))

    def give(self, *items: Item) -> None:
        assert self.deliver is not None
        for item in items:
            self.deliver(item)


def figure(health: list[Health], name: str) -> float | None:
    return next((each.value for each in health[-1].figures if each.name == name), None)


def said(health: list[Health]) -> str:
    return " | ".join(health[-1].warnings)


@asynccontextmanager
async def with_puppet() -> AsyncGenerator[tuple[Bench, Puppet]]:
    """Yield a bench with the wrist of anna, and its source."""
    puppet = Puppet()

    def make(_config: Config, around: Surroundings) -> Puppet:
        puppet.health = around.health
        return puppet

    source = ImuSource(summary="", config=Config, make=make)
    with mock.patch.object(SOURCES, "get", return_value=source):
        async with memory_bench(VirtualClock()) as bench:
            bench.start(ImuBridge, ImuBridgeConfig(source="page"), user="anna")
            await asyncio.sleep(0.1)
            yield bench, puppet


@pytest.fixture
async def worn() -> AsyncGenerator[tuple[Bench, Puppet]]:
    async with with_puppet() as both:
        yield both


@pytest.fixture
def bench(worn: tuple[Bench, Puppet]) -> Bench:
    return worn[0]


@pytest.fixture
def puppet(worn: tuple[Bench, Puppet]) -> Puppet:
    return worn[1]


async def test_battery_and_signal_are_metrics_and_the_battery_in_samples(
    bench: Bench, puppet: Puppet
) -> None:
    samples = bench.collect(IMU, "anna")
    health = bench.collect(HEALTH, INSTANCE)
    puppet.give(Battery(0.62, 3.9), Signal(-71.0), Reading(bench.clock.now_ns(), LEVEL))
    await asyncio.sleep(3.0)
    assert samples[0].battery == 0.62
    assert (figure(health, "battery"), figure(health, "signal")) == (62.0, -71.0)
    puppet.give(Battery(0.06))
    await asyncio.sleep(2.0)
    assert "the battery of anna's wrist (page) is at 6%: charge it" in said(health)


async def test_lost_connection_and_silence_are_warnings_of_their_own(bench: Bench, puppet: Puppet) -> None:
    health = bench.collect(HEALTH, INSTANCE)
    puppet.give(Reconnected(), Disconnected("the wrist is out of reach"))
    await asyncio.sleep(10.0)
    assert said(health) == "the wrist is out of reach"

    puppet.give(Reconnected())
    await asyncio.sleep(2.0)
    assert said(health) == ""

    await asyncio.sleep(5.0)
    assert "is connected, but has sent nothing for" in said(health)
    puppet.health.warn("others", "another device sends, too")
    await asyncio.sleep(2.0)
    assert "is connected, but has sent nothing for" in said(health)

    puppet.health.warn("silent", "not one byte comes")
    await asyncio.sleep(2.0)
    assert "is connected, but has sent nothing for" not in said(health)
    assert "not one byte comes" in said(health)

    puppet.health.clear("others")
    puppet.health.clear("silent")
    puppet.give(Reading(bench.clock.now_ns(), LEVEL))
    await asyncio.sleep(2.0)
    assert said(health) == ""


@pytest.mark.parametrize(("again", "epoch"), [(Reconnected(keeps_yaw=True), 0), (Reconnected(), 1)])
async def test_reconnection_renews_the_yaw_origin_unless_the_device_kept_it(
    again: Reconnected, epoch: int, bench: Bench, puppet: Puppet
) -> None:
    samples = bench.collect(IMU, "anna")
    for connected in (Reconnected(), again):
        puppet.give(connected, Reading(bench.clock.now_ns(), LEVEL))
        await asyncio.sleep(1.0)
    assert [sample.yaw_epoch for sample in samples] == [0, epoch]


async def test_cue_reaches_the_device_of_its_person_at_once(bench: Bench, puppet: Puppet) -> None:
    puppet.give(Reconnected())
    began_s = asyncio.get_running_loop().time()
    for user, haptic_ms in (("ben", (10,)), ("anna", (150,))):
        cue = Feedback(stamp_ns=bench.clock.now_ns(), seq=1, cue="selected", haptic_ms=haptic_ms)
        bench.put(FEEDBACK, cue, user)
    await asyncio.sleep(1.0)
    ((came_s, cue),) = puppet.cues
    assert cue.haptic_ms == (150,)
    assert came_s - began_s < 0.001  # of the 50 ms that people may not notice; the device needs the rest


async def test_device_time_that_falls_again_and_again_is_not_used(bench: Bench, puppet: Puppet) -> None:
    samples = bench.collect(IMU, "anna")
    health = bench.collect(HEALTH, INSTANCE)
    for number in range(500):
        device_ns = (100 + number % 2 * 2) * NS_PER_S + number * 10_000_000
        puppet.give(Reading(bench.clock.now_ns(), LEVEL, device_ns))
        await asyncio.sleep(0.01)
    assert samples[-1].yaw_epoch <= 3
    assert samples[-1].device_time_ns is None
    await asyncio.sleep(1.5)
    assert "stands still, jumps, or is not as fast" in said(health)


async def test_radio_bursts_are_stamped_with_their_times_of_capture(bench: Bench, puppet: Puppet) -> None:
    """Each 50 ms the five samples of that time arrive at once."""
    stamps: list[tuple[int, int]] = []

    def note(sample: ImuSample, _user: str) -> None:
        stamps.append((sample.stamp_ns, bench.clock.now_ns()))

    bench.bus.subscribe(IMU, note, "anna")
    for burst in range(200):
        await asyncio.sleep(0.05)
        for number in range(5):
            device_ms = 50 * burst + 10 * number
            puppet.give(Reading(bench.clock.now_ns(), (LEVEL, OTHER)[number % 2], device_ms * 1_000_000))
            for _ in range(5):  # so that the bus delivers each, not the newest
                await asyncio.sleep(0)
    settled = stamps[100:]
    assert len(stamps) == 1000
    steps_ns = [b[0] - a[0] for a, b in itertools.pairwise(settled)]
    assert all(abs(step_ns - NS_PER_S // 100) < 100_000 for step_ns in steps_ns)
    assert all(0 <= now_ns - stamp_ns < NS_PER_S // 20 for stamp_ns, now_ns in settled)


async def test_age_metric_is_of_the_oldest_reading_in_a_second(bench: Bench, puppet: Puppet) -> None:
    """In the last seconds, 40 readings wait for 10 to 400 ms, again and again."""
    health = bench.collect(HEALTH, INSTANCE)
    puppet.give(Reading(bench.clock.now_ns(), LEVEL))
    await asyncio.sleep(2.0)
    assert figure(health, "age") is None

    waiting: list[int] = []
    for number in range(700):
        waiting.append(number)
        if number < 300 or number % 50 >= 40:
            for each in waiting:
                device_ns = (500 + each) * 10_000_000
                puppet.give(Reading(bench.clock.now_ns(), (LEVEL, OTHER)[each % 2], device_ns))
            waiting.clear()
        await asyncio.sleep(0.01)
        if number == 299:
            assert figure(health, "age") == pytest.approx(0.0, abs=1.0)
    assert figure(health, "age") == pytest.approx(400.0, abs=5.0)


async def test_clock_of_a_device_that_jumps_is_named(bench: Bench, puppet: Puppet) -> None:
    health = bench.collect(HEALTH, INSTANCE)
    for number in range(300):
        device_s = number / 100 + (20.0 if number > 150 else 0.0)
        puppet.give(Reading(bench.clock.now_ns(), (LEVEL, OTHER)[number % 2], round(device_s * NS_PER_S)))
        await asyncio.sleep(0.01)
    await asyncio.sleep(1.5)
    assert "the clock of anna's wrist (page) jumped by +20.0 s" in said(health)
    await asyncio.sleep(15.0)
    assert "jumped" not in said(health)


async def test_raw_readings_of_a_sensor_at_rest_become_its_tilt(bench: Bench, puppet: Puppet) -> None:
    pytest.importorskip("vqf")
    gravity = rotation.rotate(rotation.inverse(rotation.from_azimuth_elevation(0.0, -0.4)), (0.0, 0.0, 9.81))
    samples = bench.collect(IMU, "anna")
    health = bench.collect(HEALTH, INSTANCE)
    for number in range(500):
        noise = 1e-4 * (number % 3)
        puppet.give(RawReading(bench.clock.now_ns(), (noise, 0.0, 0.0), gravity, number * 10_000_000))
        await asyncio.sleep(0.01)
    arm = rotation.rotate(samples[-1].orientation_xyzw, (1.0, 0.0, 0.0))
    assert abs(vector.elevation(arm) + 0.4) < 0.001
    await asyncio.sleep(1.5)
    assert figure(health, "resting") == 1.0
    assert (figure(health, "heading drift rate") or 99.0) < 10.0
    assert said(health) == ""


async def test_raw_readings_with_a_wrong_unit_are_fused_by_arrival(bench: Bench, puppet: Puppet) -> None:
    pytest.importorskip("vqf")
    samples = bench.collect(IMU, "anna")
    health = bench.collect(HEALTH, INSTANCE)
    for number in range(1500):
        noise = 1e-4 * (number % 3)
        puppet.give(RawReading(bench.clock.now_ns(), (noise, 0.0, 0.0), (0.0, 0.0, 9.81), number * 10_000))
        await asyncio.sleep(0.01)
    assert "is not as fast as this machine's" in said(health)
    assert samples[-1].stamp_ns > bench.clock.now_ns() - NS_PER_S // 10
    assert samples[-1].device_time_ns is None


@pytest.mark.parametrize(
    ("item", "words"),
    [
        (Battery(7.0), "battery level of 7"),
        (Signal(NAN), "nan dBm"),
        (RawReading(0, (NAN, 0.0, 0.0), (0.0, 0.0, 9.81)), "check its units"),
        (Reading(0, (0.0, 0.0, NAN, 1.0)), "orientations of norm nan"),
    ],
)
async def test_values_that_cannot_be_are_dropped_and_named(
    item: Battery | Signal | RawReading | Reading, words: str, bench: Bench, puppet: Puppet
) -> None:
    samples = bench.collect(IMU, "anna")
    health = bench.collect(HEALTH, INSTANCE)
    puppet.give(item)
    await asyncio.sleep(2.0)
    assert words in said(health)
    assert not samples


ANY = st.floats(width=32)
VECTORS = st.tuples(ANY, ANY, ANY) | st.just((0.0, 0.0, 9.81))
UNITS = st.floats(-math.pi, math.pi).map(rotation.from_yaw)
ORIENTATIONS = UNITS | st.tuples(ANY, ANY, ANY, ANY)
TIMES_NS = st.integers(-(2**70), 2**70) | st.integers(0, 10_000_000_000)
DEVICE_NS = st.none() | TIMES_NS


def items(now_ns: int) -> st.SearchStrategy[Item]:
    stamps_ns = st.just(now_ns) | TIMES_NS
    return st.one_of(
        st.builds(Reading, stamps_ns, ORIENTATIONS, DEVICE_NS),
        st.builds(RawReading, stamps_ns, VECTORS, VECTORS, DEVICE_NS),
        st.builds(Press, stamps_ns),
        st.builds(Battery, ANY),
        st.builds(Signal, ANY),
        st.builds(Reconnected, st.booleans()),
        st.builds(Disconnected, st.text(max_size=9)),
    )


@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.data())
@pytest.mark.slow
def test_device_that_delivers_anything_neither_stops_nor_disorders_the_samples(data: st.DataObject) -> None:
    async def play() -> None:
        async with with_puppet() as (bench, puppet):
            samples: list[ImuSample] = bench.collect(IMU, "anna")
            for _ in range(data.draw(st.integers(1, 40))):
                puppet.give(data.draw(items(bench.clock.now_ns())))
                await asyncio.sleep(data.draw(st.sampled_from((0.0, 0.01, 0.5, 4.0))))
            seen = len(samples)
            puppet.give(Reading(bench.clock.now_ns(), rotation.IDENTITY))
            await asyncio.sleep(0.1)
            assert len(samples) == seen + 1
            assert [sample.seq for sample in samples] == sorted({sample.seq for sample in samples})

    run_virtually(play())
