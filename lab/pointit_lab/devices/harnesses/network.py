"""Harnesses of the wrists in the network."""

import asyncio
import json
import struct

from pointit.geometry.rotation import Quaternion
from pointit.services.imu_bridge.network.osc import OSC
from pointit.services.imu_bridge.network.slimevr import SLIMEVR
from pointit.services.imu_bridge.network.udp import UDP
from pointit.services.imu_bridge.network.ximu3 import XIMU3
from pointit.testing.devices import UdpDevice
from pointit.testing.imu import ImuHarness
from pointit_lab.devices.serial_formats import ximu3_quaternion

CALL_S = 0.1
"""Period of handshakes; real trackers call each second."""
ANSWER = b"\x03Hey OVR =D 5"


class SlimevrTracker(UdpDevice):
    """A SlimeVR tracker with one sensor: calls until it is answered."""

    def __init__(self) -> None:
        super().__init__()
        self._calls: asyncio.Task[None] | None = None

    async def plug(self) -> None:
        """Look for a server."""
        await super().plug()
        self._calls = asyncio.create_task(self._call())

    async def unplug(self) -> None:
        """Fall silent."""
        if self._calls is not None:
            self._calls.cancel()
            self._calls = None
        await super().unplug()

    async def _call(self) -> None:
        """Send handshakes until one is answered."""
        firmware = b"fake"
        head = struct.pack(">IQ7iB", 3, 0, 4, 0, 2, 0, 0, 0, 19, len(firmware))
        while not any(each.startswith(ANSWER) for each in self.datagrams):
            await super().send(head + firmware + bytes.fromhex("02000a0b0c0d"))
            await asyncio.sleep(CALL_S)


def slimevr_rotation(orientation_xyzw: Quaternion) -> bytes:
    """Return a rotation of sensor 0 without a number, as Wrangler sends it."""
    return struct.pack(">IQBB4fB", 17, 0, 0, 1, *orientation_xyzw, 0)


def osc_quaternion(orientation_xyzw: Quaternion) -> bytes:
    """Return NGIMU's message with an orientation."""
    x, y, z, w = orientation_xyzw
    return b"/quaternion\0,ffff\0\0\0" + struct.pack(">4f", w, x, y, z)


def json_quaternion(orientation_xyzw: Quaternion) -> bytes:
    """Return SensaGram's message with an orientation."""
    return json.dumps({"type": "android.sensor.rotation_vector", "values": orientation_xyzw}).encode()


SLIMEVR_HARNESS = ImuHarness(
    plugin=SLIMEVR,
    device=SlimevrTracker,
    parameters=lambda device: {"port": device.program_port},
    encode=slimevr_rotation,
    wrong_parameters=({"tracker": "left wrist"}, {"sensor": -1}, {"port": 0}),
)
OSC_HARNESS = ImuHarness(
    plugin=OSC,
    device=UdpDevice,
    parameters=lambda device: {"port": device.program_port},
    encode=osc_quaternion,
    wrong_parameters=({"address": "quaternion"}, {"order": "zyxw"}),
)
UDP_HARNESS = ImuHarness(
    plugin=UDP,
    device=UdpDevice,
    parameters=lambda device: {"port": device.program_port},
    encode=json_quaternion,
    wrong_parameters=({"port": 70_000}, {"sender": "my phone"}),
)
XIMU3_HARNESS = ImuHarness(
    plugin=XIMU3,
    device=UdpDevice,
    parameters=lambda device: {"port": device.program_port, "commands": device.port},
    encode=ximu3_quaternion,
    wrong_parameters=({"port": 0}, {"commands": 0}),
)
