"""SlimeVR's datagrams, written from the protocol's table and not by our encoder."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.imu_bridge.network import slimevr_protocol as protocol
from pointit.services.imu_bridge.network.slimevr_protocol import (
    BatteryLevel,
    Button,
    Datagram,
    FlagsRequest,
    Handshake,
    Packet,
    Pong,
    Rotation,
    SensorFault,
    SensorInfo,
    SignalStrength,
    decode,
)

IDENTITY = bytes.fromhex("00000011 0000000000000001 00 01 00000000 00000000 00000000 3f800000 00")
HALF = math.sqrt(0.5)
QUARTER_TURN = struct.pack(">4f", 0.0, 0.0, HALF, HALF)
MAC = bytes.fromhex("a4e57cb60102")


def datagram(kind: int, payload: bytes, number: int = 7) -> bytes:
    return struct.pack(">IQ", kind, number) + payload


def handshake(board: int = 1, mcu: int = 2, firmware: bytes = b"0.6.0", mac: bytes = MAC) -> bytes:
    head = struct.pack(">7iB", board, 4, mcu, 0, 0, 0, 19, len(firmware))
    return datagram(3, head + firmware + mac + b"\xff", 0)


def only(data: bytes) -> Packet:
    content = decode(data)
    assert content is not None
    (packet,) = content.packets
    return packet


def test_rotation_of_the_table() -> None:
    assert decode(IDENTITY) == Datagram(1, (Rotation(0, (0.0, 0.0, 0.0, 1.0)),))


@pytest.mark.parametrize(
    ("kind", "payload", "expected"),
    [
        (12, struct.pack(">ff", 3.875, 0.75), BatteryLevel(0.75, 3.875)),
        (12, struct.pack(">f", 0.5), BatteryLevel(0.5, None)),
        (13, b"\x00\x01", Button("press")),
        (13, b"\x00\x41", Button("double")),
        (14, b"\x01\x05", SensorFault(1, 5)),
        (15, b"\x01\x01\x04", SensorInfo(1, 1)),
        (19, b"\xff\xc4", SignalStrength(-60.0)),
        (21, b"\x02", Button("double")),
        (21, b"\x03", Button("press")),
        (21, b"\x04", Button("hold")),
        (22, b"\x02", FlagsRequest()),
        (60, b"\x00", Button("press")),
    ],
)
def test_packets_of_the_table(kind: int, payload: bytes, expected: Packet) -> None:
    assert only(datagram(kind, payload)) == expected


@pytest.mark.parametrize(
    ("kind", "payload", "sensor"),
    [
        (1, QUARTER_TURN, 0),
        (16, QUARTER_TURN, 1),
        (17, b"\x02\x01" + QUARTER_TURN + b"\x00", 2),
        (23, struct.pack(">B7h", 3, 0, 0, 23170, 23170, 1, 2, 3), 3),
    ],
)
def test_orientations_of_every_kind(kind: int, payload: bytes, sensor: int) -> None:
    packet = only(datagram(kind, payload))
    assert isinstance(packet, Rotation)
    assert packet.sensor == sensor
    assert packet.orientation_xyzw == pytest.approx((0.0, 0.0, HALF, HALF), abs=1e-4)
    assert math.hypot(*packet.orientation_xyzw) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("numbers", [(0.0,) * 4, (math.nan, 0, 0, 1), (math.inf, 0, 0, 0), (0, 0, 0, 2.0)])
def test_what_is_no_orientation_is_unreadable(numbers: tuple[float, ...]) -> None:
    assert decode(datagram(1, struct.pack(">4f", *numbers))) == Datagram(7, (), 1)


def test_corrections_and_packets_of_other_kinds_are_passed_over() -> None:
    assert decode(datagram(17, b"\x00\x02" + QUARTER_TURN + b"\x00")) == Datagram(7, ())
    assert decode(datagram(20, b"\x00" + struct.pack(">f", 31.0))) == Datagram(7, ())


def test_handshakes_of_boards_and_apps() -> None:
    assert only(handshake()) == Handshake(1, 2, 19, "0.6.0", "A4:E5:7C:B6:01:02")
    old_app = only(datagram(3, b"", 0))
    assert old_app == Handshake()
    assert only(datagram(3, struct.pack(">7i", 1, 4, 2, 0, 0, 0, 19), 0)) == Handshake(1, 2, 19, "", "")
    owotrack = only(handshake(13, 3, b"owoTrack8", bytes.fromhex("004500000000")))
    assert owotrack == Handshake(13, 3, 19, "owoTrack8", "")
    assert isinstance(old_app, Handshake)
    assert isinstance(owotrack, Handshake)
    assert [each.is_owotrack for each in (old_app, owotrack)] == [True, True]
    wrangler = only(handshake(0, 0, b"slimevr-wrangler", bytes.fromhex("000f000f000f")))
    assert isinstance(wrangler, Handshake)
    assert (wrangler.mac, wrangler.is_owotrack) == ("", False)


def test_echoes_and_handshakes_have_no_number() -> None:
    echo = decode(datagram(10, struct.pack(">I", 9), 4711))
    assert echo == Datagram(0, (Pong(9),))
    assert protocol.ping(9) == datagram(10, struct.pack(">I", 9), 0)


@pytest.mark.parametrize(("kind", "length", "name"), [(100, ">H", ">I"), (101, ">B", ">B")])
def test_bundles_of_both_kinds(kind: int, length: str, name: str) -> None:
    parts = [(17, b"\x00\x01" + QUARTER_TURN + b"\x00"), (12, struct.pack(">ff", 4.1, 1.0)), (60, b"\0")]
    inner = [struct.pack(name, each) + payload for each, payload in parts]
    data = datagram(kind, b"".join(struct.pack(length, len(each)) + each for each in inner))
    content = decode(data)
    assert content is not None
    assert [type(packet) for packet in content.packets] == [Rotation, BatteryLevel, Button]
    cut = decode(data[:-1])
    assert cut is not None
    assert [type(packet) for packet in cut.packets] == [Rotation, BatteryLevel]


def test_answers_are_those_of_the_table() -> None:
    assert bytes.fromhex("03 486579204f5652203d442035") + bytes(51) == protocol.HANDSHAKE_ANSWER
    assert bytes.fromhex("00000001 0000000000000000") == protocol.HEARTBEAT_DATAGRAM
    assert protocol.sensor_answer(SensorInfo(2, 1)) == bytes.fromhex("0000000f 02 01")
    assert protocol.vibration(0.25) == struct.pack(">Ifff", 2, 0.25, 100.0, 1.0)
    assert bytes.fromhex("00000016 0000000000000000 00") == protocol.FLAGS_ANSWER


@given(
    st.sampled_from([0, 1, 3, 4, 10, 12, 13, 14, 15, 16, 17, 19, 21, 22, 23, 60, 100, 101, 200, 2**32 - 1]),
    st.integers(0, 2**64 - 1),
    st.binary(max_size=200),
)
def test_no_datagram_raises_or_gives_an_orientation_that_is_none(kind: int, number: int, rest: bytes) -> None:
    content = decode(datagram(kind, rest, number))
    assert content is not None
    assert len(content.packets) <= protocol.MOST_BUNDLED
    for packet in content.packets:
        if isinstance(packet, Rotation):
            assert math.hypot(*packet.orientation_xyzw) == pytest.approx(1.0)
        if isinstance(packet, BatteryLevel):
            assert 0.0 <= packet.level <= 1.0


@given(st.binary(max_size=40))
def test_any_bytes_are_decoded_or_refused(data: bytes) -> None:
    content = decode(data)
    assert (content is None) == (len(data) < 12)


def test_longest_datagram() -> None:
    assert decode(datagram(100, bytes(protocol.LONGEST_DATAGRAM))) is None
