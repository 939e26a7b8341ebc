"""The bridge of wrists and its pages."""

import asyncio
import itertools
import math
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import serial

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Context
from pointit.runtime.virtual_time import VirtualClock
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
from pointit.schemas.system import OWN_SOURCE
from pointit.schemas.topics import BUTTON, HEALTH, IMU, SERVICE_ALIVE, SET_MOUNTING, SET_YAW_ORIGIN, WRIST
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, WRAP_NS, YawEpoch
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.replay_source import ReplayConfig, ReplaySource
from pointit.services.imu_bridge.serial.detection import SerialConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.imu_bridge.simulated import SimulatedConfig, SimulatedDevice
from pointit.services.imu_bridge.sources import Item, Reading
from pointit.services.imu_bridge.stored_mounting import PURPOSE, StoredMountings
from tests.support.bench import PATIENCE_S, Bench, ManualClock, in_virtual_time, memory_bench, repeated, until
from tests.support.pty_device import PtyDevice, pty_device

pytestmark = pytest.mark.wall_time


def finger(sample: ImuSample) -> vector.Vec3:
    return rotation.rotate(sample.orientation_xyzw, (1.0, 0.0, 0.0))


def serial_config(path: Path, timeout_s: float = 3.0) -> ImuBridgeConfig:
    return ImuBridgeConfig.model_validate(
        {"source": "serial", "serial": SerialConfig(port=str(path), timeout_s=timeout_s)}
    )


def has_warning(reports: list[Health], text: str) -> bool:
    return bool(reports) and any(text in warning for warning in reports[-1].warnings)


async def send_until(device: PtyDevice, line: bytes, condition: Callable[[], bool], what: str) -> None:
    """Send `line` over and over: until the port is open, a real device talks to nobody as well."""
    async with repeated(0.01, lambda: device.send(line)):
        await until(condition, 3 * PATIENCE_S, what)


@pytest.mark.parametrize("mounting", ["plus_x", "minus_x", "metamotion"])
@in_virtual_time
async def test_simulated_samples_are_of_the_arm_whatever_the_mounting(mounting: str) -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        samples = bench.collect(IMU, "anna")
        config = ImuBridgeConfig.model_validate({"mounting": mounting})
        bench.start(ImuBridge, config, user="anna")
        await until(lambda: len(samples) >= 30)
        assert [sample.seq for sample in samples] == list(range(1, len(samples) + 1))
        device = SimulatedDevice(SimulatedConfig())
        start_ns = samples[0].stamp_ns
        for sample in samples:
            arm = rotation.rotate(device.arm((sample.stamp_ns - start_ns) / 1e9), (1.0, 0.0, 0.0))
            assert vector.angle_between(finger(sample), arm) < 0.01
        assert vector.angle_between(finger(samples[0]), finger(samples[-1])) > 0.05


async def test_yaw_request_is_refused_before_the_first_reading(tmp_path: Path) -> None:
    async with memory_bench(WallClock()) as bench:
        bench.start(ImuBridge, serial_config(tmp_path / "absent"), user="anna")
        await bench.settle()
        with pytest.raises(RefusedError, match="nothing yet"):
            await bench.bus.call(SET_YAW_ORIGIN, SetYawOrigin(), "anna")


def recording(tmp_path: Path, rows: Sequence[Sequence[float]]) -> Path:
    path = tmp_path / "rec.csv"
    path.write_text("t,qw,qx,qy,qz\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return path


async def test_replay_publishes_every_sample_at_its_time(tmp_path: Path) -> None:
    rows = [(5.0, 1, 0, 0, 0), (5.1, 1, 0, 0, 0), (5.3, 0, 0, 0, 1), (5.35, 0.6, 0, 0, 0.8)]
    clock = ManualClock()
    start_ns = clock.now_ns() + 50_000_000
    async with memory_bench(clock) as bench:
        samples = bench.collect(IMU, "anna")
        replay = ReplayConfig(recording=str(recording(tmp_path, rows)), start_ns=start_ns)
        bench.start(
            ImuBridge, ImuBridgeConfig.model_validate({"source": "replay", "replay": replay}), user="anna"
        )
        await asyncio.sleep(0.06)

        async def play(before: int, step_s: float, after: int) -> None:
            assert len(samples) == before  # not before its time
            clock.advance(step_s)
            await until(lambda: len(samples) == after)

        await play(0, 0.05, 1)
        await play(1, 0.1, 2)
        await play(2, 0.25, 4)  # late, and none is left out
        assert [(sample.stamp_ns - start_ns) / 1e6 for sample in samples] == [0, 100, 300, 350]
        assert [sample.orientation_xyzw for sample in samples] == [
            (0, 0, 0, 1),
            (0, 0, 0, 1),
            (0, 0, 1, 0),
            (0, 0, 0.8, 0.6),
        ]


@in_virtual_time
async def test_replay_loops_and_skips_samples_of_the_past(tmp_path: Path) -> None:
    rows = [(t / 10, 1.0, 0.0, 0.0, 0.0) for t in range(11)]
    clock = VirtualClock()
    start_ns = clock.now_ns() - 550_000_000
    replay = ReplayConfig(recording=str(recording(tmp_path, rows)), start_ns=start_ns, loop=True)
    stamps_ns: list[int] = []

    def deliver(item: Item) -> None:
        assert isinstance(item, Reading)
        stamps_ns.append(item.stamp_ns)

    running = asyncio.create_task(ReplaySource(replay, clock).run(deliver))
    await until(lambda: len(stamps_ns) >= 20)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert {b - a for a, b in itertools.pairwise(stamps_ns)} == {100_000_000}
    assert stamps_ns[0] - start_ns >= 600_000_000
    assert (stamps_ns[0] - start_ns) % 100_000_000 == 0


@in_virtual_time
async def test_replay_omits_lost_orientations(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rows = [(t / 10, float(t not in (3, 4)), 0.0, 0.0, 0.0) for t in range(11)]
    replay = ReplayConfig(recording=str(recording(tmp_path, rows)), lost="0")
    source = ReplaySource(replay, VirtualClock())
    items: list[Item] = []
    is_over = asyncio.Event()

    def deliver(item: Item) -> None:
        items.append(item)
        if len(items) == 9:
            is_over.set()

    running = asyncio.create_task(source.run(deliver))
    await is_over.wait()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert all(isinstance(item, Reading) and item.world_from_sensor == (0, 0, 0, 1) for item in items)
    assert "missing in 2 of 11 rows, 1 gap of up to 0.30 s" in caplog.text


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"source": "replay"}, "replay.recording: is missing"),
        ({"source": "replay", "replay": {"recording": "/absent.csv"}}, "/absent.csv"),
    ],
)
async def test_source_without_its_settings_is_refused(values: dict[str, object], said: str) -> None:
    config = ImuBridgeConfig.model_validate(values)
    clock = WallClock()
    bus = MemoryBus(LocalBroker())
    with pytest.raises(ConfigError, match=said):
        ImuBridge.validate_config(config)
    view = ServiceBus(bus, clock, "imu-bridge", "imu-bridge.anna", "anna")
    with pytest.raises(ConfigError, match=said):
        ImuBridge(config, Context(bus=view, clock=clock, user="anna"))
    await bus.close()


async def test_serial_lines_become_samples_and_buttons(tmp_path: Path) -> None:
    async with memory_bench(WallClock()) as bench:
        samples = bench.collect(IMU, "anna")
        presses = bench.collect(BUTTON, "anna")
        with pty_device(tmp_path / "imu") as device:
            serial = SerialConfig(port=str(device.path), line="{t_us},{w},{x},{y},{z}")
            config = ImuBridgeConfig.model_validate({"source": "serial", "serial": serial})
            bench.start(ImuBridge, config, user="anna")
            reports = bench.collect(HEALTH)
            line = b"0,0,1\n2000,0.6,0,0,0.8\n"
            await send_until(device, line, lambda: bool(samples), what="a sample")
            before_ns = samples[-1].stamp_ns
            device.send(b"3000,1,0,0,0\nbutton\n\xff\xfe\nbutton hold\n")

            await until(lambda: len(presses) == 2)
            assert samples[-1].device_time_ns == 3_000_000
            assert samples[-1].orientation_xyzw == (0, 0, 0, 1)
            assert before_ns <= samples[-1].stamp_ns <= WallClock().now_ns()
            assert samples[0].orientation_xyzw == pytest.approx((0, 0, 0.8, 0.6))
            assert [press.gesture for press in presses] == ["press", "hold"]
            await until(lambda: has_warning(reports, "is not text"))


async def test_port_of_another_program_is_not_shared(tmp_path: Path) -> None:
    async with memory_bench(WallClock()) as bench:
        reports = bench.collect(HEALTH)
        with pty_device(tmp_path / "imu") as device:
            holder = serial.Serial(str(device.path), exclusive=True)
            bench.start(ImuBridge, serial_config(device.path), user="anna")
            await until(lambda: has_warning(reports, "held by another program"))
            holder.close()
            await until(lambda: not reports[-1].warnings)


S = NS_PER_S


def test_falling_device_time_is_a_restart_unless_out_of_order() -> None:
    epoch = YawEpoch()
    assert epoch.read(100 * S) == 100 * S
    assert epoch.read(100 * S - S // 2) == 100 * S - S // 2
    assert epoch.read(101 * S) == 101 * S
    assert epoch.count == 0
    assert epoch.read(2 * S) == 2 * S
    assert epoch.count == 1
    epoch.read(3 * S)
    epoch.read(None)
    assert epoch.count == 1


def test_clock_of_32_bits_is_unwrapped() -> None:
    epoch = YawEpoch()
    before = epoch.read(WRAP_NS - S // 10)
    after = epoch.read(S // 10)
    assert before is not None
    assert after == before + S // 5
    assert epoch.count == 0
    epoch.read(100 * S)
    assert epoch.read(S) == S  # this one is a restart
    assert epoch.count == 1


def test_later_connections_raise_the_yaw_epoch_unlike_the_first() -> None:
    epoch = YawEpoch()
    epoch.reconnected()
    assert epoch.count == 0
    epoch.read(5 * S)
    epoch.reconnected()
    epoch.read(1 * S)  # it was restarted meanwhile: that is one change, not two
    assert epoch.count == 1


@pytest.mark.usefixtures("own_state")
async def test_yaw_epoch_rises_with_requests_that_turn_the_yaw() -> None:
    async with memory_bench(WallClock()) as bench:
        samples = bench.collect(IMU, "anna")
        still = SimulatedConfig(azimuth_amplitude_deg=0, elevation_amplitude_deg=0)
        config = ImuBridgeConfig.model_validate({"simulated": still, "yaw_origin_deg": 30})
        bench.start(ImuBridge, config, user="anna")
        await until(lambda: bool(samples), what="a sample")
        assert samples[-1].yaw_epoch == 0
        assert math.isclose(vector.azimuth(finger(samples[-1])), math.radians(-30))

        reply = await bench.bus.call(SET_YAW_ORIGIN, SetYawOrigin(yaw_rad=0.5), "anna")
        assert "28.6" in reply.message
        await until(lambda: samples[-1].yaw_epoch == 1, what="a new origin")
        assert math.isclose(vector.azimuth(finger(samples[-1])), 0.5, abs_tol=1e-9)

        asking = SetMounting(sensor_from_arm_xyzw=rotation.IDENTITY, is_relative=True)
        await bench.bus.call(SET_MOUNTING, asking, "anna")
        turned = SetMounting(sensor_from_arm_xyzw=rotation.from_yaw(0.3))
        await bench.bus.call(SET_MOUNTING, turned, "anna")
        await until(lambda: samples[-1].yaw_epoch > 1, what="a new mounting")
        assert {sample.yaw_epoch for sample in samples} == {0, 1, 2}


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
        """Return the figures of the last report, without the one that every report has."""
        known = {figure.name: figure.value for figure in self.reports[-1].figures} if self.reports else {}
        return {name: value for name, value in known.items() if name != OWN_SOURCE}


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


async def test_own_device_is_silent_while_a_page_moves_the_wrist() -> None:
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


async def test_page_sample_is_published_complete_and_its_absence_no_warning() -> None:
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


async def test_device_presses_are_dropped_and_restarts_noticed_beside_a_page(tmp_path: Path) -> None:
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


async def test_yaw_epoch_of_a_simulated_person_is_zero() -> None:
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
async def test_phone_mounting_is_measured_stored_reused_and_erased(source: str) -> None:
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


async def test_mounting_of_a_mouse_is_refused() -> None:
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


async def test_page_clock_ahead_is_warned_of_and_late_samples_counted() -> None:
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
