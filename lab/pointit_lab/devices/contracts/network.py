"""Contracts of the wrists in the network."""

import asyncio
import json
import struct

from pointit.geometry.rotation import Quaternion
from pointit.services.imu_bridge.network.osc import OSC
from pointit.services.imu_bridge.network.slimevr import SLIMEVR
from pointit.services.imu_bridge.network.udp import UDP
from pointit.services.imu_bridge.network.ximu3 import XIMU3
from pointit.testing import ImuSourceContract, UdpDevice
from pointit_lab.devices.serial_formats import ximu3_quaternion

CALL_S = 0.1
"""Period of handshakes; real trackers call each second."""
ANSWER = b"\x03Hey OVR =D 5"


class FakeSlimevrTracker(UdpDevice):
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
        mac_address = bytes.fromhex("02000a0b0c0d")
        while not any(datagram.startswith(ANSWER) for datagram in self.datagrams):
            await super().send(head + firmware + mac_address)
            await asyncio.sleep(CALL_S)


def slimevr_rotation(orientation_xyzw: Quaternion) -> bytes:
    """Return a rotation of sensor 0 without a number, as Wrangler sends it."""
    return struct.pack(">IQBB4fB", 17, 0, 0, 1, *orientation_xyzw, 0)


def osc_quaternion(orientation_xyzw: Quaternion) -> bytes:
    """Return NGIMU's message with an orientation."""
    x, y, z, w = orientation_xyzw
    return b"/quaternion\0,ffff\0\0\0" + struct.pack(">4f", w, x, y, z)


class NetworkContract(ImuSourceContract):
    """Promises of a source that listens on a port."""

    device = UdpDevice

    def parameters(self, device: UdpDevice) -> dict[str, object]:
        return {"port": device.program_port}


class TestSlimeVr(NetworkContract):
    plugin = SLIMEVR
    wrong_parameters = ({"tracker": "left wrist"}, {"sensor": -1}, {"port": 0})
    device = FakeSlimevrTracker

    encode = staticmethod(slimevr_rotation)


class TestOsc(NetworkContract):
    plugin = OSC
    wrong_parameters = ({"address": "quaternion"}, {"order": "zyxw"})

    encode = staticmethod(osc_quaternion)


class TestUdp(NetworkContract):
    plugin = UDP
    wrong_parameters = ({"port": 70_000},)

    def encode(self, orientation_xyzw: Quaternion) -> bytes:
        """Return SensaGram's message with an orientation."""
        message = {"type": "android.sensor.rotation_vector", "values": orientation_xyzw}
        return json.dumps(message).encode()


class TestXimu3(NetworkContract):
    plugin = XIMU3
    wrong_parameters = ({"port": 0}, {"commands": 0}, {"sensor": "my wrist"})

    def parameters(self, device: UdpDevice) -> dict[str, object]:
        return {"port": device.program_port, "commands": device.port}

    def encode(self, orientation_xyzw: Quaternion) -> bytes:
        return ximu3_quaternion(orientation_xyzw)
