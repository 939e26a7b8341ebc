"""True poses of people, and errors of localized ones."""

import pytest

from pointit.forearm.true_pose import PoseError, TruePose, find_true_poses
from pointit.schemas import NS_PER_S, TrackedObject, TrackedObjects, UserPose

NOW_NS = 1000 * NS_PER_S


def tracked(kind: str, name: str = "anna", x: float = 1.0, *, yaw_rad: float | None = 3.0) -> TrackedObjects:
    each = TrackedObject(id=name, kind=kind, position_m=(x, 2.0, 1.7), yaw_rad=yaw_rad)
    return TrackedObjects(stamp_ns=NOW_NS, objects=(each,))


def localized(stamp_ns: int = NOW_NS, method: str = "static_targets") -> UserPose:
    fields = {"stamp_ns": stamp_ns, "position_m": (1.3, 2.4, 0.0), "yaw_rad": -3.0, "method": method}
    return UserPose.model_validate(fields)


def test_only_people_have_true_poses_and_one_with_a_yaw_wins() -> None:
    position, frame = tracked("person", x=5.0), tracked("person_frame")
    expected = {"anna": TruePose(NOW_NS, (1.0, 2.0, 1.7), 3.0)}
    cup = tracked("red", "cup")
    assert find_true_poses({"a": position, "b": frame, "c": cup}) == expected
    assert find_true_poses({"a": frame, "b": position, "c": cup}) == expected


def test_the_azimuth_of_a_face_is_not_the_yaw_of_the_frame() -> None:
    assert find_true_poses({"a": tracked("person")})["anna"].yaw_rad is None


def test_the_yaw_error_is_the_shorter_turn_and_height_does_not_count() -> None:
    error = TruePose(NOW_NS, (1.0, 2.0, 1.7), 3.0).error_of(localized())
    assert error is not None
    assert (error.position_m, error.yaw_rad) == pytest.approx((0.5, 0.283185), abs=1e-6)
    assert TruePose(NOW_NS, (1.0, 2.0, 1.7), None).error_of(localized()) == PoseError(error.position_m, None)


def test_a_pose_stays_in_force_but_one_later_than_the_truth_or_of_a_tracker_has_no_error() -> None:
    true_pose = TruePose(NOW_NS, (1.0, 2.0, 1.7), 3.0)
    assert true_pose.error_of(localized(NOW_NS - 600 * NS_PER_S)) is not None
    assert true_pose.error_of(localized(NOW_NS + NS_PER_S)) is None
    assert true_pose.error_of(localized(method="external")) is None
