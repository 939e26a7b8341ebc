"""Wrists of other firmware over a Bluetooth stack that is not ours: each fault is told with its remedy."""

from typing import Any

import pytest
from bumble import att

from pointit.plugins import ImuSource
from pointit.services.imu_bridge.ble.metamotion import METAMOTION
from pointit.services.imu_bridge.ble.touch_sdk import TOUCH_SDK
from pointit.services.imu_bridge.ble.witmotion_ble import WITMOTION_BLE
from pointit.services.imu_bridge.ble.xsens_dot import XSENS_DOT
from pointit.services.imu_bridge.sources import Disconnected, RawReading, Reading
from pointit_lab.devices.wrists.metamotion import SimulatedMetaMotion
from pointit_lab.devices.wrists.touch_sdk_watch import SimulatedTouchSdkWatch
from pointit_lab.devices.wrists.witmotion import SimulatedWitMotion
from pointit_lab.devices.wrists.wrist import SimulatedWrist
from pointit_lab.devices.wrists.xsens_dot import SimulatedXsensDot
from tests.devices.ble_session import worn
from tests.support.bench import in_virtual_time

BATTERY = "0000180f-0000-1000-8000-00805f9b34fb"
LEVEL = "00002a19-0000-1000-8000-00805f9b34fb"
KINDS = [
    pytest.param(METAMOTION, SimulatedMetaMotion, id="metamotion"),
    pytest.param(TOUCH_SDK, SimulatedTouchSdkWatch, id="touch_sdk"),
    pytest.param(WITMOTION_BLE, SimulatedWitMotion, id="witmotion"),
    pytest.param(XSENS_DOT, SimulatedXsensDot, id="xsens"),
]


@pytest.mark.parametrize(("plugin", "kind"), KINDS)
@in_virtual_time
async def test_device_without_the_services_of_its_kind_is_named(
    plugin: ImuSource, kind: type[SimulatedWrist]
) -> None:
    fields: dict[str, Any] = {
        "service": BATTERY,
        "advertised_service": kind.advertised_service or kind.service,
        "characteristics": {LEVEL: ("read",)},
    }
    other = type("Other", (kind,), fields)()
    async with worn(plugin, other) as session:
        await session.until(lambda: bool(session.health.warnings))
        said = session.health.warnings["link"]
    assert "it lacks the characteristic" in said
    assert "update its firmware by its maker's app, or name another one" in said
    assert "Error" not in said


@in_virtual_time
async def test_device_that_refuses_commands_is_told_to_be_updated() -> None:
    def refuse(_self: object, _characteristic: str, _data: bytes) -> None:
        raise att.ATT_Error(att.ATT_WRITE_NOT_PERMITTED_ERROR)

    locked = type("Locked", (SimulatedXsensDot,), {"write": refuse})()
    async with worn(XSENS_DOT, locked) as session:
        await session.until(lambda: "link" in session.health.warnings)
        said = session.health.warnings["link"]
    assert "it refuses a command (" in said
    assert "Write Not Permitted): update its firmware by its maker's app" in said


@pytest.mark.parametrize(("plugin", "kind"), [KINDS[2], KINDS[3]])
@in_virtual_time
async def test_lost_sensor_is_told_and_read_again(plugin: ImuSource, kind: type[SimulatedWrist]) -> None:
    async with worn(plugin, kind()) as session:
        readings = (Reading, RawReading)
        await session.until(lambda: sum(len(session.of(each)) for each in readings) > 10)
        await session.wrist.vanish()
        await session.until(lambda: bool(session.of(Disconnected)))
        (lost,) = session.of(Disconnected)
        assert "has lost the connection: bring it near, or charge it" in lost.reason
        count = sum(len(session.of(each)) for each in readings)
        await session.wrist.appear()
        await session.until(lambda: sum(len(session.of(each)) for each in readings) > count + 10)
        assert not session.health.warnings
