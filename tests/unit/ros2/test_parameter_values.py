"""Values of ROS parameters, there and back."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.parameters.values import FIELDS, MESSAGE, message_of, value_of
from pointit.bridges.ros2.types.types import Types

TYPES = Types("jazzy")
WHOLE = st.integers(-(2**63), 2**63 - 1)
NUMBER = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(max_size=9).filter(lambda text: "\0" not in text)
VALUE = st.one_of(
    st.booleans(),
    WHOLE,
    NUMBER,
    TEXT,
    *(st.lists(each, min_size=1) for each in (st.booleans(), WHOLE, NUMBER, TEXT)),
)


@given(VALUE)
def test_values_survive_a_round_trip(value: Any) -> None:
    again = value_of(TYPES.decode(MESSAGE, TYPES.encode(MESSAGE, message_of(TYPES, value))))
    assert again == value
    assert repr(again) == repr(value), "true is no 1"


def test_what_has_no_value_has_none() -> None:
    assert value_of(message_of(TYPES, None)) is None
    assert value_of(message_of(TYPES, [])) == []
    assert value_of(TYPES.make(MESSAGE, type=5, byte_array_value=b"\1\2")) == [1, 2]


def test_the_kinds_are_those_of_ros() -> None:
    kinds = TYPES.make("rcl_interfaces/msg/ParameterType")
    for number, field in FIELDS.items():
        name = field.removesuffix("_value").upper()
        assert getattr(kinds, f"PARAMETER_{name}") == number


def test_what_ros_cannot_hold_is_refused() -> None:
    for value in ([1, "a"], [[1.0]], {"a": 1}, [1, 2.0]):
        with pytest.raises(ValueError, match="is no value that a ROS parameter can have"):
            message_of(TYPES, value)  # type: ignore[arg-type]  # that is the point


def test_a_kind_that_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match="a parameter is of kind 77, and there are 0 to 9"):
        value_of(TYPES.make(MESSAGE, type=77))
