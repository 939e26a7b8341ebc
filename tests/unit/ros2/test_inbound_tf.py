"""Poses of people by /tf and /tf_static."""

import pytest

from pointit.bridges.ros2.inbound.person import MAX_TF_AGE_NS, MAX_TRANSFORMS, SOONEST_NS
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import POSE, SET_POSE
from tests.unit.ros2.scenes import NOW_NS, furnished, into
from tests.unit.ros2.test_inbound import frame_of, output, taken, tf, warned


def test_tf_gives_the_poses_of_the_people_who_are_known() -> None:
    row, scene = into("tf_in"), furnished()
    scene.person("user1")
    scene.person("user2")
    frames = [("base_link", "odom"), ("user1/human_footprint",), ("user3/human_footprint",)]
    found = taken(row, tf(*(frame_of(*each) for each in [*frames, ("user2/human_footprint", "odom")])), scene)
    assert [(each.at, each.name) for each in found[:-1] if isinstance(each, BusOutput)] == [(POSE, "user1")]
    assert warned(found[-1:]) == "the pose of user2 is in the frame 'odom': send it in 'world'"
    assert scene.person("user1").tf_until_ns == NOW_NS + MAX_TF_AGE_NS
    assert scene.person("user2").tf_until_ns == 0


def test_tf_is_taken_no_more_often_than_is_of_use() -> None:
    row, scene = into("tf_in"), furnished()
    scene.person("user1")
    times = [0, 1, SOONEST_NS - 1, SOONEST_NS, SOONEST_NS + 5, -NS_PER_S]  # at last the clock is set back
    value = tf(frame_of("user1/human_footprint"))
    assert [len(taken(row, value, scene, now_ns=NOW_NS + each)) for each in times] == [1, 0, 0, 1, 0, 1]


def test_a_static_frame_tells_the_pose_once() -> None:
    row, scene = into("tf_static_in"), furnished()
    scene.person("user1")
    one = output(taken(row, tf(frame_of("user1/human_footprint")), scene))
    assert (one.at, one.name, one.what.position_m) == (SET_POSE, "user1", (1.0, 2.0, 0.0))
    assert one.what.yaw_rad == pytest.approx(1.0)
    assert scene.person("user1").tf_until_ns > NOW_NS + 3600 * NS_PER_S
    assert "not a position" in warned(taken(row, tf(frame_of("user1/human_footprint", x=1e9)), scene))
    assert "in the frame 'map'" in warned(taken(row, tf(frame_of("user1/human_footprint", "map")), scene))


def test_a_static_frame_that_was_told_before_its_person_came_is_theirs_when_they_come() -> None:
    row, scene = into("tf_static_in"), furnished()
    frames = tf(frame_of("anna/human_footprint"), frame_of("ben/human_footprint", "map"))
    assert taken(row, frames, scene) == []
    assert row.on_presence is not None
    one = output([*row.on_presence(ConversionContext(scene, "anna", NOW_NS))])
    assert (one.at, one.name, one.what.position_m) == (SET_POSE, "anna", (1.0, 2.0, 0.0))
    assert row.on_presence(ConversionContext(scene, "ben", NOW_NS)) == (), "in another frame"
    for count in range(MAX_TRANSFORMS):
        taken(row, tf(frame_of(f"box_{count}")), scene)
    kept = row.on_presence(ConversionContext(scene, "anna", NOW_NS))
    assert kept == (), "as many are kept as one message may have"
