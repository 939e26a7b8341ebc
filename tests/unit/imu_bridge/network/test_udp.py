"""Formats of apps that send datagrams. Nothing here was tried with the apps themselves."""

import asyncio
import contextlib
import json
import math
import socket
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.udp import LONGEST_DATAGRAM, UdpConfig, UdpDecoder
from pointit.services.imu_bridge.network.udp_server import Address, UdpServer
from pointit.services.imu_bridge.sources import Item, Press, RawReading, Reading
from pointit.services.imu_bridge.streams import ContentError
from tests.support.bench import until
from tests.support.buses import free_udp_port
from tests.support.running_source import Health, phone_at

XYZW = (-0.5, 0.5, -0.5, 0.5)
NOW = 1_800_000_000 * NS_PER_S


def items(data: bytes | object, decoder: UdpDecoder | None = None, stamp_ns: int = NOW) -> list[Item]:
    content = data if isinstance(data, bytes) else json.dumps(data).encode()
    return list((decoder or UdpDecoder(UdpConfig())).items(content, stamp_ns))


def android(sensor: str, values: list[float], timestamp: int = 5 * NS_PER_S) -> dict[str, Any]:
    return {"type": f"android.sensor.{sensor}", "timestamp": timestamp, "values": values, "accuracy": 3}


def wearmocap(
    wxyz: tuple[float, ...], time: tuple[float, float, float, float] = (14.0, 30.0, 5.0, 250e6)
) -> bytes:
    return struct.pack(">28f", 0.01, *time, *wxyz, *[0.1] * 19)


def test_sensagram_sends_androids_rotation_vector() -> None:
    assert items(android("game_rotation_vector", [*XYZW])) == [Reading(NOW, XYZW, 5 * NS_PER_S)]
    assert items(android("rotation_vector", [*XYZW, 0.1])) == [Reading(NOW, XYZW, 5 * NS_PER_S)]
    assert items(android("geomagnetic_rotation_vector", [*XYZW])) == [Reading(NOW, XYZW, 5 * NS_PER_S)]
    (old,) = items(android("rotation_vector", [-0.5, 0.5, -0.5]))
    assert isinstance(old, Reading)
    assert old.world_from_sensor == pytest.approx(XYZW)


def test_first_of_two_rotation_vectors_is_used() -> None:
    decoder = UdpDecoder(UdpConfig())
    assert len(items(android("rotation_vector", [*XYZW]), decoder)) == 1
    assert items(android("game_rotation_vector", [*XYZW]), decoder) == []
    assert len(items(android("rotation_vector", [*XYZW]), decoder)) == 1


def test_rates_and_accelerations_are_paired_until_an_orientation_comes() -> None:
    decoder = UdpDecoder(UdpConfig())
    rates = android("gyroscope", [0.1, 0.2, 0.3])
    assert items(rates, decoder) == []
    assert items(android("accelerometer", [0.0, 0.0, 9.81]), decoder) == []
    assert items(rates, decoder) == [RawReading(NOW, (0.1, 0.2, 0.3), (0.0, 0.0, 9.81), 5 * NS_PER_S)]
    assert items(rates, decoder, NOW + NS_PER_S) == []  # that acceleration is too old
    assert items(android("light", [12.0]), decoder) == []
    items(android("game_rotation_vector", [*XYZW]), decoder)
    items(android("accelerometer", [0.0, 0.0, 9.81]), decoder)
    assert items(rates, decoder) == []


def test_sensors_that_are_of_no_use_are_named() -> None:
    decoder = UdpDecoder(UdpConfig())
    for sensor in ("orientation", "light", "orientation"):
        assert items(android(sensor, [211.0, 3.0, 1.0]), decoder) == []
    assert decoder.unused == (
        "gets readings of orientation, but no rotation vector: switch on the game rotation vector"
    )


def test_time_of_wearmocap_runs_on_at_midnight() -> None:
    decoder = UdpDecoder(UdpConfig())
    times_s: list[float] = []
    for time in (
        (23.0, 59.0, 59.0, 750e6),
        (0.0, 0.0, 0.0, 250e6),
        (23.0, 59.0, 59.0, 875e6),
        (0.0, 0.0, 1.0, 0.0),
    ):
        (reading,) = items(wearmocap((1.0, 0.0, 0.0, 0.0), time), decoder)
        assert isinstance(reading, Reading)
        assert reading.device_time_ns is not None
        times_s.append(reading.device_time_ns / NS_PER_S - 86400)
    assert times_s == [-0.25, 0.25, -0.125, 1.0]


def test_wearmocap_sends_28_floats() -> None:
    time_ns = (14 * 3600 + 30 * 60 + 5) * NS_PER_S + NS_PER_S // 4
    assert items(wearmocap((0.5, -0.5, 0.5, -0.5))) == [Reading(NOW, XYZW, time_ns)]


@pytest.mark.parametrize(
    "content", [{"qw": 0.5, "QX": "-0.5", "qy": 0.5, "qz": -0.5}, b" Quaternion: 0.5 -0.5 0.5 -0.5\r\n"]
)
def test_quaternions_as_json_and_as_text(content: object) -> None:
    assert items(content) == [Reading(NOW, XYZW)]


def test_described_line_is_read_when_it_resembles_sensagram() -> None:
    decoder = UdpDecoder(UdpConfig(line='{"type": "imu", "values": [{w}, {x}, {y}, {z}]}'))
    assert items({"type": "imu", "values": [0.5, -0.5, 0.5, -0.5]}, decoder) == [Reading(NOW, XYZW)]


def test_order_of_lists_and_lines_is_configurable() -> None:
    decoder = UdpDecoder(UdpConfig(order="xyzw"))
    assert items(b"-0.5,0.5,-0.5,0.5\nbutton double\n", decoder) == [Reading(NOW, XYZW), Press(NOW, "double")]
    assert items({"quaternion": [*XYZW]}, decoder) == [Reading(NOW, XYZW)]


@pytest.mark.parametrize(
    "data",
    [
        b"{",
        b"{}",
        b'{"values": [1, 2]}',
        b'{"values": ["a", {}, null, 1]}',
        b'{"values": [NaN, 0, 0, 1]}',
        b'{"x": 1e999, "y": 0, "z": 0, "w": 0}',
        b'{"x": 0, "y": 0, "z": 0, "w": ' + b"9" * 4000 + b"}",
        b'{"a":' * 800,
        b"1,2,3",
        b"1,0,0,0," * 600,
        wearmocap((math.nan, 0.0, 0.0, 1.0)),
        wearmocap((0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_datagram_without_an_orientation_is_refused(data: bytes) -> None:
    with pytest.raises(ContentError):
        items(data)


leaves = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
keys = st.sampled_from(["values", "type", "timestamp", "x", "y", "z", "w", "quaternion", "sensordata"])
contents = st.dictionaries(
    keys,
    st.recursive(
        leaves, lambda inner: st.lists(inner, max_size=5) | st.dictionaries(keys, inner), max_leaves=20
    ),
)


@given(
    contents.map(lambda content: json.dumps(content).encode())
    | st.binary(max_size=130)
    | st.binary(min_size=112, max_size=112)
)
def test_any_datagram_is_read_or_refused(data: bytes) -> None:
    decoder = UdpDecoder(UdpConfig())
    for _ in range(2):
        try:
            found = decoder.items(data, NOW)
        except ContentError:
            assert len(data) <= LONGEST_DATAGRAM
            continue
        for item in found:
            if isinstance(item, Reading):
                assert math.hypot(*item.world_from_sensor) == pytest.approx(1.0)


pytestmark = pytest.mark.wall_time


@pytest.mark.skipif(not hasattr(socket, "SO_REUSEPORT"), reason="no port can be shared here")
async def test_datagram_before_a_connection_keeps_its_own_sender(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard: set[tuple[bytes, Address]] = set()

    def on_datagram(data: bytes, address: Address) -> None:
        heard.add((data, address))

    port = free_udp_port()
    names = [b"%d" % number for number in range(32)]
    server = UdpServer("127.0.0.1", port, Health(), on_datagram, remedy="", is_shared=True)
    async with contextlib.AsyncExitStack() as stack:
        strangers = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in names]

        class Slow(socket.socket):
            def connect(self, address: Any, /) -> None:
                for name, stranger in zip(names, strangers, strict=True):
                    stranger.sendto(name, ("127.0.0.1", port))
                super().connect(address)

        task = asyncio.create_task(server.run())
        tracker = await stack.enter_async_context(phone_at(port))
        await until(tracker.saying(b"hello", lambda: bool(heard)))
        ((_, address),) = heard
        monkeypatch.setattr(socket, "socket", Slow)
        server.connect(address)
        await until(lambda: len(heard) == 1 + len(names))
        task.cancel()
        await asyncio.wait({task})
        assert heard == {(b"hello", address)} | {
            (name, ("127.0.0.1", stranger.getsockname()[1]))
            for name, stranger in zip(names, strangers, strict=True)
        }


@pytest.mark.parametrize("text", ["{0}{1}", "{0}\n{1}\n", "[{0}, {1}]", "{0},\r\n{1}"])
def test_json_objects_of_a_datagram_are_all_read(text: str) -> None:
    first = json.dumps({"q": [0.6, 0.64, 0.0, -0.48]}, indent=1)
    second = json.dumps(android("game_rotation_vector", [*XYZW]))
    readings = items(text.format(first, second).encode())
    assert [each.world_from_sensor for each in readings if isinstance(each, Reading)] == [
        pytest.approx((0.64, 0.0, -0.48, 0.6)),
        XYZW,
    ]


def test_datagram_of_json_is_read_up_to_what_is_none() -> None:
    decoder = UdpDecoder(UdpConfig())
    assert len(items(b'{"q":[1,0,0,0]}{"q":[1,', decoder)) == 1
    assert "is no JSON" in decoder.problem
