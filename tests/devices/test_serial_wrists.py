"""Wrists of all serial formats in scenario_3, and the tests' messages against an independent decoder."""

import asyncio
import contextlib
import os
import time
import tty
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from itertools import count

import ximu3

import pointit
from pointit.geometry.rotation import Quaternion
from pointit.schemas import Feedback
from pointit.services.imu_bridge.serial.ximu3 import Ximu3Framer
from pointit.testing.devices import FakeDevice, PtyDevice
from pointit.testing.templates.imu_source.promises import SourcePromises
from pointit_lab.devices.serial_formats import (
    bno085_orientation,
    witmotion_quaternion,
    ximu3_binary,
    ximu3_quaternion,
    ximu3_text,
)
from tests.devices.red_segments import Follower
from tests.support.bench import repeated, until

RATE_HZ = 100.0
PATIENCE_S = 60.0
ONLY_RED = {"sequence": ["red"], "interval_s": 0.6, "length_m": 0.3, "count": 100, "initial": 8}
FORMATS: dict[str, Callable[[Quaternion], bytes]] = {
    "lines of text": SourcePromises().encode,
    "WitMotion": witmotion_quaternion,
    "BNO085 (UART-RVC)": bno085_orientation,
    "x-IMU3": lambda orientation: ximu3_quaternion(orientation, time.monotonic_ns() // 1000),
}


@asynccontextmanager
async def plugged(device: FakeDevice, packet: Callable[[], bytes]) -> AsyncGenerator[None]:
    """Have the device send a packet 100 times a second."""

    await device.plug()
    try:
        async with repeated(1 / RATE_HZ, lambda: device.send(packet())):
            yield
    finally:
        await device.unplug()


async def test_person_selects_with_wrists_of_each_format_on_one_port() -> None:
    with contextlib.closing(PtyDevice()) as device:
        settings = {"conveyor-sim.feeder": ONLY_RED}
        run = pointit.run("scenario_3", imu=[f"serial:{device.path}"], settings=settings)
        async with run as site, asyncio.timeout(PATIENCE_S):
            person = Follower(site)
            selections = site.selections("user1")
            reports = site.health("imu-bridge.user1")
            for name, encode in FORMATS.items():

                def packet(encode: Callable[[Quaternion], bytes] = encode) -> bytes:
                    return encode(person.orientation())

                async with plugged(device, packet):
                    async for event in selections:
                        person.done.add(event.object_id)
                        if event.event == "selected":
                            break
                    async for report in reports:
                        if f"port of {name}" in {figure.name for figure in report.figures}:
                            break


async def test_official_decoder_reads_the_messages_that_the_tests_send() -> None:
    device, program = os.openpty()
    for end in (device, program):
        tty.setraw(end)
    received: list[tuple[str, int, float]] = []
    connection = ximu3.Connection(ximu3.SerialConnectionConfig(os.ttyname(program), 115200, False))
    connection.add_quaternion_callback(lambda each: received.append(("Q", each.timestamp, each.w)))
    connection.add_inertial_callback(
        lambda each: received.append(("I", each.timestamp, each.accelerometer_z))
    )
    connection.add_euler_angles_callback(lambda each: received.append(("A", each.timestamp, each.yaw)))
    connection.add_battery_callback(lambda each: received.append(("B", each.timestamp, each.percentage)))
    connection.add_rssi_callback(lambda each: received.append(("W", each.timestamp, each.power)))
    connection.add_button_callback(lambda each: received.append(("O", each.timestamp, each.state)))
    sent = [
        ("Q", (1.0, 0.0, 0.0, 0.0), 1.0),
        ("I", (0.0, 0.0, 0.0, 0.0, 0.0, 1.0), 1.0),
        ("A", (1.0, 2.0, 3.0), 3.0),
        ("B", (75.0, 4.0, 0.0), 75.0),
        ("W", (100.0, -50.0), -50.0),
        ("O", (1.0,), 1.0),
    ]
    times_us = count(0x0ADB0A00)  # every time has bytes that must be stuffed
    expected: list[tuple[str, int, float]] = []
    try:
        connection.open()
        for encode in (ximu3_binary, ximu3_text):
            for letter, values, shown in sent * 20:
                time_us = next(times_us)
                os.write(device, encode(letter, time_us, *values))
                expected.append((letter, time_us, shown))
        await until(lambda: len(received) == len(expected))
    finally:
        connection.close()
        os.close(device)
        os.close(program)

    assert received == expected


def test_official_parser_reads_the_command_of_a_cue() -> None:
    begin, end = Ximu3Framer().cue(Feedback(stamp_ns=0, seq=1, cue="selected", color=(255, 0, 16)))
    first, last = (ximu3.CommandMessage.parse(each.decode().strip()) for each in (begin, end))
    assert first is not None
    assert (first.key, first.value) == ("colour", '"FF0010"')
    assert last is not None
    assert (last.key, last.value) == ("colour", "null")
