"""imu-bridge with a page: its own source held back and going on, requests, mountings, what health says."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.schemas import (
    NS_PER_S,
    WRIST_PATIENCE_S,
    ButtonEvent,
    Health,
    ImuSample,
    SetMounting,
    SetYawOrigin,
    WristSample,
)
from pointit.schemas.topics import BUTTON, HEALTH, IMU, SERVICE_ALIVE, SET_MOUNTING, SET_YAW_ORIGIN, WRIST
from pointit.services.imu_bridge.arm_frame import MOUNTINGS
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.serial.detection import SerialConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.imu_bridge.simulated import SimulatedConfig
from pointit.services.imu_bridge.stored_mounting import PURPOSE, StoredMountings
from tests.support.bench import Bench, memory_bench, repeated, until
from tests.support.pty_device import pty_device

pytestmark = pytest.mark.wall_time
ANNA = "anna"
STILL = SimulatedConfig(azimuth_amplitude_deg=0, elevation_amplitude_deg=0, elevation_deg=-10)
AHEAD = rotation.from_azimuth_elevation(0.7, 0.2)


class Site:
    """A bridge on a bench, what it says, and a page that sends ten times a second while it is asked to."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.samples: list[ImuSample] = bench.collect(IMU, ANNA)
        self.presses: list[ButtonEvent] = bench.collect(BUTTON, ANNA)
        self.reports: list[Health] = bench.collect(HEALTH)

    def send(self, turned: Quaternion = AHEAD, *, ahead_s: float = 0.0, **fields: Any) -> WristSample:
        stamp_ns = self.bench.clock.now_ns() + round(ahead_s * 1e9)
        sample = WristSample(stamp_ns=stamp_ns, orientation_xyzw=turned, **fields)
        self.bench.put(WRIST, sample, ANNA)
        return sample

    @asynccontextmanager
    async def held(self, turned: Quaternion = AHEAD, **fields: Any) -> AsyncGenerator[None]:
        async with repeated(0.1, lambda: self.send(turned, **fields)):
            await until(lambda: bool(self.samples) and is_by_page(self.samples[-1], turned), what="the page")
            yield

    def figures(self) -> dict[str, float]:
        return {figure.name: figure.value for figure in self.reports[-1].figures} if self.reports else {}


def is_by_page(sample: ImuSample, turned: Quaternion = AHEAD) -> bool:
    """Whether a page's arm, or its phone worn as usual, is turned like this."""
    arms = (turned, rotation.multiply(turned, MOUNTINGS["phone"]))
    return any(sample.orientation_xyzw == pytest.approx(arm) for arm in arms)


@asynccontextmanager
async def site(**config: Any) -> AsyncGenerator[Site]:
    async with memory_bench(WallClock()) as bench:
        here = Site(bench)
        bench.start(ImuBridge, ImuBridgeConfig(**config), user=ANNA)
        await bench.settle()
        yield here


async def some_more(samples: list[ImuSample], that: Callable[[ImuSample], bool]) -> ImuSample:
    seen = len(samples)
    await until(lambda: any(map(that, samples[seen:])))
    return samples[-1]


async def test_the_own_device_is_held_back_while_a_page_has_the_wrist_and_goes_on_then() -> None:
    async with site(simulated=STILL) as here:
        await until(lambda: bool(here.samples), what="the simulated device")
        async with here.held():
            began = len(here.samples)
            await until(lambda: len(here.samples) > began + 3)
            assert all(is_by_page(sample) for sample in here.samples[began:])
            last_ns = here.samples[-1].stamp_ns
        await until(lambda: not is_by_page(here.samples[-1]), what="the device again")
        back = next(sample for sample in here.samples[began:] if not is_by_page(sample))
        assert back.stamp_ns - last_ns >= WRIST_PATIENCE_S * NS_PER_S
        assert [sample.seq for sample in here.samples] == list(range(1, len(here.samples) + 1))
        assert {sample.yaw_epoch for sample in here.samples} == {0}


async def test_a_page_is_waited_for_without_a_warning_and_its_sample_passed_on_with_all_it_says() -> None:
    async with site(source="page") as here:
        await until(lambda: len(here.reports) > 1)
        assert here.reports[-1].warnings == ()
        with pytest.raises(RefusedError, match="nothing moves the wrist"):
            await here.bench.bus.call(SET_YAW_ORIGIN, SetYawOrigin(), ANNA)
        assert here.samples == []
        sent = here.send(device="phone", battery=0.5, device_time_ns=12)
        await until(lambda: bool(here.samples))
        [sample] = here.samples
        assert (sample.stamp_ns, sample.seq) == (sent.stamp_ns, 1)
        assert (sample.battery, sample.device_time_ns, sample.yaw_epoch) == (0.5, 12, 1)


async def test_presses_of_the_device_are_held_back_and_its_restart_is_noticed(tmp_path: Path) -> None:
    with pty_device(tmp_path / "imu") as device:
        serial = SerialConfig(port=str(device.path), line="{t_us},{w},{x},{y},{z}")
        async with site(source="serial", serial=serial) as here:
            async with repeated(0.01, lambda: device.send(b"90000000,1,0,0,0\n")):
                await until(lambda: bool(here.samples))
            async with here.held():
                began = len(here.samples)
                device.send(b"button\n1000,1,0,0,0\n")  # it was switched off and on
                await until(lambda: len(here.samples) > began + 3)
                assert all(is_by_page(sample) for sample in here.samples[began:])
                assert {sample.yaw_epoch for sample in here.samples} == {0}
            async with repeated(0.01, lambda: device.send(b"2000,1,0,0,0\n")):
                await until(lambda: not is_by_page(here.samples[-1]))
            assert here.presses == []
            assert here.samples[-1].yaw_epoch == 1
            device.send(b"button\n")
            await until(lambda: len(here.presses) == 1)
            assert here.presses[0].seq == 1


async def test_a_simulated_person_beside_it_has_the_number_0() -> None:
    async with site(source="page") as here:
        token = here.bench.bus.announce(SERVICE_ALIVE, f"user-sim.{ANNA}")
        here.bench.bus.announce(SERVICE_ALIVE, "user-sim.ben").close()
        async with here.held(device="phone"):
            assert here.samples[-1].yaw_epoch == 1
        await asyncio.sleep(WRIST_PATIENCE_S + 0.1)
        async with here.held():
            assert (await some_more(here.samples, is_by_page)).yaw_epoch == 0
        token.close()
        async with here.held(device="phone"):
            await some_more(here.samples, lambda sample: sample.yaw_epoch == 1)
        await asyncio.sleep(WRIST_PATIENCE_S + 0.1)
        async with here.held():
            assert (await some_more(here.samples, is_by_page)).yaw_epoch == 1  # nobody else has moved it


@pytest.mark.parametrize("source", ["page", "simulated"])
async def test_the_phones_mounting_is_measured_kept_used_again_and_forgotten(source: str) -> None:
    turned = rotation.from_yaw(0.3)
    expected = rotation.multiply(MOUNTINGS["phone"], turned)
    relative = SetMounting(sensor_from_arm_xyzw=turned, is_relative=True)
    file = StateFile(StoredMountings, ANNA, PURPOSE)
    async with site(source=source, simulated=STILL) as here, here.held(device="phone"):
        bus = here.bench.bus
        epoch = here.samples[-1].yaw_epoch
        reply = await bus.call(SET_MOUNTING, relative, ANNA)
        assert reply.sensor_from_arm_xyzw == pytest.approx(expected)
        assert "as measured" in reply.message
        arm = rotation.multiply(AHEAD, expected)
        await some_more(here.samples, lambda sample: sample.orientation_xyzw == pytest.approx(arm))
        assert here.samples[-1].yaw_epoch == epoch + 1
        kept = file.read()
        assert kept is not None
        assert list(kept.by_source) == ["phone"]
    async with site(source=source, simulated=STILL) as here:
        here.send(device="phone")
        await some_more(here.samples, lambda sample: sample.orientation_xyzw == pytest.approx(arm))
        own = SetMounting(sensor_from_arm_xyzw=turned)
        reply = await here.bench.bus.call(SET_MOUNTING, SetMounting(), ANNA)
        assert reply.message == "the mounting is as configured (phone)"
        assert file.read() is None
        if source == "simulated":  # the device's own is another one
            await asyncio.sleep(WRIST_PATIENCE_S + 0.1)
            await here.bench.bus.call(SET_MOUNTING, own, ANNA)
            kept = file.read()
            assert kept is not None
            assert list(kept.by_source) == ["simulated"]


async def test_nothing_is_mounted_on_a_mouse() -> None:
    async with site(simulated=STILL) as here, here.held():
        with pytest.raises(RefusedError, match="mouse or ROS moves the wrist"):
            await here.bench.bus.call(SET_MOUNTING, SetMounting(), ANNA)


async def test_health_shows_the_device_of_the_page_and_its_battery() -> None:
    async with site(source="page") as here:
        async with here.held():
            await until(lambda: here.figures() == {"moved by a page's mouse or ROS": 1.0})
        await until(lambda: not here.figures())
        async with here.held(device="phone", battery=0.07):
            await until(lambda: bool(here.reports[-1].warnings))
            assert here.figures() == {"moved by a page's phone": 1.0, "battery of the phone": 7.0}
            assert "at 7%: plug it in" in here.reports[-1].warnings[0]
        await until(lambda: not here.figures() and not here.reports[-1].warnings)


async def test_a_page_whose_clock_is_ahead_is_said_and_late_samples_are_counted() -> None:
    async with site(source="page") as here:
        here.send(ahead_s=30.0)
        await until(lambda: bool(here.reports) and bool(here.reports[-1].warnings))
        assert "30.0 s ahead" in here.reports[-1].warnings[0]
        assert here.samples == []
        await until(lambda: not here.reports[-1].warnings)  # it went away
        here.send()
        await until(lambda: len(here.samples) == 1)
        here.send(ahead_s=-0.5)
        await until(lambda: here.figures().get("late samples of a page or ROS") == 1.0)
        assert len(here.samples) == 1
