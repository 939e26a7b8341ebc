"""CDR of any value, and of any bytes."""

import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.types.definitions import Definitions
from pointit.bridges.ros2.types.types import Types
from tests.unit.ros2.values import any_value, plain

NAMES = (
    "geometry_msgs/msg/PoseStamped",
    "sensor_msgs/msg/Imu",
    "tf2_msgs/msg/TFMessage",
    "diagnostic_msgs/msg/DiagnosticArray",
    "visualization_msgs/msg/Marker",
    "conveyor_msgs/msg/PackageList",
    "conveyor_msgs/msg/PointerList",
    "conveyor_msgs/msg/PUISubscription",
    "conveyor_msgs/msg/BeltCommand",
    "conveyor_msgs/srv/AddPack_Request",
    "led_strip_msgs/msg/LedStrips",
    "led_strip_msgs/msg/LedEffect",
    "led_strip_msgs/msg/ColorArray",
    "std_srvs/srv/Trigger_Response",
)
TYPES = Types("jazzy")
FIELDS = {name: fields for name, (_, fields) in Definitions("jazzy").store.fielddefs.items()}


# Others load the machine, too; 28 tests make do with 40 examples each.


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_values_survive_a_round_trip(name: str, data: st.DataObject) -> None:
    value = data.draw(any_value(TYPES, FIELDS, name))
    cdr = TYPES.encode(name, value)
    assert cdr.startswith(b"\x00\x01\x00\x00")
    again = TYPES.decode(name, cdr)
    assert plain(again) == plain(value)
    assert TYPES.encode(name, again) == cdr
    assert plain(TYPES.decode(name, cdr + bytes(len(cdr) % 4))) == plain(value)


@given(st.sampled_from(NAMES), st.binary(max_size=300))
def test_any_bytes_are_read_or_refused(name: str, data: bytes) -> None:
    decode_or_refuse(name, b"\x00\x01\x00\x00" + data)
    decode_or_refuse(name, data)


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_damaged_bytes_are_read_or_refused(name: str, data: st.DataObject) -> None:
    """A valid message with some bytes changed, a huge length, or a missing end."""
    cdr = bytearray(TYPES.encode(name, data.draw(any_value(TYPES, FIELDS, name))))
    for at in data.draw(st.lists(st.integers(0, len(cdr) - 1), max_size=4)):
        cdr[at] = data.draw(st.integers(0, 255))
    at = data.draw(st.integers(1, len(cdr) // 4)) * 4
    if data.draw(st.booleans()) and at + 4 <= len(cdr):
        struct.pack_into("<I", cdr, at, data.draw(st.sampled_from([2**32 - 1, 2**31, 2**16, len(cdr)])))
    decode_or_refuse(name, bytes(cdr[: data.draw(st.integers(0, len(cdr)))]))


def decode_or_refuse(name: str, cdr: bytes) -> None:
    """Decoding returns a usable value or raises a ValueError."""
    try:
        value = TYPES.decode(name, cdr)
    except ValueError:
        return
    encode_or_refuse(name, value)


def encode_or_refuse(name: str, value: Any) -> None:
    try:
        again = TYPES.encode(name, value)
    except ValueError:
        return  # a number that is not finite, or text with a NUL inside
    assert plain(TYPES.decode(name, again)) == plain(value)
