"""Yaw of people from ROS whose motion capture sees a marker body on the forearm."""

import math
from typing import Any

import pytest

from pointit.bridges.ros2.inbound.person import Poses
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, ImuSample
from tests.unit.ros2.scenes import NOW_NS, furnished, into, jazzy, pose_at, quaternion, stamped, transform

YAW_RAD = 0.7
MOUNT = rotation.from_axis_angle((0.6, 0.0, 0.8), 1.1)
NONE = (0.0, 0.0, 0.0, 0.0)
"""Orientation of a message that states none."""


def posed(q: Quaternion, *, stamp_ns: int = NOW_NS, frame: str = "world") -> Any:
    value = jazzy().make(
        "geometry_msgs/msg/PoseStamped", header=stamped(stamp_ns, frame), pose=pose_at((1.0, 2.0, 0.0))
    )
    value.pose.orientation = quaternion(q)
    return value


def converted(name: str, value: Any, scene: ConversionState, now_ns: int = NOW_NS) -> Any:
    found = into(name).convert(value, "user1", scene, now_ns=now_ns, wall_ns=now_ns)
    return found[0] if found else None


def wave(scene: ConversionState, begin_ns: int, duration_s: float, *, epoch: int = 0) -> int:
    """Move the arm with wrist and body; return the time of the end."""
    now_ns = begin_ns
    for tick in range(round(50 * duration_s)):
        now_ns, time_s = begin_ns + tick * NS_PER_S // 50, tick / 50
        arm = rotation.from_azimuth_elevation(
            0.3 * math.sin(7.0 * time_s), 0.3 * math.sin(5.0 * time_s + 1.0), 0.3 * math.sin(9.0 * time_s)
        )
        body = rotation.multiply(rotation.multiply(rotation.from_yaw(YAW_RAD), arm), MOUNT)
        assert converted("mocap_forearm", posed(body, stamp_ns=now_ns), scene, now_ns) is None
        scene.take("user1", ImuSample(stamp_ns=now_ns, orientation_xyzw=arm, yaw_epoch=epoch), now_ns)
    return now_ns


def test_the_yaw_of_a_pose_is_that_of_the_forearm_and_its_own_orientation_does_not_count() -> None:
    scene = furnished()
    now_ns = wave(scene, NOW_NS, 3.0)
    for q in (NONE, rotation.from_yaw(-2.0)):
        output = converted("mocap_pose", posed(q, stamp_ns=now_ns), scene, now_ns)
        assert isinstance(output, BusOutput), output
        pose: Any = output.what
        assert (pose.method, pose.position_m) == ("external", (1.0, 2.0, 0.0))
        assert pose.yaw_rad == pytest.approx(YAW_RAD, abs=math.radians(0.3))
        assert 0.0 < math.sqrt(pose.covariance[8]) < math.radians(1.0)


def test_a_pose_is_refused_with_the_remedy_until_the_forearm_has_moved() -> None:
    scene = furnished()
    assert converted("mocap_forearm", posed(MOUNT), scene) is None
    warning = converted("mocap_pose", posed(rotation.IDENTITY), scene)
    assert isinstance(warning, ConversionWarning)
    assert warning.sentence.startswith("the yaw of user1 is not known: move the arm")


def test_another_yaw_origin_of_the_wrist_makes_the_yaw_unknown_again() -> None:
    scene = furnished()
    now_ns = wave(scene, NOW_NS, 3.0)
    assert isinstance(converted("mocap_pose", posed(NONE, stamp_ns=now_ns), scene, now_ns), BusOutput)
    now_ns = wave(scene, now_ns + NS_PER_S // 50, 0.1, epoch=1)
    last = converted("mocap_pose", posed(NONE, stamp_ns=now_ns), scene, now_ns)
    assert isinstance(last, BusOutput)
    pose: Any = last.what
    assert math.sqrt(pose.covariance[8]) > math.radians(90.0), "the pose that stays says that it is unknown"
    assert isinstance(converted("mocap_pose", posed(NONE), scene, now_ns), ConversionWarning)


def test_transforms_of_a_person_have_the_yaw_of_the_forearm_too() -> None:
    scene = furnished()
    scene.person("user1").is_here = True
    now_ns = wave(scene, NOW_NS, 3.0)
    frames = [transform("world", "user1/human_footprint", (1.0, 2.0, 0.0), rotation.from_yaw(2.0), now_ns)]
    value = jazzy().make("tf2_msgs/msg/TFMessage", transforms=frames)
    (output,) = Poses().tf(value, ConversionContext(scene, "", now_ns, "world", now_ns))
    assert isinstance(output, BusOutput)
    pose: Any = output.what
    assert pose.yaw_rad == pytest.approx(YAW_RAD, abs=math.radians(0.3))


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (posed(NONE), "the forearm's body of user1 is not a rotation"),
        (posed(MOUNT, frame="odom"), "in the frame 'odom': send it in 'world'"),
        (posed(MOUNT, stamp_ns=NOW_NS - 60 * NS_PER_S), "behind the site's clock"),
    ],
)
def test_a_forearm_that_cannot_be_one_is_reported(value: Any, reason: str) -> None:
    warning = converted("mocap_forearm", value, furnished())
    assert isinstance(warning, ConversionWarning)
    assert reason in warning.sentence
