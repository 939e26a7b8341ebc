"""Chains of transforms: what they lead to, and when they are refused."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.sightings import AT_ORIGIN, Pose, TransformBuffer, compose, yaw
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from tests.unit.ros2 import scenes
from tests.unit.ros2.scenes import NOW_NS, jazzy

ROOTS = {"world": AT_ORIGIN}
METRES = st.floats(-100.0, 100.0)
TURNS = st.floats(-math.pi, math.pi)


def tilted(at_m: Vec3, yaw_rad: float, tilt_rad: float) -> Pose:
    return Pose(at_m, rotation.from_azimuth_elevation(yaw_rad, tilt_rad))


POSES = st.builds(tilted, st.tuples(METRES, METRES, METRES), TURNS, st.floats(-1.0, 1.0))


def transform(parent: str, child: str, pose: Pose = AT_ORIGIN, age_s: float = 0.0) -> Any:
    stamp_ns = NOW_NS - round(age_s * NS_PER_S)
    return scenes.transform(parent, child, pose.position_m, pose.orientation, stamp_ns)


def message(*transforms: Any) -> Any:
    return jazzy().make("tf2_msgs/msg/TFMessage", transforms=list(transforms))


def filled(*moving: Any, static: tuple[Any, ...] = ()) -> TransformBuffer:
    buffer = TransformBuffer()
    assert list(buffer.take(message(*moving), is_static=False)) == []
    assert list(buffer.take(message(*static), is_static=True)) == []
    return buffer


@given(st.lists(POSES, min_size=1, max_size=5), st.tuples(METRES, METRES, METRES))
def test_a_chain_moves_a_point_as_its_transforms_do_one_by_one(chain: list[Pose], at_m: Vec3) -> None:
    names = ["world", *(f"frame{count}" for count in range(len(chain)))]
    links = [transform(names[count], names[count + 1], pose) for count, pose in enumerate(chain)]
    placed = filled(*links[1:], static=(links[0],)).placed(names[-1], ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    expected = at_m
    for pose in reversed(chain):
        expected = vector.add(pose.position_m, rotation.rotate(pose.orientation, expected))
    found = compose(placed.pose, Pose(at_m, rotation.IDENTITY)).position_m
    assert vector.norm(vector.subtract(found, expected)) < 1e-6


def test_the_stamp_is_that_of_the_moving_transform_nearest_to_the_frame() -> None:
    buffer = filled(
        transform("map", "odom", age_s=-0.2),
        transform("odom", "base", age_s=0.1),
        static=(transform("world", "map"), transform("base", "lidar")),
    )
    placed = buffer.placed("lidar", ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    assert placed.stamp_ns == NOW_NS - NS_PER_S // 10


@pytest.mark.parametrize(
    ("links", "expected"),
    [
        ([("map", "base", 0.0)], "no transform leads from 'map' to 'world'"),
        ([("world", "odom", 1.5), ("odom", "base", 0.0)], "'world' to 'odom' is 1.5 s old, limit 1 s"),
        ([("world", "base", -1.5)], "is 1.5 s ahead, limit 1 s"),
        ([("odom", "base", 0.0), ("base", "odom", 0.0)], "go round in a circle"),
    ],
)
def test_a_frame_that_is_nowhere_is_refused(links: list[tuple[str, str, float]], expected: str) -> None:
    buffer = filled(*(transform(parent, child, age_s=age_s) for parent, child, age_s in links))
    placed = buffer.placed("base", ROOTS, NOW_NS, 1.0)
    assert isinstance(placed, str)
    assert expected in placed


@pytest.mark.parametrize(
    ("bad", "expected"),
    [
        (transform("odom", "odom"), "from a frame to itself"),
        (transform("odom", "base", Pose((math.nan, 0.0, 0.0), rotation.IDENTITY)), "is not a position"),
        (transform("odom", "base", Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))), "is not a rotation"),
    ],
)
def test_a_bad_transform_is_refused_and_the_last_good_one_stays(bad: Any, expected: str) -> None:
    good = Pose((1.0, 2.0, 3.0), rotation.IDENTITY)
    buffer = filled(transform("odom", "base", good), static=(transform("world", "odom"),))
    (sentence,) = buffer.take(message(bad), is_static=False)
    assert expected in sentence
    placed = buffer.placed("base", ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    assert placed.pose == good


def test_an_overtaken_transform_does_not_replace_a_newer_one() -> None:
    buffer = filled(transform("world", "base", Pose((1.0, 0.0, 0.0), rotation.IDENTITY)))
    assert list(buffer.take(message(transform("world", "base", age_s=0.5)), is_static=False)) == []
    placed = buffer.placed("base", ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    assert placed.pose.position_m == (1.0, 0.0, 0.0)


def test_frames_that_were_asked_for_and_those_above_are_found_in_bytes() -> None:
    buffer = filled(transform("odom", "base"))
    buffer.placed("base", ROOTS, NOW_NS, 1.0)
    cdr = jazzy().encode("tf2_msgs/msg/TFMessage", message(transform("map", "odom"), transform("base2", "x")))
    assert buffer.wanted_in(cdr) == ("odom",)


@given(TURNS)
def test_yaw_of_a_level_rotation_is_its_angle_and_of_an_upright_x_axis_that_of_its_y_axis(
    yaw_rad: float,
) -> None:
    turned = rotation.from_yaw(yaw_rad)
    upright = rotation.multiply(turned, rotation.from_axis_angle((0.0, 1.0, 0.0), -math.pi / 2))
    for each in (turned, upright):
        assert math.remainder(yaw(each) - yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-9)
