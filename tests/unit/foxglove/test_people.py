"""People against known numbers: frame, ellipse, arm, ray."""

import math
from typing import Any

import numpy as np
import pytest
from foxglove.messages import FrameTransforms, SceneUpdate
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.foxglove import entities as people
from pointit.bridges.foxglove.entities import DrawnPerson
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures, Cursor, UserPose, UserProfile
from tests.integration.foxglove.protobuf import read

BODY = BodyMeasures(neck_to_shoulder_m=0.2)
PROFILE = UserProfile(stamp_ns=1, body=BODY, cursor_color=(255, 0, 51))
EYES = (1.0, 2.0, 1.64)


def pose(covariance: tuple[float, ...] = (0.0,) * 9) -> UserPose:
    return UserPose.model_validate(
        {"stamp_ns": 1, "position_m": (1.0, 2.0, 0.0), "yaw_rad": math.pi / 2, "covariance": covariance}
    )


def shown(person: DrawnPerson) -> dict[str, dict[str, Any]]:
    drawn = people.entities("anna", person, 5)
    entities = read(SceneUpdate(entities=[each.entity for each in drawn])).get("entities", [])
    return {entity["id"]: entity for entity in entities}


def standing(covariance: tuple[float, ...] = (0.0,) * 9, cursor: Cursor | None = None) -> DrawnPerson:
    return DrawnPerson(profile=PROFILE, pose=pose(covariance), cursor=cursor)


def xyz(point: dict[str, float]) -> Vec3:
    return (point.get("x", 0.0), point.get("y", 0.0), point.get("z", 0.0))


def turn_of(primitive: dict[str, Any]) -> rotation.Quaternion:
    q = primitive["pose"]["orientation"]
    return (q.get("x", 0.0), q.get("y", 0.0), q.get("z", 0.0), q.get("w", 0.0))


def test_the_frame_of_the_feet() -> None:
    told = read(FrameTransforms(transforms=[people.transform("anna", pose(), 5)]))
    assert told["transforms"] == [
        {
            "timestamp": {"nanos": 5},
            "parent_frame_id": "world",
            "child_frame_id": "users/anna/feet",
            "translation": {"x": 1.0, "y": 2.0},
            "rotation": pytest.approx({"z": math.sqrt(0.5), "w": math.sqrt(0.5)}),
        }
    ]


@pytest.mark.parametrize("degrees", [10, 80, 100, 170])
def test_the_ellipse_lies_as_the_covariance_says(degrees: int) -> None:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    along, across = np.array([c, s]), np.array([-s, c])
    (xx, xy), (yx, yy) = (0.04 * np.outer(along, along) + 0.01 * np.outer(across, across)).tolist()
    rim = people.ellipse(pose((xx, xy, 0, yx, yy, 0, 0, 0, 1)))
    assert rim is not None
    reach_m = np.linalg.norm(rim[:, :2] - (1.0, 2.0), axis=1)
    assert (reach_m.max(), reach_m.min()) == pytest.approx((0.4, 0.2), rel=0.01)
    away = rim[np.argmax(reach_m), :2] - (1.0, 2.0)
    assert abs(away @ across) < 0.03


def test_a_place_that_is_known_has_no_ellipse() -> None:
    assert people.ellipse(pose()) is None
    assert "lines" not in shown(standing())["person anna"]
    assert len(shown(standing((0.04, 0, 0, 0, 0.01, 0, 0, 0, 1)))["person anna"]["lines"]) == 1


value = st.floats(-1e12, 1e12)


@given(st.tuples(*[value] * 9))
def test_any_covariance_can_be_shown(covariance: tuple[float, ...]) -> None:
    rim = people.ellipse(pose(covariance))
    assert rim is None or np.all(np.isfinite(rim))


def test_the_finger_is_on_the_line_from_the_eyes() -> None:
    direction = vector.normalized((1.0, 1.0, -0.5))
    cursor = Cursor(stamp_ns=1, origin_m=EYES, direction=direction)
    body = shown(standing(cursor=cursor))["person anna"]
    arm = body["cylinders"][1]
    length_m = arm["size"]["z"]
    assert length_m == pytest.approx(BODY.shoulder_to_wrist_m + BODY.wrist_to_finger_m)
    middle = xyz(arm["pose"]["position"])
    half = rotation.rotate(turn_of(arm), (0.0, 0.0, length_m / 2.0))
    finger, shoulder = vector.add(middle, half), vector.subtract(middle, half)
    # a right shoulder, at a right angle to the arm, wherever the IMU's yaw began
    away, along = vector.subtract(shoulder, (1.0, 2.0, 1.43)), vector.subtract(finger, shoulder)
    assert vector.rotate_z(away, math.pi / 2) == pytest.approx(
        vector.scale((along[0], along[1], 0.0), 0.2 / math.hypot(along[0], along[1]))
    )
    assert vector.angle_between(vector.subtract(finger, EYES), direction) < 1e-6


def test_who_does_not_point_has_no_arm_and_no_ray() -> None:
    body = shown(standing())
    assert set(body) == {"person anna"}
    assert len(body["person anna"]["cylinders"]) == 1
    assert xyz(body["person anna"]["spheres"][0]["pose"]["position"]) == pytest.approx(EYES)
    assert body["person anna"]["texts"][0]["text"] == "anna"
    assert body["person anna"]["spheres"][0]["color"] == pytest.approx({"r": 1.0, "b": 0.2, "a": 1.0})


def test_the_ray_ends_at_the_cursor() -> None:
    cursor = Cursor(
        stamp_ns=1,
        surface="strip",
        surface_id="s1",
        point_m=(1.0, 5.0, 1.64),
        range_m=3.0,
        origin_m=EYES,
        direction=(0.0, 1.0, 0.0),
    )
    seen = shown(DrawnPerson(profile=PROFILE, cursor=cursor))  # where they stand is not known
    assert set(seen) == {"ray anna", "cursor anna"}
    (arrow,) = seen["ray anna"]["arrows"]
    length_m = arrow["shaft_length"] + arrow["head_length"]
    tip = vector.add(xyz(arrow["pose"]["position"]), rotation.rotate(turn_of(arrow), (length_m, 0.0, 0.0)))
    assert tip == pytest.approx((1.0, 5.0, 1.64))
    assert xyz(seen["cursor anna"]["spheres"][0]["pose"]["position"]) == (1.0, 5.0, 1.64)
    assert {"key": "on", "value": "strip s1"} in seen["cursor anna"]["metadata"]


def test_a_ray_into_the_void_is_paler() -> None:
    cursor = Cursor(stamp_ns=1, origin_m=EYES, direction=(0.0, 1.0, 0.0))
    seen = shown(DrawnPerson(profile=PROFILE, cursor=cursor))
    assert set(seen) == {"ray anna"}
    assert seen["ray anna"]["arrows"][0]["color"]["a"] < 0.5
