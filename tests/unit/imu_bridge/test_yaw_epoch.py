"""New yaw origins are reported to other services: by request, mounting or restart."""

import asyncio
from pathlib import Path

import pytest

from pointit.geometry import rotation
from pointit.runtime.clock import WallClock
from pointit.schemas import NS_PER_S, SetMounting, SetYawOrigin
from pointit.schemas.topics import IMU, SET_MOUNTING, SET_YAW_ORIGIN
from pointit.services.imu_bridge.arm_frame import WRAP_NS, YawEpoch
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.serial import detection
from pointit.services.imu_bridge.serial.config import SerialConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.imu_bridge.simulated import SimulatedConfig
from tests.support.bench import memory_bench, until
from tests.support.pty_device import pty_device
from tests.unit.imu_bridge.test_imu_bridge import send_until

pytestmark = pytest.mark.wall_time

S = NS_PER_S


def test_a_device_time_that_falls_is_a_restart_and_disorder_is_none() -> None:
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


def test_a_clock_of_32_bits_that_wraps_goes_on() -> None:
    epoch = YawEpoch()
    before = epoch.read(WRAP_NS - S // 10)
    after = epoch.read(S // 10)
    assert before is not None
    assert after == before + S // 5
    assert epoch.count == 0
    epoch.read(100 * S)
    assert epoch.read(S) == S  # this one is a restart
    assert epoch.count == 1


def test_the_first_connection_is_none_and_each_later_one_is() -> None:
    epoch = YawEpoch()
    epoch.reconnected()
    assert epoch.count == 0
    epoch.read(5 * S)
    epoch.reconnected()
    epoch.read(1 * S)  # it was restarted meanwhile: that is one change, not two
    assert epoch.count == 1


@pytest.mark.usefixtures("own_state")
async def test_requests_that_turn_the_yaw_raise_it_and_others_do_not() -> None:
    async with memory_bench(WallClock()) as bench:
        samples = bench.collect(IMU, "anna")
        still = SimulatedConfig(azimuth_amplitude_deg=0, elevation_amplitude_deg=0)
        bench.start(ImuBridge, ImuBridgeConfig.model_validate({"simulated": still}), user="anna")
        await until(lambda: bool(samples), what="a sample")
        assert samples[-1].yaw_epoch == 0
        await bench.bus.call(SET_YAW_ORIGIN, SetYawOrigin(yaw_rad=0.5), "anna")
        await until(lambda: samples[-1].yaw_epoch == 1, what="a new origin")
        asking = SetMounting(sensor_from_arm_xyzw=rotation.IDENTITY, is_relative=True)
        await bench.bus.call(SET_MOUNTING, asking, "anna")
        turned = SetMounting(sensor_from_arm_xyzw=rotation.from_yaw(0.3))
        await bench.bus.call(SET_MOUNTING, turned, "anna")
        await until(lambda: samples[-1].yaw_epoch > 1, what="a new mounting")
        assert {sample.yaw_epoch for sample in samples} == {0, 1, 2}


async def test_a_serial_device_that_comes_back_or_is_restarted_raises_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with memory_bench(WallClock()) as bench:
        samples = bench.collect(IMU)
        with pty_device(tmp_path / "imu") as device:
            config = ImuBridgeConfig.model_validate(
                {"source": "serial", "serial": SerialConfig(port=str(device.path))}
            )
            bench.start(ImuBridge, config, user="anna")
            await send_until(device, b"9000000,1,0,0,0\n", lambda: bool(samples), what="a sample")
            assert samples[0].yaw_epoch == 0
            device.send(b"2000000,1,0,0,0\n")
            await until(lambda: samples[-1].yaw_epoch == 1, what="a restart")
            monkeypatch.setattr(detection, "SILENT_S", 0.3)
            await send_until(
                device, b"0.8,0,0,0.6\n", lambda: samples[-1].device_time_ns is None, what="a turn"
            )
            await asyncio.sleep(0.5)
            await send_until(device, b"1,0,0,0\n", lambda: samples[-1].yaw_epoch == 2, what="a start")
            device.unplug()
            device.plug()
            await send_until(
                device, b"9000000,1,0,0,0\n", lambda: samples[-1].yaw_epoch == 3, what="a reconnection"
            )
