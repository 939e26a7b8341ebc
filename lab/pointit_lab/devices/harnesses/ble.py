"""Harnesses of the wrists by Bluetooth Low Energy: simulated wrists on a radio in memory."""

from pointit.services.imu_bridge.ble.metamotion import METAMOTION
from pointit.services.imu_bridge.ble.touch_sdk import TOUCH_SDK
from pointit.services.imu_bridge.ble.witmotion_ble import WITMOTION_BLE
from pointit.services.imu_bridge.ble.xsens_dot import XSENS_DOT
from pointit.testing.imu import ImuHarness
from pointit_lab.devices.ble import BleDevice, parameters
from pointit_lab.devices.wrists.metamotion import SimulatedMetaMotion
from pointit_lab.devices.wrists.touch_sdk_watch import SimulatedTouchSdkWatch
from pointit_lab.devices.wrists.witmotion import SimulatedWitMotion
from pointit_lab.devices.wrists.xsens_dot import SimulatedXsensDot

METAMOTION_HARNESS = ImuHarness(
    plugin=METAMOTION,
    device=lambda: BleDevice(SimulatedMetaMotion()),
    parameters=parameters,
    encode=SimulatedMetaMotion().frame,
    wrong_parameters=({"magnetometer": "perhaps"},),
    virtual_time=True,
)
TOUCH_SDK_HARNESS = ImuHarness(
    plugin=TOUCH_SDK,
    device=lambda: BleDevice(SimulatedTouchSdkWatch()),
    parameters=parameters,
    encode=SimulatedTouchSdkWatch().frame,
    wrong_parameters=({"crown_sign": 0},),
    virtual_time=True,
)
WITMOTION_BLE_HARNESS = ImuHarness(
    plugin=WITMOTION_BLE,
    device=lambda: BleDevice(SimulatedWitMotion()),
    parameters=parameters,
    encode=SimulatedWitMotion().frame,
    wrong_parameters=({"rate_hz": 30},),
    virtual_time=True,
)
XSENS_DOT_HARNESS = ImuHarness(
    plugin=XSENS_DOT,
    device=lambda: BleDevice(SimulatedXsensDot()),
    parameters=parameters,
    encode=SimulatedXsensDot().frame,
    wrong_parameters=({"address": 7},),
    virtual_time=True,
)
