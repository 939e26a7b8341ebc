"""SlimeVR's datagrams, from the protocol's table and not by our encoder, and the choice of a tracker."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.imu_bridge.network import slimevr_protocol as protocol
from pointit.services.imu_bridge.network.slimevr import MAX_CALLERS, AdmittedDatagram, SlimevrTrackers
from pointit.services.imu_bridge.network.slimevr_protocol import (
    FlagsRequest,
    Handshake,
    Packet,
    Pong,
    Rotation,
    SensorFault,
    SensorInfo,
    SlimevrButton,
    SlimevrDatagram,
    decode,
)
from pointit.services.imu_bridge.sources import Battery, Signal

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
    assert content.packet is not None
    return content.packet


def test_rotation_of_the_table() -> None:
    assert decode(IDENTITY) == SlimevrDatagram(1, Rotation(0, (0.0, 0.0, 0.0, 1.0)), kind=17)


@pytest.mark.parametrize(
    ("kind", "payload", "expected"),
    [
        (12, struct.pack(">ff", 3.875, 0.75), Battery(0.75, 3.875)),
        (12, struct.pack(">f", 0.5), Battery(0.5, None)),
        (13, b"\x00\x01", SlimevrButton("press")),
        (13, b"\x00\x41", SlimevrButton("double")),
        (14, b"\x01\x05", SensorFault(1, 5)),
        (15, b"\x01\x01\x04", SensorInfo(1, 1)),
        (19, b"\xff\xc4", Signal(-60.0)),
        (21, b"\x02", SlimevrButton("double")),
        (21, b"\x03", SlimevrButton("press")),
        (21, b"\x04", SlimevrButton("hold")),
        (22, b"\x02", FlagsRequest()),
        (60, b"\x00", SlimevrButton("press")),
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


def test_corrections_and_packets_of_other_kinds_are_passed_over() -> None:
    correction = decode(datagram(17, b"\x00\x02" + QUARTER_TURN + b"\x00"))
    assert correction == SlimevrDatagram(7, None, kind=17)
    temperature = decode(datagram(20, b"\x00" + struct.pack(">f", 31.0)))
    assert temperature == SlimevrDatagram(7, None, kind=20)


def test_handshakes_of_boards_and_apps() -> None:
    assert only(handshake()) == Handshake(1, "0.6.0", "A4:E5:7C:B6:01:02")
    old_app = only(datagram(3, b"", 0))
    assert old_app == Handshake()
    assert only(datagram(3, struct.pack(">7i", 1, 4, 2, 0, 0, 0, 19), 0)) == Handshake(1, "", "")
    owotrack = only(handshake(13, 3, b"owoTrack8", bytes.fromhex("004500000000")))
    assert owotrack == Handshake(13, "owoTrack8", "")
    assert isinstance(old_app, Handshake)
    assert isinstance(owotrack, Handshake)
    assert [each.is_owotrack for each in (old_app, owotrack)] == [True, True]
    wrangler = only(handshake(0, 0, b"slimevr-wrangler", bytes.fromhex("000f000f000f")))
    assert isinstance(wrangler, Handshake)
    assert (wrangler.mac, wrangler.is_owotrack) == ("", False)


def test_echoes_and_handshakes_have_no_number() -> None:
    echo = decode(datagram(10, struct.pack(">I", 9), 4711))
    assert echo == SlimevrDatagram(0, Pong(9), kind=10)
    assert protocol.ping(9) == datagram(10, struct.pack(">I", 9), 0)


def test_answers_are_those_of_the_table() -> None:
    assert bytes.fromhex("03 486579204f5652203d442035") + bytes(51) == protocol.HANDSHAKE_ANSWER
    assert bytes.fromhex("00000001 0000000000000000") == protocol.HEARTBEAT_DATAGRAM
    assert protocol.sensor_answer(SensorInfo(2, 1)) == bytes.fromhex("0000000f 02 01")
    assert protocol.vibration(0.25) == struct.pack(">Ifff", 2, 0.25, 100.0, 1.0)
    assert bytes.fromhex("00000016 0000000000000000 00") == protocol.FLAGS_ANSWER


@given(
    st.sampled_from([0, 1, 3, 4, 10, 12, 13, 14, 15, 16, 17, 19, 21, 22, 23, 60, 100, 200, 2**32 - 1]),
    st.integers(0, 2**64 - 1),
    st.binary(max_size=200),
)
def test_decode_never_raises_and_gives_unit_orientations(kind: int, number: int, rest: bytes) -> None:
    content = decode(datagram(kind, rest, number))
    assert content is not None
    if isinstance(content.packet, Rotation):
        assert math.hypot(*content.packet.orientation_xyzw) == pytest.approx(1.0)
    if isinstance(content.packet, Battery):
        assert 0.0 <= content.packet.level <= 1.0


def test_datagram_that_is_too_short_or_too_long_is_refused() -> None:
    assert decode(bytes(11)) is None
    assert decode(datagram(17, bytes(protocol.LONGEST_DATAGRAM))) is None


ANNA = ("192.168.1.5", 6969)
BEN = ("192.168.1.6", 6969)
BOARD = Handshake(1, "0.6.0", "A4:E5:7C:B6:01:02")
OTHER_BOARD = Handshake(1, "0.6.0", "A4:E5:7C:B6:01:03")
PHONE = Handshake(13, "owoTrack8", "")
FIRST = AdmittedDatagram(is_reconnected=True)
AGAIN = AdmittedDatagram(is_reconnected=True, keeps_yaw=True)
NEXT = AdmittedDatagram()


def sent(number: int) -> SlimevrDatagram:
    return SlimevrDatagram(number, None)


def connected(handshake: Handshake = BOARD, number: int = 5) -> SlimevrTrackers:
    trackers = SlimevrTrackers()
    assert trackers.called(ANNA, handshake, 0.0) is not None
    assert trackers.admit(ANNA, sent(number), 0.1) == FIRST
    return trackers


def test_tracker_that_keeps_calling_unanswered_is_named() -> None:
    trackers = SlimevrTrackers()
    for second in range(100, 120):
        assert trackers.called(ANNA, BOARD, second) is not None
        trackers.admit(ANNA, sent(second), second + 0.1)
        assert trackers.called(BEN, OTHER_BOARD, second + 0.2) is None
        trackers.step(second + 0.3)
    assert len(trackers.others(119.5)) == 1


def test_late_or_repeated_numbered_datagrams_are_dropped() -> None:
    trackers = connected()
    assert trackers.admit(ANNA, sent(8), 0.2) == NEXT
    assert trackers.admit(ANNA, sent(0), 0.25) == NEXT
    for late in (8, 7, 1):  # numbers go on where they were
        assert trackers.admit(ANNA, sent(late), 0.3) is None
    assert trackers.admit(ANNA, sent(9), 0.4) == NEXT


def test_numbers_that_fall_far_are_a_restart() -> None:
    trackers = connected(number=5000)
    assert trackers.admit(ANNA, sent(1), 0.2) == FIRST
    assert trackers.admit(ANNA, sent(2), 0.3) == NEXT


def test_handshake_keeps_the_yaw_only_when_numbers_run_on() -> None:
    trackers = connected(number=50)
    assert trackers.called(ANNA, BOARD, 1.0) is not None
    assert trackers.admit(ANNA, sent(51), 1.1) == AGAIN
    assert trackers.called(ANNA, BOARD, 2.0) is not None
    assert trackers.admit(ANNA, sent(3), 2.1) == FIRST  # restarted, though its numbers fell by few


def test_loss_is_reported_once_and_the_tracker_returns_without_handshake() -> None:
    trackers = connected(number=50)
    assert [trackers.step(time_s) for time_s in (1.0, 3.0, 3.2, 4.0)] == [False, False, True, False]
    assert trackers.is_lost
    assert trackers.admit(ANNA, sent(60), 5.0) == AGAIN
    assert not trackers.is_lost


def test_phones_without_a_mac_do_not_displace_each_other() -> None:
    trackers = connected(PHONE)
    assert trackers.called(BEN, PHONE, 0.2) is None
    assert trackers.admit(BEN, sent(100), 0.3) is None
    assert trackers.admit(ANNA, sent(6), 0.4) == NEXT
    assert trackers.called(BEN, PHONE, 1.4) is None
    assert trackers.others(1.5) == ["192.168.1.6 (owoTrack8)"]
    assert trackers.called(BEN, PHONE, 9.0) is None  # a gap of the first does not hand its place over
    assert trackers.called(BEN, PHONE, 10.5) is not None
    assert trackers.admit(BEN, sent(1), 10.6) == FIRST


def test_board_is_recognized_at_another_address() -> None:
    trackers = connected(number=50)
    elsewhere = ("192.168.1.77", 6969)
    assert trackers.called(elsewhere, BOARD, 0.5) is None  # while the first is there, it is another one
    assert trackers.called(elsewhere, BOARD, 2.0) is not None
    assert trackers.admit(elsewhere, sent(60), 2.1) == AGAIN
    assert trackers.admit(ANNA, sent(61), 2.2) is None


def test_named_tracker_alone_is_answered() -> None:
    for name in (OTHER_BOARD.mac, BEN[0]):
        trackers = SlimevrTrackers(name)
        assert trackers.called(ANNA, BOARD, 0.0) is None
        assert trackers.called(ANNA, BOARD, 2.0) is None
        assert trackers.admit(ANNA, sent(1), 2.1) is None
        assert trackers.others(2.2) == ["A4:E5:7C:B6:01:02 (0.6.0 at 192.168.1.5)"]
        assert trackers.called(BEN, OTHER_BOARD, 2.3) is not None
        assert trackers.admit(BEN, sent(1), 2.4) == FIRST
        assert [each.address for each in trackers.answered(2.5)] == [BEN]
        assert trackers.answered(20.0) == []


def test_second_tracker_is_no_longer_answered_when_another_is_used() -> None:
    trackers = SlimevrTrackers()
    for address, board in ((ANNA, BOARD), (BEN, OTHER_BOARD)):
        assert trackers.called(address, board, 0.0) is not None
    assert trackers.admit(ANNA, sent(1), 0.1) == FIRST
    assert trackers.admit(BEN, sent(1), 0.1) is None
    assert [each.address for each in trackers.answered(0.2)] == [ANNA]


def test_callers_beyond_the_limit_are_ignored_except_the_named_one() -> None:
    trackers = SlimevrTrackers(BOARD.mac)
    for number in range(100):
        trackers.called((f"10.0.0.{number}", 6969), PHONE, 0.0)
        trackers.called((f"10.0.1.{number}", 6969), BOARD, 0.0)
        assert len(trackers._known) <= MAX_CALLERS
    assert trackers.called(ANNA, BOARD, 0.1) is not None
    assert trackers.admit(ANNA, sent(1), 0.2) == FIRST
    trackers.step(20.0)
    assert len(trackers._known) == 1


@given(
    st.lists(
        st.tuples(
            st.integers(0, 30),
            st.sampled_from([BOARD, OTHER_BOARD, PHONE, None]),
            st.integers(0, 300),
            st.floats(0, 5),
        ),
        max_size=80,
    ),
    st.sampled_from(["", BOARD.mac, "10.0.0.1"]),
)
def test_any_sequence_of_datagrams_is_bounded_and_uses_one_tracker(
    events: list[tuple[int, Handshake | None, int, float]], wanted: str
) -> None:
    trackers = SlimevrTrackers(wanted)
    now_s = 0.0
    for host, handshake, number, wait_s in events:
        now_s += wait_s
        address = (f"10.0.0.{host}", 6969)
        if handshake is not None:
            trackers.called(address, handshake, now_s)
        elif trackers.admit(address, sent(number), now_s) is not None:
            assert trackers.used is not None
            assert trackers.used.address == address
            assert not wanted or trackers.used.is_named(wanted)
        trackers.step(now_s)
        assert len(trackers._known) <= MAX_CALLERS
