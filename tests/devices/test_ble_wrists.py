"""A WitMotion sensor and an Xsens DOT over a complete Bluetooth stack that is not ours, in virtual time."""

import pytest

from pointit.geometry import rotation
from pointit.runtime.virtual_time import run_virtually
from pointit.services.imu_bridge.ble.witmotion_ble import WITMOTION_BLE
from pointit.services.imu_bridge.ble.xsens_dot import XSENS_DOT
from pointit.services.imu_bridge.sources import Battery, RawReading, Reading
from pointit.testing.imu import is_near
from pointit_lab.devices.wrists.witmotion import SimulatedWitMotion
from pointit_lab.devices.wrists.xsens_dot import SimulatedXsensDot
from tests.devices.ble_session import POSTURE, require_selection, worn
from tests.support.bench import in_virtual_time


@in_virtual_time
async def test_sensor_is_set_to_its_rate_and_delivers_raw_readings() -> None:
    sensor = SimulatedWitMotion()
    async with worn(WITMOTION_BLE, sensor, rate_hz=100, parameters={"rate_hz": 100}) as session:
        await session.until(lambda: len(session.of(RawReading)) >= 200)
        assert sensor.rate_code == 9
        up = rotation.rotate(rotation.inverse(POSTURE), (0.0, 0.0, 9.80665))
        assert session.of(RawReading)[-1].acceleration_mps2 == pytest.approx(up, abs=0.01)
        assert session.of(RawReading)[-1].angular_velocity_radps == (0.0, 0.0, 0.0)
        (battery,) = session.of(Battery)
        assert battery.volts == 3.93
        assert battery.level == pytest.approx(0.75)


def test_person_with_a_witmotion_sensor_selects_red_segments() -> None:
    run_virtually(require_selection("witmotion_ble", SimulatedWitMotion(), 50.0))


RATE_HZ = 60.0


@in_virtual_time
async def test_sensor_is_started_and_delivers_timed_quaternions_and_battery() -> None:
    sensor = SimulatedXsensDot()
    async with worn(XSENS_DOT, sensor, rate_hz=RATE_HZ) as session:
        await session.until(lambda: len(session.of(Reading)) >= 120)
        assert all(is_near(each.world_from_sensor, POSTURE) for each in session.of(Reading))
        assert session.of(Battery) == [Battery(0.87)]
        await session.end()
        assert not sensor.is_streaming
