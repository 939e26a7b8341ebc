"""Values of ROS parameters, as messages of `rcl_interfaces` and as Python values."""

from collections.abc import Mapping
from typing import Any, cast

from pointit.bridges.ros2.types.types import Types

Value = bool | int | float | str | list[Any]
"""A list holds values of one of the other types: ROS has no lists of lists."""

MESSAGE = "rcl_interfaces/msg/ParameterValue"
NOT_SET = 0
FIELDS: Mapping[int, str] = {
    1: "bool_value",
    2: "integer_value",
    3: "double_value",
    4: "string_value",
    5: "byte_array_value",
    6: "bool_array_value",
    7: "integer_array_value",
    8: "double_array_value",
    9: "string_array_value",
}
"""Field of the value by `rcl_interfaces/msg/ParameterType`; all other fields are unused."""

KINDS: Mapping[type, int] = {bool: 1, int: 2, float: 3, str: 4}
LISTS: Mapping[type, int] = {bool: 6, int: 7, float: 8, str: 9}


def value_of(message: Any) -> Value | None:
    """Return the value of a decoded message, or None if the parameter has none.

    Raises:
        ValueError: If it says that it is of a kind that there is not.
    """
    kind = int(message.type)
    if kind == NOT_SET:
        return None
    if kind not in FIELDS:
        raise ValueError(f"a parameter is of kind {kind}, and there are {NOT_SET} to {max(FIELDS)}")
    value: Any = getattr(message, FIELDS[kind])
    if isinstance(value, bool | int | float | str):
        return value
    return cast("list[Any]", value.tolist() if hasattr(value, "tolist") else list(value))


def message_of(types: Types, value: Value | None) -> Any:
    """Return the message that holds `value`. An empty list is one of numbers.

    Raises:
        ValueError: If ROS has no parameter that holds it.
    """
    if value is None:
        return types.make(MESSAGE)
    kinds: set[type] = {type(each) for each in value} or {float} if isinstance(value, list) else {type(value)}
    known = LISTS if isinstance(value, list) else KINDS
    kind = known.get(kinds.pop()) if len(kinds) == 1 else None
    if kind is None:
        raise ValueError(f"{value!r:.60} is no value that a ROS parameter can have")
    return types.make(MESSAGE, type=kind, **{FIELDS[kind]: value})
