"""Sources without a handshake beside senders that fall silent, flood, compete or send garbage."""

import asyncio
import json
import socket
import time
from typing import Any

import pytest

from pointit.plugins import Disconnected, ImuSource, Press, RawReading, Reading, Reconnected
from pointit.services.imu_bridge.network import datagram_source
from pointit.services.imu_bridge.network.osc import OSC
from pointit.services.imu_bridge.network.udp import UDP
from pointit.services.imu_bridge.network.ximu3 import XIMU3
from pointit_lab.devices.contracts.network import osc_quaternion
from pointit_lab.devices.serial_formats import ximu3_quaternion
from tests.support.bench import until
from tests.support.running_source import Phone, Running, phone_at, running

pytestmark = pytest.mark.wall_time
ONE = (0.0, 0.0, 0.0, 1.0)
OTHER = (0.5, -0.5, 0.5, -0.5)
ACCELERATION = b'{"type": "android.sensor.accelerometer", "values": [0.0, 0.0, 9.81]}'
RATE = b'{"type": "android.sensor.gyroscope", "values": [0.0, 0.0, 0.1]}'


def content(orientation_xyzw: tuple[float, ...] = ONE) -> bytes:
    return json.dumps({"type": "android.sensor.rotation_vector", "values": orientation_xyzw}).encode()


def readings(wrist: Running) -> list[Any]:
    return [item.world_from_sensor for item in wrist.of(Reading)]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datagram_source, "STEP_S", 0.02)


@pytest.mark.parametrize(
    ("plugin", "mine", "others"),
    [
        (UDP, content(), content(OTHER)),
        (OSC, osc_quaternion(ONE), osc_quaternion(OTHER)),
        (XIMU3, ximu3_quaternion(ONE), ximu3_quaternion(OTHER)),
    ],
)
async def test_second_program_on_one_machine_is_named_and_not_used(
    plugin: ImuSource, mine: bytes, others: bytes
) -> None:
    async with running(plugin) as wrist, phone_at(wrist.port) as first, phone_at(wrist.port) as second:
        await sends(wrist, first, mine)

        def both() -> bool:
            first.say(mine)
            second.say(others)
            return f"127.0.0.1:{second.port} sends to port" in wrist.warnings.get("others", "")

        await until(both)
        assert set(readings(wrist)) == {ONE}
        assert wrist.of(Reconnected) == [Reconnected()]


async def test_program_that_changes_its_port_is_one_sender() -> None:
    async with running(UDP) as wrist:

        def said() -> bool:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.sendto(content(), ("127.0.0.1", wrist.port))
            return len(wrist.of(Reading)) > 20

        await until(said)
        assert len(wrist.of(Reconnected)) <= 2


async def test_waiting_datagrams_give_the_newest_orientation_and_each_event() -> None:
    """Before a press comes the orientation at which the button was pressed."""
    async with running(UDP, line="{t_us},{w},{x},{y},{z}") as wrist, phone_at(wrist.port) as phone:
        await sends(wrist, phone, b"1000,1,0,0,0")
        await asyncio.sleep(0.05)
        wrist.items.clear()
        sent_ns = time.time_ns()
        for number in range(40):
            phone.say(b"%d,0.6,0.8,0,0" % (1000 * number + 1002) if number < 39 else b"99000,0.8,0.6,0,0")
            if number % 4 == 0:
                phone.say(b"button")
        turns = 0
        while len(wrist.of(Press)) < 10:  # the loop turns until the socket is readable
            turns += 1
            await asyncio.sleep(0)

        assert turns < 5
        await until(lambda: len(wrist.items) > 20)
        assert [type(item) for item in wrist.items] == [*([Reading, Press] * 10), Reading]

        *pressed, newest = wrist.of(Reading)
        assert [each.device_time_ns for each in pressed] == [
            1000 * (1000 * number + 1002) for number in range(0, 40, 4)
        ]
        assert newest.device_time_ns == 99_000_000
        assert newest.world_from_sensor == pytest.approx((0.6, 0.0, 0.0, 0.8))
        assert sent_ns <= newest.stamp_ns <= time.time_ns()


async def test_waiting_rates_are_all_delivered() -> None:
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:
        for _ in range(20):
            phone.say(ACCELERATION)
            phone.say(RATE)
        await until(lambda: len(wrist.of(RawReading)) == 20)


async def test_readings_above_the_limit_leave_newest_orientation_and_events() -> None:
    """More than 1000 items a second would be refused for the rest of the second."""
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:
        await sends(wrist, phone, content())
        loop = asyncio.get_running_loop()
        presses = 0
        wrist.items.clear()
        begin_s = loop.time()
        while (passed_s := loop.time() - begin_s) < 0.5:
            if passed_s * 1900 > presses * 19:
                for _ in range(18):
                    phone.say(content())
                phone.say(b"button")
                presses += 1
            await asyncio.sleep(0)

        phone.say(content(OTHER))
        await until(lambda: readings(wrist)[-1] == OTHER)
        assert len(wrist.of(Press)) == presses
        assert len(wrist.of(Reading)) <= 500 * (loop.time() - begin_s) + 1 + presses


async def test_rates_of_a_phone_are_delivered_after_a_loss(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(datagram_source, "LOST_S", 0.2)
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:
        for connections in (1, 2):

            def is_read(connections: int = connections) -> bool:
                phone.say(ACCELERATION)
                phone.say(RATE)
                kinds = [type(item) for item in wrist.items]
                return kinds.count(Reconnected) == connections and kinds[-1] is RawReading

            def is_lost(connections: int = connections) -> bool:
                return len(wrist.of(Disconnected)) == connections

            await until(is_read)
            await until(is_lost)


async def test_named_sender_is_used() -> None:
    async with (
        running(UDP, sensor="127.0.0.2") as wrist,
        phone_at(wrist.port) as first,
        phone_at(wrist.port, "127.0.0.2") as second,
    ):
        first.say(content())
        await sends(wrist, second, content(OTHER))
        assert set(readings(wrist)) == {OTHER}


async def test_sender_that_freezes_is_lost_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datagram_source, "LOST_S", 0.1)
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:
        await until(lambda: "--set imu-bridge.udp.host=0.0.0.0" in wrist.warnings.get("silent", ""))
        await sends(wrist, phone, content())
        await until(lambda: bool(wrist.of(Disconnected)))
        assert wrist.of(Disconnected)[0].reason.startswith("127.0.0.1 sends nothing any more")
        await until(lambda: not wrist.warnings)
        await sends(wrist, phone, content())
        assert wrist.of(Reconnected) == [Reconnected(), Reconnected()]


async def test_garbage_is_named_and_a_good_datagram_still_arrives() -> None:
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:
        for data in (b"", b"\xff" * 2000, b"{", content((float("nan"),) * 4), content((0.0,) * 4)):
            phone.say(data)
        await until(
            lambda: "could not be read; the last, from 127.0.0.1," in wrist.warnings.get("unreadable", "")
        )
        await sends(wrist, phone, content())
        assert set(readings(wrist)) == {ONE}


async def test_flood_is_named_and_cut_back() -> None:
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:

        def flood() -> bool:
            for _ in range(100):
                phone.say(content())
            return "127.0.0.1 sends more than 2000" in wrist.warnings.get("flood", "")

        await until(flood)


async def sends(wrist: Running, phone: Phone, data: bytes) -> None:
    """Send `data` until a reading is delivered."""
    before = len(wrist.of(Reading))
    await until(phone.saying(data, lambda: len(wrist.of(Reading)) > before))
