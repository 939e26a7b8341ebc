"""Parts of an action: their classes as rclpy has them, and their hashes as rosidl makes them."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

from pointit.bridges.ros2.over_rclpy.library import class_of
from pointit.bridges.ros2.types.foreign import NAVIGATE_TO_POSE
from pointit.bridges.ros2.types.types import Types


class Service: ...


class Message: ...


def test_parts_of_an_action_are_found_where_rclpy_has_them(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("nav2_msgs.action")
    parts = SimpleNamespace(SendGoalService=Service, FeedbackMessage=Message)
    module.__dict__["NavigateToPose"] = SimpleNamespace(Impl=parts)
    monkeypatch.setitem(sys.modules, "nav2_msgs", ModuleType("nav2_msgs"))
    monkeypatch.setitem(sys.modules, "nav2_msgs.action", module)
    assert class_of("nav2_msgs/action/NavigateToPose_SendGoal") is Service
    assert class_of("nav2_msgs/action/NavigateToPose_FeedbackMessage") is Message
    for missing in ("nav2_msgs/action/NavigateToPose_GetResult", "nav2_msgs/action/Spin_SendGoal"):
        with pytest.raises(LookupError, match=missing):
            class_of(missing)


def test_hashes_of_navigate_to_pose_are_those_of_the_generator_of_ros() -> None:
    types = Types("jazzy")
    for part, expected in (
        ("SendGoal", "a4fcb3bee1bf32e21a0e541a943b221aa0826996e2c98f079b47022b256f48b5"),
        ("GetResult", "12dc670d3dac446019bb61a2bef1fd92ada02d582ca70922706d933a54b07f1c"),
        ("FeedbackMessage", "9d1f6fa2eb975ce733b419ac2e97b134d8ff92b6478b6559feed9a50bdfd82b3"),
    ):
        assert types.kind(f"{NAVIGATE_TO_POSE}_{part}").hash == f"RIHS01_{expected}"
