"""An x-IMU3 by UDP: readings, cues to its command port, and announcements."""

import asyncio
import json
import struct

import pytest

from pointit.schemas import Feedback
from pointit.services.imu_bridge.network import ximu3
from pointit.services.imu_bridge.network.ximu3 import XIMU3, Ximu3Decoder, announced
from pointit.services.imu_bridge.sources import Battery, Reading
from pointit.services.imu_bridge.streams import ContentError
from pointit.testing.devices import UdpDevice
from pointit_lab.devices.serial_formats import ximu3_binary, ximu3_text
from tests.support.bench import until
from tests.support.buses import free_udp_port
from tests.support.running_source import phone_at, running

MANUAL = {
    "sync": 0,
    "name": "x-IMU3",
    "sn": "01234567",
    "ip": "192.168.1.1",
    "port": 7000,
    "send": 8000,
    "receive": 9000,
    "rssi": 100,
    "battery": 80,
    "status": 2,
}
"""Announcement of the user manual."""
QUATERNION = ximu3_binary("Q", 1_000_000, 1, 0, 0, 0)


async def test_messages_of_one_datagram_are_delivered_and_cues_answered() -> None:
    device = UdpDevice()
    try:
        await device.plug()
        async with running(XIMU3, port=device.program_port, commands=device.port) as run:
            both = QUATERNION + ximu3_text("B", 1, 50, 3.8, 0)
            async with asyncio.timeout(60.0):
                while not run.of(Reading):
                    await device.send(both)
                    await asyncio.sleep(0.01)
            assert run.of(Reading)[0].device_time_ns == 1_000_000_000
            await until(lambda: bool(run.of(Battery)))
            run.source.cue(Feedback(stamp_ns=0, seq=1, cue="selected", color=(255, 255, 255)))
            await until(lambda: device.datagrams == [b'{"colour":"FFFFFF"}\n', b'{"colour":null}\n'])
    finally:
        await device.unplug()
        device.close()


async def test_device_that_sends_angles_alone_is_used() -> None:
    async with running(XIMU3) as run, phone_at(run.port) as phone:
        await until(phone.saying(ximu3_text("A", 1, 0, 0, 0), lambda: bool(run.of(Reading))))


@pytest.mark.parametrize("data", [b"a\n" * 65, b"a" * 1501])
def test_datagram_that_would_take_long_is_refused(data: bytes) -> None:
    with pytest.raises(ContentError, match="more than"):
        Ximu3Decoder().items(data, 0)


async def test_announced_devices_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_udp_port()
    monkeypatch.setattr(ximu3, "ANNOUNCEMENTS", port)
    async with phone_at(port) as phone:
        searching = asyncio.create_task(ximu3.discover(1.0))
        await until(phone.saying(json.dumps(MANUAL).encode(), searching.done))
        assert [device.address for device in searching.result()] == ["127.0.0.1"]


def test_announcement_of_the_manual_is_read() -> None:
    found = announced(json.dumps(MANUAL).encode(), "192.168.1.1")
    assert found is not None
    assert (
        found.label
        == "x-IMU3 01234567, battery 80 %; it sends to UDP port 8000; --set imu-bridge.ximu3.host=0.0.0.0"
    )
    assert found.details["battery_percent"] == 80


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{",
        b"[]",
        b"{}",
        b"\xff",
        b'{"name":"x","battery":"full","send":1}',
        b'{"name":"x","battery":NaN,"send":1}',
        b'{"name":"x","battery":1' + b"0" * 400 + b',"send":1}',
    ],
)
def test_anything_else_is_no_announcement(data: bytes) -> None:
    assert announced(data, "192.168.1.1") is None


@pytest.mark.parametrize("letter", ["L", "E"])
async def test_device_that_sends_accelerations_with_its_quaternion_is_used(letter: str) -> None:
    ascii_message = f"{letter},1000000,0.6,0.64,0.0,-0.48,0.1,0.2,0.3\r\n".encode()
    numbers = struct.pack("<Q7f", 2_000_000, 0.6, 0.64, 0.0, -0.48, 0.1, 0.2, 0.3)
    escaped = numbers.replace(b"\xdb", b"\xdb\xdd").replace(b"\n", b"\xdb\xdc")
    binary = bytes([0x80 | ord(letter)]) + escaped + b"\n"
    for time_ns, message in ((1_000_000_000, ascii_message), (2_000_000_000, binary)):
        async with running(XIMU3) as run, phone_at(run.port) as phone:
            await until(phone.saying(message, lambda run=run: bool(run.of(Reading))))
        assert run.of(Reading)[0].device_time_ns == time_ns
        assert run.of(Reading)[0].world_from_sensor == pytest.approx((0.64, 0.0, -0.48, 0.6))


@pytest.mark.parametrize("more", [b"", b"B,1000000,55.0,3.9,0\r\n"])
async def test_device_that_sends_no_orientation_is_told_what_to_set(more: bytes) -> None:
    def is_told() -> bool:
        return "gets messages that have no orientation (" in run.warnings.get("silent", "")

    async with running(XIMU3) as run, phone_at(run.port) as phone:
        await until(phone.saying(b"L,1000000,0.1,0.2,0.3\r\n" + more, is_told))
        assert run.warnings["silent"].endswith("set the AHRS message type of the x-IMU3 to quaternion")
        quaternion = b"Q,1000000,1.0,0.0,0.0,0.0\r\n"
        await until(phone.saying(quaternion, lambda: "silent" not in run.warnings))
