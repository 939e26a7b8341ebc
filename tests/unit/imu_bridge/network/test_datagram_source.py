"""Sources without a handshake beside senders that fall silent, flood, compete or send garbage."""

import json
from typing import Any

import pytest

from pointit.plugins import Disconnected, RawReading, Reading, Reconnected
from pointit.services.imu_bridge.network import datagram_source
from pointit.services.imu_bridge.network.datagram_source import SenderChoice
from pointit.services.imu_bridge.network.udp import UDP
from tests.support.bench import until
from tests.support.running_source import Phone, Running, phone_at, running

ONE, OTHER = (0.0, 0.0, 0.0, 1.0), (0.5, -0.5, 0.5, -0.5)


def content(orientation_xyzw: tuple[float, ...] = ONE) -> bytes:
    return json.dumps({"type": "android.sensor.rotation_vector", "values": orientation_xyzw}).encode()


def readings(wrist: Running) -> list[Any]:
    return [item.world_from_sensor for item in wrist.of(Reading)]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datagram_source, "STEP_S", 0.02)


async def test_of_two_senders_the_first_is_used_and_the_other_named() -> None:
    async with (
        running(UDP) as wrist,
        phone_at(wrist.port) as first,
        phone_at(wrist.port, "127.0.0.2") as second,
    ):
        await sends(wrist, first, content())

        def both() -> bool:
            first.say(content())
            second.say(content(OTHER))
            return "127.0.0.2 sends to port" in wrist.warnings.get("others", "")

        await until(both)
        assert set(readings(wrist)) == {ONE}


async def test_rates_of_a_phone_without_orientations_are_delivered_also_after_a_loss(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(datagram_source, "LOST_S", 0.2)
    acceleration, rate = (
        json.dumps({"type": f"android.sensor.{kind}", "values": [0.0, 0.0, value]}).encode()
        for kind, value in (("accelerometer", 9.81), ("gyroscope", 0.1))
    )
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:
        for connections in (1, 2):

            def is_read(connections: int = connections) -> bool:
                phone.say(acceleration)
                phone.say(rate)
                kinds = [type(item) for item in wrist.items]
                return kinds.count(Reconnected) == connections and kinds[-1] is RawReading

            def is_lost(connections: int = connections) -> bool:
                return len(wrist.of(Disconnected)) == connections

            await until(is_read)
            await until(is_lost)


async def test_named_sender_is_used() -> None:
    async with (
        running(UDP, sender="127.0.0.2") as wrist,
        phone_at(wrist.port) as first,
        phone_at(wrist.port, "127.0.0.2") as second,
    ):
        first.say(content())
        await sends(wrist, second, content(OTHER))
        assert set(readings(wrist)) == {OTHER}


async def test_sender_that_freezes_is_lost_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datagram_source, "LOST_S", 0.1)
    async with running(UDP) as wrist, phone_at(wrist.port) as phone:
        await until(lambda: "set udp.host=0.0.0.0" in wrist.warnings.get("silent", ""))
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


def test_senders_beyond_the_limit_are_forgotten_and_the_place_is_free_after_a_silence() -> None:
    senders = SenderChoice()
    assert senders.may_use("10.0.0.1", 0.0)
    senders.use("10.0.0.1", 0.0)
    for number in range(2, 200):
        assert not senders.may_use(f"10.0.0.{number}", 1.0)
    assert len(senders.others(1.0)) == datagram_source.MOST_OTHERS
    assert senders.others(7.0) == []
    assert not senders.may_use("10.0.0.2", 9.0)
    assert senders.may_use("10.0.0.2", 10.1)


async def sends(wrist: Running, phone: Phone, data: bytes) -> None:
    """Send `data` until a reading is delivered."""
    before = len(wrist.of(Reading))
    await until(phone.saying(data, lambda: len(wrist.of(Reading)) > before))
