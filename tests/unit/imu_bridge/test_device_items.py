"""Items of a source through imu-bridge: battery, connection, raw readings, time of capture; and cues back."""

import asyncio
import itertools

import pytest

from pointit.geometry import rotation, vector
from pointit.schemas import NS_PER_S, Feedback, Health, ImuSample
from pointit.schemas.topics import FEEDBACK, HEALTH, IMU
from pointit.services.imu_bridge.reading import (
    Battery,
    Disconnected,
    RawReading,
    Reading,
    Reconnected,
    Signal,
)
from tests.support.bench import Bench
from tests.unit.imu_bridge.puppet import Puppet, virtually

LEVEL = rotation.IDENTITY
NAN = float("nan")
OTHER = rotation.from_yaw(0.1)
INSTANCE = "imu-bridge.anna"


def figure(health: list[Health], name: str) -> float | None:
    return next((each.value for each in health[-1].figures if each.name == name), None)


def said(health: list[Health]) -> str:
    return " | ".join(health[-1].warnings)


def test_battery_and_signal_are_shown_and_the_battery_is_in_the_samples() -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        samples, health = bench.collect(IMU, "anna"), bench.collect(HEALTH, INSTANCE)
        puppet.give(Battery(0.62, 3.9), Signal(-71.0), Reading(bench.clock.now_ns(), LEVEL))
        await asyncio.sleep(3.0)
        assert samples[0].battery == 0.62
        assert (figure(health, "battery"), figure(health, "signal")) == (62.0, -71.0)
        puppet.give(Battery(0.06))
        await asyncio.sleep(2.0)
        assert "the battery of anna's wrist (page) is at 6%: charge it" in said(health)

    virtually(play)


def test_lost_connection_is_a_warning_until_it_is_back_and_silence_another() -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
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

    virtually(play)


@pytest.mark.parametrize(("again", "epoch"), [(Reconnected(keeps_yaw=True), 0), (Reconnected(), 1)])
def test_yaw_origin_is_new_after_a_reconnection_unless_the_device_kept_it(
    again: Reconnected, epoch: int
) -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        samples = bench.collect(IMU, "anna")
        for connected in (Reconnected(), again):
            puppet.give(connected, Reading(bench.clock.now_ns(), LEVEL))
            await asyncio.sleep(1.0)
        assert [sample.yaw_epoch for sample in samples] == [0, epoch]

    virtually(play)


def test_device_that_connects_ten_times_a_second_is_named() -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        health = bench.collect(HEALTH, INSTANCE)
        for _ in range(30):
            puppet.give(Reconnected(), Reading(bench.clock.now_ns(), LEVEL))
            await asyncio.sleep(0.1)
        assert "was connected 5 times within 10 s" in said(health)

    virtually(play)


def test_cue_of_the_person_reaches_the_device_at_once_and_that_of_others_does_not() -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        puppet.give(Reconnected())
        began_s = asyncio.get_running_loop().time()
        for user, haptic_ms in (("ben", (10,)), ("anna", (150,))):
            cue = Feedback(stamp_ns=bench.clock.now_ns(), seq=1, cue="selected", haptic_ms=haptic_ms)
            bench.put(FEEDBACK, cue, user)
        await asyncio.sleep(1.0)
        ((came_s, cue),) = puppet.cues
        assert cue.haptic_ms == (150,)
        assert came_s - began_s < 0.001  # of the 50 ms that people may not notice; the device needs the rest

    virtually(play)


def test_device_time_that_falls_again_and_again_is_not_used() -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        samples, health = bench.collect(IMU, "anna"), bench.collect(HEALTH, INSTANCE)
        for number in range(500):
            device_ns = (100 + number % 2 * 2) * NS_PER_S + number * 10_000_000
            puppet.give(Reading(bench.clock.now_ns(), LEVEL, device_ns))
            await asyncio.sleep(0.01)
        assert samples[-1].yaw_epoch <= 3
        assert samples[-1].device_time_ns is None
        await asyncio.sleep(1.5)
        assert "stands still, jumps, or is not as fast" in said(health)

    virtually(play)


def test_bursts_of_a_radio_are_stamped_with_the_times_of_capture() -> None:
    """Each 50 ms the five samples of that time arrive at once."""

    async def play(bench: Bench, puppet: Puppet) -> None:
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

    virtually(play)


def test_age_of_the_oldest_reading_of_a_second_is_shown_by_the_time_of_the_device() -> None:
    """In the last seconds, 40 readings wait for 10 to 400 ms, again and again."""

    async def play(bench: Bench, puppet: Puppet) -> None:
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

    virtually(play)


def test_clock_of_a_device_that_jumps_is_named() -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        health = bench.collect(HEALTH, INSTANCE)
        for number in range(300):
            device_s = number / 100 + (20.0 if number > 150 else 0.0)
            puppet.give(Reading(bench.clock.now_ns(), (LEVEL, OTHER)[number % 2], round(device_s * NS_PER_S)))
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.5)
        assert "the clock of anna's wrist (page) jumped by +20.0 s" in said(health)
        await asyncio.sleep(15.0)
        assert "jumped" not in said(health)

    virtually(play)


def test_raw_readings_of_a_sensor_at_rest_become_its_tilt() -> None:
    pytest.importorskip("vqf")
    gravity = rotation.rotate(rotation.inverse(rotation.from_azimuth_elevation(0.0, -0.4)), (0.0, 0.0, 9.81))

    async def play(bench: Bench, puppet: Puppet) -> None:
        samples, health = bench.collect(IMU, "anna"), bench.collect(HEALTH, INSTANCE)
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

    virtually(play)


def test_raw_readings_with_times_in_another_unit_are_fused_by_their_arrival() -> None:
    pytest.importorskip("vqf")

    async def play(bench: Bench, puppet: Puppet) -> None:
        samples, health = bench.collect(IMU, "anna"), bench.collect(HEALTH, INSTANCE)
        for number in range(1500):
            noise = 1e-4 * (number % 3)
            puppet.give(
                RawReading(bench.clock.now_ns(), (noise, 0.0, 0.0), (0.0, 0.0, 9.81), number * 10_000)
            )
            await asyncio.sleep(0.01)
        assert "is not as fast as this machine's" in said(health)
        assert samples[-1].stamp_ns > bench.clock.now_ns() - NS_PER_S // 10
        assert samples[-1].device_time_ns is None

    virtually(play)


@pytest.mark.parametrize(
    ("item", "words"),
    [
        (Battery(7.0), "battery level of 7"),
        (Signal(NAN), "nan dBm"),
        (RawReading(0, (NAN, 0.0, 0.0), (0.0, 0.0, 9.81)), "check its units"),
        (Reading(0, (0.0, 0.0, 0.0, 0.0)), "orientations of norm 0"),
        (Reading(0, (0.0, 0.0, NAN, 1.0)), "orientations of norm nan"),
    ],
)
def test_values_that_cannot_be_are_dropped_and_named(
    item: Battery | Signal | RawReading | Reading, words: str
) -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        samples, health = bench.collect(IMU, "anna"), bench.collect(HEALTH, INSTANCE)
        puppet.give(item)
        await asyncio.sleep(2.0)
        assert words in said(health)
        assert not samples

    virtually(play)
