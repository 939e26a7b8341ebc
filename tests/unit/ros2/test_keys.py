"""Keys of data."""

import pytest

from pointit.bridges.ros2.graph.backend import RosType
from pointit.bridges.ros2.over_zenoh.keys import data_key, dds_type, resolved
from tests.unit.ros2.facts import golden


def test_a_topic_and_a_service() -> None:
    seen = [each["key"] for each in golden("wire")["samples"] + golden("wire")["calls"]]
    assert len(seen) == 7
    for key in seen:
        *name, dds_name, type_hash = key.split("/")[1:]
        assert data_key(7, f"/{'/'.join(name)}", dds_type(dds_name, type_hash)) == key
    pose = RosType(name="geometry_msgs/msg/PoseStamped", hash="RIHS01_10")
    assert data_key(0, "/user1/ray", pose) == "0/user1/ray/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10"


@pytest.mark.parametrize("name", ["/a", "/_a/b_1", "/user1/metawear_ros/rotation", "/a/_action/get_result"])
def test_resolved_names_are_accepted(name: str) -> None:
    assert resolved(name) == name


NO_NAMES = [
    "",
    "/",
    "a",
    "a/b",
    "/a/",
    "//a",
    "/a//b",
    "/1a",
    "/a-b",
    "/a b",
    "~/a",
    "/{user}/a",
    "/**",
    "/a$*",
]
STRANGE = ["/\u00e9", "/a\n", "/@a", "/a%b"]


@pytest.mark.parametrize("name", [*NO_NAMES, *STRANGE])
def test_what_would_become_another_key_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="not a full ROS name"):
        resolved(name)
    with pytest.raises(ValueError, match="not a full ROS name"):
        data_key(0, name, RosType(name="std_msgs/msg/Bool", hash="RIHS01_0"))


def test_types_are_read_as_dds_writes_them() -> None:
    kind = dds_type("std_srvs::srv::dds_::Empty_", "RIHS01_0")
    assert kind == RosType(name="std_srvs/srv/Empty", hash="RIHS01_0")
    assert dds_type(kind.dds_name, kind.hash) == kind


NO_TYPES = [
    "",
    "std_msgs/msg/Bool",
    "std_msgs::msg::Bool",
    "::::dds_::_",
    "a::msg::dds_::Bool",
    "a::b::c::dds_::D_",
]


@pytest.mark.parametrize("text", NO_TYPES)
def test_anything_else_is_no_type(text: str) -> None:
    with pytest.raises(ValueError, match="not a type"):
        dds_type(text, "RIHS01_0")


@pytest.mark.parametrize("type_hash", ["", "RIHS01 0", "\x1b[2J", "RIHS01_é"])
def test_a_hash_is_a_word(type_hash: str) -> None:
    with pytest.raises(ValueError, match="not a type"):
        dds_type("std_msgs::msg::dds_::Bool_", type_hash)
