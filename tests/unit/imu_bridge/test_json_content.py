"""Several quaternions in JSON, orders and times that it states, and sensors in headers."""

import json
from typing import Any

import pytest

from pointit.services.imu_bridge.network.udp import UdpConfig, UdpDecoder
from pointit.services.imu_bridge.sources import Reading

XYZW, OTHER = (0.64, 0.0, -0.48, 0.6), (0.0, 0.6, 0.0, 0.8)
X, Y, Z, W = XYZW
FIELDS = {"x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8}


def read(decoder: UdpDecoder, content: Any) -> list[Reading]:
    items = decoder.items(json.dumps(content).encode(), 0)
    return [item for item in items if isinstance(item, Reading)]


@pytest.mark.parametrize(
    "content",
    [
        {"quat_xyzw": [X, Y, Z, W]},
        {"quatWXYZ": [W, X, Y, Z]},
        {"quaternion": [X, Y, Z, W], "order": "xyzw"},
        {"format": "x,y,z,w", "data": {"q": [X, Y, Z, W]}},
        {"convention": "WXYZ", "q": [W, X, Y, Z]},
        {"quat": f"{W}, {X}, {Y}, {Z}"},
        {"wristQuat": [W, X, Y, Z]},
        {"quat": [W, X, Y, Z], "qw": W, "qx": X, "qy": Y, "qz": Z},  # one rotation twice
    ],
)
def test_quaternion_is_read_in_the_order_that_is_stated(content: dict[str, Any]) -> None:
    decoder = UdpDecoder(UdpConfig(order="xyzw" if "WXYZ" in str(content) else "wxyz"))
    (reading,) = read(decoder, content)
    assert reading.world_from_sensor == pytest.approx(XYZW)
    assert decoder.sensors.warning == ""


@pytest.mark.parametrize(
    ("content", "first", "second"),
    [
        ({"quat": [W, X, Y, Z], "rotation": [0.8, 0.0, 0.6, 0.0]}, "quat", "rotation"),
        ({"left_quat": [W, X, Y, Z], "right_quat": [0.8, 0.0, 0.6, 0.0]}, "left_quat", "right_quat"),
        ({"q": [W, X, Y, Z], "data": {"q": [0.8, 0.0, 0.6, 0.0]}}, "1", "2"),
    ],
)
def test_two_quaternions_of_one_object_are_those_of_two_sensors(
    content: dict[str, Any], first: str, second: str
) -> None:
    for sensor, expected in (("", XYZW), (first, XYZW), (second, OTHER)):
        decoder = UdpDecoder(UdpConfig(sensor=sensor))
        readings = [each for _ in range(5) for each in read(decoder, content)]
        assert [each.world_from_sensor for each in readings] == [pytest.approx(expected)] * 5
        assert bool(decoder.sensors.warning) is not bool(sensor)
        assert sensor or second in decoder.sensors.warning


def test_sensors_that_a_header_names_are_told_apart() -> None:
    decoder = UdpDecoder(UdpConfig())
    turned = {"x": X, "y": Y, "z": Z, "w": W}
    for name, fields in (("wrist_link", turned), ("elbow_link", FIELDS)) * 5:
        readings = read(decoder, {"header": {"frame_id": name, "seq": 5}, "orientation": fields})
        assert len(readings) == (name == "wrist_link")
    assert "wrist_link is used, not elbow_link" in decoder.sensors.warning


@pytest.mark.parametrize(
    ("time", "time_ns"),
    [
        (1_714_560_000_123, 1_714_560_000_123_000_000),
        (1_714_560_000_123_456, 1_714_560_000_123_456_000),
        (1_714_560_000_123_456_789, 1_714_560_000_123_456_789),
        (91_000, None),  # in ms, perhaps
        (1_714_560_000, None),
        (True, None),
        ("now", None),
    ],
)
def test_time_counts_only_if_its_amount_tells_the_unit(time: object, time_ns: int | None) -> None:
    (reading,) = read(UdpDecoder(UdpConfig()), {"q": [W, X, Y, Z], "timestamp": time})
    assert reading.device_time_ns == time_ns
