"""One sensor of a stream is used, the others are named and never move the arm of the first."""

from collections.abc import Sequence

import pytest

from pointit.services.imu_bridge.network.datagram_source import DatagramConfig, SenderChoice
from pointit.services.imu_bridge.network.udp import UdpConfig, UdpDecoder
from pointit.services.imu_bridge.network.ximu3 import Ximu3Config
from pointit.services.imu_bridge.serial.detection import Detection, SerialConfig
from pointit.services.imu_bridge.serial.line_parser import MAX_OPEN, MAX_RISES
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.sources import Press, Reading
from pointit.services.imu_bridge.streams import FORGET_AFTER, MAX_NAMES, SensorChoice

ARM, OTHER = (0.6, 0.0, 0.0, 0.8), (0.0, 0.0, 0.8, 0.6)
"""Orientations xyzw of the wrist and of another sensor."""


def text(xyzw: Sequence[float], separator: str = ",") -> str:
    x, y, z, w = xyzw
    return separator.join(f"{value:.4f}" for value in (w, x, y, z))


def turned(framer_items: Sequence[object]) -> set[tuple[float, ...]]:
    return {
        tuple(round(value, 4) for value in each.world_from_sensor)
        for each in framer_items
        if isinstance(each, Reading)
    }


@pytest.mark.parametrize(
    ("mine", "others", "wanted", "names"),
    [
        (f"Hand: {text(ARM)}", f"Ellbogen-ö: {text(OTHER)}", "hand", ("Hand", "Ellbogen-ö")),
        (f"left {text(ARM, ' ')}", f"right {text(OTHER, ' ')}", "LEFT", ("left", "right")),
        (f"IMU7;{text(ARM, ';')}", f"IMU8;{text(OTHER, ';')}", "imu7", ("IMU7", "IMU8")),
        (f"104,{text(ARM)}", f"105,{text(OTHER)}", "104", ("104", "105")),
        (f"imu 3: {text(ARM)}", f"imu 4: {text(OTHER)}", "3", ("3", "4")),
        (f"2 91000 {text(ARM, ' ')}", f"5 91010 {text(OTHER, ' ')}", "2", ("2", "5")),
        (
            f"24:6F:28:0A:0B:01 {text(ARM)}",
            f"24:6F:28:0A:0B:02 {text(OTHER)}",
            "24:6f:28:0a:0b:01",
            ("24:6F:28:0A:0B:01", "24:6F:28:0A:0B:02"),
        ),
        ("A qW: 0.8 qX: 0.6 qY: 0.0 qZ: 0.0", "B qW: 0.6 qX: 0.0 qY: 0.0 qZ: 0.8", "a", ("A", "B")),
        (
            '{"sensor_id": "palm", "q": [0.8, 0.6, 0, 0]}',
            '{"sensor_id": "upper", "q": [0.6, 0, 0, 0.8]}',
            "palm",
            ("palm", "upper"),
        ),
        ("{node:1,w:0.8,x:0.6,y:0,z:0}", "{node:2,w:0.6,x:0,y:0,z:0.8}", "1", ("1", "2")),
    ],
)
def test_lines_of_a_second_sensor_are_reported_and_not_read(
    mine: str, others: str, wanted: str, names: tuple[str, str]
) -> None:
    lines = [mine, others] * 20
    for sensor, first in (("", others), (wanted, others)):
        detection = Detection(SerialConfig(sensor=sensor))
        items = [
            item
            for number, line in enumerate([first, *lines])
            for item in detection.feed(f"{line}\r\n".encode(), number, number / 50)
        ]
        warning = detection._sensors.warning
        if sensor:
            assert turned(items) == {ARM}
            assert warning == ""
        else:
            assert len(turned(items)) == 1
            assert all(name in warning for name in names)
            assert "set serial.sensor to the one on the wrist" in warning


def test_second_sensor_never_replaces_the_first_also_after_a_silence_and_a_new_connection() -> None:
    sensors = SensorChoice("serial.sensor")
    assert sensors.accepts("wrist")
    for _ in range(3 * FORGET_AFTER):
        assert not sensors.accepts("elbow")
    assert sensors.warning.startswith("several sensors send in one stream: wrist is used, not elbow;")
    assert TextFramer(sensors=sensors).feed(f"\nelbow: {text(OTHER)}\n".encode(), 0) == []


def test_sensor_that_is_gone_is_not_named_any_more() -> None:
    sensors = SensorChoice("serial.sensor")
    sensors.accepts("wrist")
    sensors.accepts("elbow")
    assert "elbow" in sensors.warning
    for _ in range(FORGET_AFTER):
        sensors.accepts("wrist")
    assert sensors.warning == ""


def test_configured_sensor_that_is_not_heard_is_named_with_those_that_are() -> None:
    sensors = SensorChoice("udp.sensor", "Wrist")
    assert not sensors.accepts("elbow")
    assert sensors.warning == "no sensor 'wrist' is heard, but elbow: set udp.sensor to one of them"
    assert sensors.accepts("left", "wrist")
    assert sensors.warning == ""


def test_numbers_that_never_return_are_counts_and_name_no_sensor() -> None:
    for is_noisy in (False, True):
        sensors = SensorChoice("udp.sensor", is_noisy=is_noisy)
        accepted = [sensors.accepts("board", f"{number}") for number in range(3 * MAX_NAMES)]
        assert accepted[MAX_NAMES + is_noisy :] == [True] * (2 * MAX_NAMES - is_noisy)
        assert sum(accepted[:MAX_NAMES]) == (not is_noisy)
        assert sensors.used == "board"


def test_numbers_that_return_are_those_of_sensors() -> None:
    sensors = SensorChoice("udp.sensor")
    assert [sensors.accepts(f"{number % 40}") for number in range(400)] == ([True] + [False] * 39) * 10


def test_button_of_another_sensor_is_not_the_arms() -> None:
    framer = TextFramer(sensors=SensorChoice("serial.sensor", "wrist"))
    lines = f"\nwrist: {text(ARM)}\nelbow: {text(OTHER)}\nelbow: button\nwrist: button hold\nb\n"
    presses = [item for item in framer.feed(lines.encode(), 7) if isinstance(item, Press)]
    assert presses == [Press(7, "hold"), Press(7)]


def test_ambiguous_fifth_number_is_reported_until_the_norms_tell_its_side() -> None:
    framer = TextFramer()
    assert framer.feed(b"\n" + b"0,1,0,0,0\n" * MAX_OPEN, 0) == []
    assert framer.bad == 0  # perhaps the start of a clock
    assert framer.feed(b"0,1,0,0,0\n", 0) == []
    assert "the first and the last four are a quaternion: set the parameter `fifth`" in framer.reason
    framer.feed(b"0,0.8,0,0,0.6\n" * (MAX_RISES + 2), 0)
    assert turned(framer.feed(b"0,1,0,0,0\n", 0)) == {(0.0, 0.0, 0.0, 1.0)}


def test_fifth_number_beside_a_nearly_level_quaternion_is_told_by_rounding() -> None:
    framer = TextFramer()
    lines = "0,0.9692,0.1,0.12,0.19\n" * (
        MAX_RISES + 2
    )  # the first four have norm 0.982, the last four 0.9999
    assert turned(framer.feed(f"\n{lines}".encode(), 0)) == {(0.1, 0.12, 0.19, 0.9693)}


@pytest.mark.parametrize(
    "lines",
    [
        [f"70001,{text(ARM)}", f"70002,{text(OTHER)}"],  # numbers too large for a sensor, but they return
        [f"{text(ARM)},0", f"{text(OTHER)},1"],  # behind the quaternion
    ],
)
def test_fifth_numbers_that_return_again_and_again_are_those_of_sensors(lines: list[str]) -> None:
    framer = TextFramer(sensors=(sensors := SensorChoice("serial.sensor")))
    framer.feed(b"\n", 0)
    for _ in range(16):
        framer.feed("".join(f"{line}\n" for line in lines).encode(), 0)
    assert sensors.warning
    for _ in range(MAX_NAMES):  # those without a known number are no sensor of their own
        framer.feed("".join(f"{line}\n" for line in lines).encode(), 0)
    assert len(framer.feed("".join(f"{line}\n" for line in lines).encode(), 0)) == 1


def test_trailing_number_names_a_sensor_if_it_is_configured() -> None:
    framer = TextFramer("wxyz", "sensor", SensorChoice("serial.sensor", "1"))
    lines = f"\n{text(ARM)},1\n{text(OTHER)},0\n" * 3
    assert turned(framer.feed(lines.encode(), 0)) == {ARM}


@pytest.mark.parametrize(
    ("mine", "others", "wanted"),
    [
        (
            '{"id": 1, "w": 0.8, "x": 0.6, "y": 0, "z": 0}',
            '{"id": 2, "w": 0.6, "x": 0, "y": 0, "z": 0.8}',
            "1",
        ),
        ('{"deviceName": "Zoé", "q": [0.8, 0.6, 0, 0]}', '{"deviceName": "B", "q": [0.6, 0, 0, 0.8]}', "zoé"),
        (
            '{"device": {"mac": "a:1"}, "data": {"qw": 0.8, "qx": 0.6, "qy": 0, "qz": 0}}',
            '{"device": {"mac": "a:2"}, "data": {"qw": 0.6, "qx": 0, "qy": 0, "qz": 0.8}}',
            "a:1",
        ),
        (
            '{"name": "band", "type": "android.sensor.rotation_vector", "values": [0.6, 0, 0, 0.8]}',
            '{"name": "leg", "type": "android.sensor.rotation_vector", "values": [0, 0, 0.8, 0.6]}',
            "band",
        ),
        ("hand 0.8 0.6 0 0", "head 0.6 0 0 0.8", "hand"),
    ],
)  # fmt: skip
def test_datagrams_of_a_second_sensor_are_reported_and_not_read(mine: str, others: str, wanted: str) -> None:
    for sensor in ("", wanted):
        decoder = UdpDecoder(UdpConfig(sensor=sensor))
        items = [
            item for _ in range(9) for each in (mine, others) for item in decoder.items(each.encode(), 0)
        ]
        assert turned(items) == {ARM}
        assert bool(decoder.sensors.warning) is not bool(sensor)


def test_two_sensors_in_one_object_are_told_apart_by_its_keys() -> None:
    data = b'{"wrist": {"w": 0.8, "x": 0.6, "y": 0, "z": 0}, "elbow": {"w": 0.6, "x": 0, "y": 0, "z": 0.8}}'
    for sensor, expected in (("", ARM), ("elbow", OTHER)):
        decoder = UdpDecoder(UdpConfig(sensor=sensor))
        assert turned(decoder.items(data, 0)) == {expected}
    listed = b'[{"id": "a", "q": [0.8, 0.6, 0, 0]}, {"id": "b", "q": [0.6, 0, 0, 0.8]}]'
    assert turned(UdpDecoder(UdpConfig(sensor="b")).items(listed, 0)) == {OTHER}


def test_sender_that_was_heard_beside_the_first_never_replaces_it() -> None:
    senders = SenderChoice(excludes_rivals=True)
    senders.use(("10.0.0.1", 5000), 0.0)
    assert not senders.may_use(("10.0.0.2", 5000), 0.5)
    senders.use(("10.0.0.1", 5000), 1.0)
    assert not senders.may_use(("10.0.0.2", 6000), 99.0)
    assert senders.others(99.0) == ["10.0.0.2"]
    assert senders.may_use(("10.0.0.3", 5000), 99.0)  # the first one with a new address, perhaps


def test_sensor_is_an_address_or_a_name() -> None:
    by_address = DatagramConfig(port=1, sensor="10.0.0.7")
    assert (by_address.sensor_address, by_address.sensor_name) == ("10.0.0.7", "")
    by_name = DatagramConfig(port=1, sensor="wrist", sender="10.0.0.7")
    assert (by_name.sensor_address, by_name.sensor_name) == ("10.0.0.7", "wrist")
    with pytest.raises(ValueError, match="must be an IP address"):
        Ximu3Config(sensor="wrist")
