"""The SlimeVR source beside trackers that fall silent, flood, compete or are not assigned."""

import contextlib
import socket
import struct
from typing import Any

import pytest

from pointit.plugins import Battery, Disconnected, Press, Reading, Reconnected
from pointit.schemas import Feedback
from pointit.services.imu_bridge.network import slimevr
from pointit.services.imu_bridge.network.slimevr import SLIMEVR
from pointit.services.imu_bridge.network.udp_server import ANY_HOST
from tests.support.bench import until
from tests.support.buses import free_udp_port
from tests.support.running_source import Phone, Running, phone_at, running

pytestmark = pytest.mark.wall_time
IDENTITY = (0.0, 0.0, 0.0, 1.0)
TURNED = (0.5, -0.5, 0.5, -0.5)
OWOTRACK = 13
BOARD = 1
BROADCAST = "127.255.255.255"


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slimevr, "STEP_S", 0.02)


def handshake(board: int, last: int) -> bytes:
    firmware = b"owoTrack8" if board == OWOTRACK else b"0.6.0"
    mac = bytes((0x02, 0, 0, 0, 0, last)) if last else bytes(6)
    head = struct.pack(">IQ7iB", 3, 0, board, 0, 3 if board == OWOTRACK else 2, 0, 0, 0, 19, len(firmware))
    return head + firmware + mac


def rotation(number: int, orientation_xyzw: tuple[float, ...] = IDENTITY, sensor: int = 0) -> bytes:
    return struct.pack(">IQBB4fB", 17, number, sensor, 1, *orientation_xyzw, 0)


def readings(wrist: Running) -> list[Any]:
    return [item.world_from_sensor for item in wrist.of(Reading)]


async def connect(wrist: Running, phone: Phone, *, board: int = BOARD, last: int = 1) -> None:
    """Shake hands, and send the first rotation."""
    await until(
        phone.saying(handshake(board, last), lambda: any(each[:1] == b"\x03" for each in phone.heard))
    )
    before = len(wrist.of(Reading))
    phone.say(rotation(1000))
    await until(lambda: len(wrist.of(Reading)) > before)


@pytest.mark.parametrize(("board", "expected_s"), [(OWOTRACK, [0.15, 0.05]), (BOARD, [])])
async def test_phone_vibrates_in_a_cues_pattern_and_boards_do_not(
    board: int, expected_s: list[float]
) -> None:
    cue = Feedback(stamp_ns=1, seq=1, cue="selected", haptic_ms=(150, 20, 50))
    async with running(SLIMEVR) as wrist, phone_at(wrist.port) as phone:
        wrist.source.cue(cue)  # before there is any
        await connect(wrist, phone, board=board)
        wrist.source.cue(cue)
        phone.say(struct.pack(">IQB", 22, 1001, 0))
        await until(lambda: bool(phone.of_kind(22)))  # answered in order
        await until(lambda: len(phone.of_kind(2)) == len(expected_s))
        commands = [struct.unpack(">Ifff", each) for each in phone.of_kind(2)]
        assert [duration_s for _, duration_s, _, _ in commands] == pytest.approx(expected_s)
        assert all(amplitude == 1.0 for *_, amplitude in commands)


async def test_nan_zeros_and_late_datagrams_are_dropped_and_named() -> None:
    async with running(SLIMEVR) as wrist, phone_at(wrist.port) as phone:
        await connect(wrist, phone)
        for number, content in (
            (1001, (float("nan"),) * 4),
            (1002, (0.0,) * 4),
            (999, TURNED),
            (1003, TURNED),
        ):
            phone.say(rotation(number, content))
        await until(lambda: len(readings(wrist)) > 1)
        phone.say(struct.pack(">IQB", 60, 1004, 0))
        await until(lambda: bool(wrist.of(Press)))
        assert readings(wrist) == [IDENTITY, TURNED]
        await until(lambda: wrist.warnings.get("unreadable", "").startswith("2 packets of the tracker"))


async def test_battery_is_reported_on_change_and_after_a_reconnection() -> None:
    async with running(SLIMEVR) as wrist, phone_at(wrist.port) as phone:
        await connect(wrist, phone)
        for number, level in ((1001, 0.5), (1002, 0.5), (1003, 0.25)):
            phone.say(struct.pack(">IQf", 12, number, level))
        await until(lambda: len(wrist.of(Battery)) == 2)
        phone.say(handshake(BOARD, 1))
        phone.say(struct.pack(">IQf", 12, 1004, 0.25))
        await until(lambda: len(wrist.of(Battery)) == 3)
        assert wrist.of(Reconnected) == [Reconnected(), Reconnected(keeps_yaw=True)]
        assert [each.level for each in wrist.of(Battery)] == [0.5, 0.25, 0.25]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2"], ids=["behind one router", "beside it"])
async def test_first_of_two_phones_without_a_mac_is_used(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A router that translates addresses leaves them the port alone."""
    monkeypatch.setattr(slimevr, "SILENT_S", 0.0)
    async with running(SLIMEVR) as wrist, phone_at(wrist.port) as first, phone_at(wrist.port, host) as second:
        place = f"{host}:{second.port}" if host == "127.0.0.1" else host
        await connect(wrist, first, board=OWOTRACK, last=0)

        def both() -> bool:
            first.say(rotation(0))
            second.say(handshake(OWOTRACK, 0))
            second.say(rotation(0, TURNED))
            return f"{place} (owoTrack8)" in wrist.warnings.get("tracker", "")

        await until(both)
        assert not second.heard
        assert set(readings(wrist)) == {IDENTITY}
        assert "call and are not assigned" in wrist.warnings["tracker"]
        assert "another person's app needs another slimevr.port" in wrist.warnings["tracker"]


@pytest.mark.skipif(not hasattr(socket, "SO_REUSEPORT"), reason="no port can be shared here")
async def test_people_share_a_port_and_get_their_own_phones_data() -> None:
    """By chance, a phone's datagrams would reach the right one of four sources in one of four cases."""
    port = free_udp_port()
    addresses = [f"127.0.0.{number}" for number in (2, 3, 4, 5)]
    async with contextlib.AsyncExitStack() as stack:
        pairs = [
            (
                await stack.enter_async_context(running(SLIMEVR, port=port, host=ANY_HOST, tracker=address)),
                await stack.enter_async_context(phone_at(port, address)),
            )
            for address in addresses
        ]

        def all_answered() -> bool:
            for _, phone in pairs:
                phone.say(handshake(OWOTRACK, 0), BROADCAST)
            return all(phone.heard for _, phone in pairs)

        await until(all_answered)
        for number in range(1, 21):
            for _, phone in pairs:
                phone.say(rotation(2 * number))
                phone.say(struct.pack(">IQB", 60, 2 * number + 1, 0))  # of orientations the newest counts
        await until(lambda: all(len(wrist.of(Press)) == 20 and wrist.of(Reading) for wrist, _ in pairs))


async def test_tracker_that_freezes_is_lost_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slimevr, "LOST_S", 0.1)
    async with running(SLIMEVR) as wrist, phone_at(wrist.port) as phone:
        await until(lambda: "--set imu-bridge.slimevr.host=0.0.0.0" in wrist.warnings.get("tracker", ""))
        await connect(wrist, phone)
        await until(lambda: bool(wrist.of(Disconnected)))
        assert "02:00:00:00:00:01 (0.6.0 at 127.0.0.1) is out of reach" in wrist.of(Disconnected)[0].reason
        assert not wrist.warnings
        phone.say(rotation(1050))
        await until(lambda: len(readings(wrist)) == 2)
        assert wrist.of(Reconnected)[-1] == Reconnected(keeps_yaw=True)


async def test_sensor_that_the_tracker_lacks_is_named() -> None:
    async with running(SLIMEVR, sensor=3) as wrist, phone_at(wrist.port) as phone:
        await until(phone.saying(handshake(BOARD, 1), lambda: bool(phone.heard)))

        def told() -> bool:
            phone.say(rotation(0))
            return "has no sensor 3, but 0: --set imu-bridge.slimevr.sensor=0" in wrist.warnings.get(
                "number", ""
            )

        await until(told)


async def test_fault_of_a_sensor_is_named_until_it_works_again() -> None:
    async with running(SLIMEVR) as wrist, phone_at(wrist.port) as phone:
        await connect(wrist, phone)
        phone.say(struct.pack(">IQBB", 14, 1001, 0, 5))
        await until(lambda: "sensor 0 reports the error 5" in wrist.warnings.get("sensor", ""))
        phone.say(struct.pack(">IQBB", 15, 1002, 0, 1))
        await until(lambda: "sensor" not in wrist.warnings)


@pytest.mark.parametrize(
    ("given", "kept"), [("a4-e5-7c-b6-01-02", "A4:E5:7C:B6:01:02"), ("192.168.1.5", "192.168.1.5"), ("", "")]
)
def test_address_of_a_tracker_is_a_mac_or_an_ip(given: str, kept: str) -> None:
    assert SLIMEVR.config.model_validate({"tracker": given}).model_dump()["tracker"] == kept


async def test_tracker_that_sends_no_rotation_is_named_with_its_packets() -> None:
    acceleration = struct.pack(">IQ3fB", 4, 1000, 0.0, 0.0, 9.81, 0)
    async with running(SLIMEVR) as wrist, phone_at(wrist.port) as phone:
        await until(
            phone.saying(handshake(BOARD, 1), lambda: any(each[:1] == b"\x03" for each in phone.heard))
        )
        await until(phone.saying(acceleration, lambda: "kinds" in wrist.warnings))
        assert "of kind 4): update its firmware" in wrist.warnings["kinds"]
        await connect(wrist, phone)
        await until(lambda: "kinds" not in wrist.warnings)
