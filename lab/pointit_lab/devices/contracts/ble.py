"""Contracts of the wrists by Bluetooth Low Energy: simulated wrists on a radio in memory."""

from collections.abc import Callable

from pointit.geometry.rotation import Quaternion
from pointit.services.imu_bridge.ble.metamotion import METAMOTION
from pointit.services.imu_bridge.ble.touch_sdk import TOUCH_SDK
from pointit.services.imu_bridge.ble.witmotion_ble import WITMOTION_BLE
from pointit.services.imu_bridge.ble.xsens_dot import XSENS_DOT
from pointit.testing import ImuSourceContract
from pointit_lab.devices.ble import BleDevice
from pointit_lab.devices.wrists.metamotion import SimulatedMetaMotion
from pointit_lab.devices.wrists.touch_sdk_watch import SimulatedTouchSdkWatch
from pointit_lab.devices.wrists.witmotion import SimulatedWitMotion
from pointit_lab.devices.wrists.wrist import SimulatedWrist
from pointit_lab.devices.wrists.xsens_dot import SimulatedXsensDot


class BleContract(ImuSourceContract):
    """Promises of a source by Bluetooth Low Energy, with a simulated wrist."""

    virtual_time = True
    wrist: Callable[[], SimulatedWrist]
    """Makes the simulated wrist."""

    def device(self) -> BleDevice:
        """Return a wrist that is not within reach."""
        return BleDevice(type(self).wrist())

    def encode(self, orientation_xyzw: Quaternion) -> bytes:
        return type(self).wrist().frame(orientation_xyzw)


class TestMetaMotion(BleContract):
    plugin = METAMOTION
    wrist = SimulatedMetaMotion
    wrong_parameters = ({"magnetometer": "perhaps"},)


class TestTouchSdk(BleContract):
    plugin = TOUCH_SDK
    wrist = SimulatedTouchSdkWatch
    wrong_parameters = ({"crown_sign": 0},)


class TestWitMotionBle(BleContract):
    plugin = WITMOTION_BLE
    wrist = SimulatedWitMotion
    wrong_parameters = ({"rate_hz": 30},)


class TestXsensDot(BleContract):
    plugin = XSENS_DOT
    wrist = SimulatedXsensDot
    wrong_parameters = ({"sensor": 7},)
