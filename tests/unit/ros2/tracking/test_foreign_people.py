"""Poses and arms of people as drivers of others write them, in CDR by the serializer of rosbags."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from pointit.bridges.ros2.inbound.person import REPLACED_NS, people_in
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionWarning
from pointit.schemas import UserPose, WristSample
from tests.unit.ros2.scenes import NOW_NS, into, jazzy
from tests.unit.ros2.tracking.rosbags_values import (
    LEFT,
    NAN,
    STORE,
    Quaternion,
    decoded,
    header,
    message,
    posed,
    transforms,
    vector,
)


def scene_of(user: str) -> ConversionState:
    scene = ConversionState(jazzy(), world="/map", person="/{user}/feet")
    scene.person(user).is_here = True
    return scene


def outputs_of(route: str, value: Any, *, user: str = "", scene: ConversionState | None = None) -> list[Any]:
    converted: Sequence[Any] = into(route).convert(
        value, user, scene or scene_of("anna"), now_ns=NOW_NS, wall_ns=NOW_NS
    )
    return [each.what for each in converted if isinstance(each, BusOutput)]


@pytest.mark.parametrize(("parent", "child"), [("map", "anna/feet"), ("/map", "/anna/feet")])
def test_a_persons_pose_is_read_with_and_without_slashes(parent: str, child: str) -> None:
    scene = scene_of("anna")
    sent = transforms((parent, child, 4.0))
    cdr = bytes(STORE.serialize_cdr(sent, "tf2_msgs/msg/TFMessage"))
    assert people_in(cdr, scene) == ("anna",)
    (pose,) = outputs_of("tf_in", jazzy().decode("tf2_msgs/msg/TFMessage", cdr), scene=scene)
    assert isinstance(pose, UserPose)
    assert pose.position_m == (4.0, 0.0, 0.0)
    name = "geometry_msgs/msg/PoseStamped"
    (pose,) = outputs_of("mocap_pose", decoded(name, message(name, header(parent), posed(5.0))), user="anna")
    assert pose.position_m == (5.0, 2.0, 0.0)


@pytest.mark.parametrize(
    ("turned", "variance", "is_read"),
    [
        (LEFT, 0.0, True),  # all 0: unknown
        (LEFT, NAN, True),
        (LEFT, -1.0, False),  # measures none
        ((0.0, 0.0, 0.0, 0.0), 0.0, False),
    ],
)
def test_an_imu_is_read_by_what_it_says_of_its_orientation(
    turned: Quaternion,
    variance: float,
    is_read: bool,  # noqa: FBT001 - a row of the table
) -> None:
    name = "sensor_msgs/msg/Imu"
    three = np.array([variance, *(0.0,) * 8])
    value = message(
        name,
        header("/imu_link"),
        message("geometry_msgs/msg/Quaternion", *turned),
        three,
        *(vector(NAN), np.full(9, NAN), vector(NAN), np.full(9, NAN)),
    )
    found = outputs_of("imu_in", decoded(name, value), user="anna")
    assert [type(each) for each in found] == ([WristSample] if is_read else [])


def test_imu_in_another_frame_is_reported_and_never_moves_the_arm_of_the_first() -> None:
    route, scene = into("imu_in"), scene_of("anna")
    samples: list[WristSample] = []
    warnings: set[str] = set()

    def send(frame: str, turned: Quaternion, now_ns: int) -> None:
        three = (np.zeros(9), vector(0.0), np.zeros(9), vector(0.0), np.zeros(9))
        quaternion = message("geometry_msgs/msg/Quaternion", *turned)
        name = "sensor_msgs/msg/Imu"
        value = decoded(name, message(name, header(frame, stamp_ns=now_ns), quaternion, *three))
        for each in route.convert(value, "anna", scene, now_ns=now_ns, wall_ns=now_ns):
            if isinstance(each, ConversionWarning):
                warnings.add(each.sentence)
            elif isinstance(each.what, WristSample):
                samples.append(each.what)

    for step in range(10):
        frame, turned = (("/wrist_imu", LEFT), ("elbow_imu", (0.0, 0.0, 0.0, 1.0)))[step % 2]
        send(frame, turned, NOW_NS + step * 10**7)
    assert [each.orientation_xyzw for each in samples] == [pytest.approx(LEFT)] * 5
    (warning,) = warnings
    assert "that of frame 'wrist_imu' is used, not that of 'elbow_imu'; let only one" in warning
    send("elbow_imu", LEFT, NOW_NS + 2 * REPLACED_NS)
    assert len(samples) == 6
