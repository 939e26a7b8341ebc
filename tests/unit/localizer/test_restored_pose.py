"""Poses that a localizer which was restarted is given back, and those with impossible uncertainties."""

import math

import numpy as np
import pytest

from pointit.schemas import NS_PER_S, SetPose, TrackedObject, TrackedObjects, UserPose
from pointit.schemas.base import Vec3
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.pose_manager import PoseManager, Response
from pointit.services.localizer.procedures.moving_target import MAX_TRACKS, MovingTarget
from pointit.services.localizer.tracking.pose_tracking import PoseTracker
from tests.unit.localizer.person import ROOM, START_NS, config

S = NS_PER_S
Covariance = tuple[float, float, float, float, float, float, float, float, float]
FOUND: Covariance = (0.04, 0.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 0.01)


def started(**fields: object) -> PoseManager:
    locating = PoseManager("anna", LocalizerConfig.model_validate({"yaw_deg": 20.0, **fields}))
    locating.begin(START_NS)
    locating.on_map(ROOM, START_NS)
    return locating


def given_back(locating: PoseManager, method: str, yaw_rad: float = 0.4) -> UserPose:
    query = SetPose.model_validate(
        {"position_m": (1.0, 1.0, 0.0), "yaw_rad": yaw_rad, "method": method, "covariance": FOUND}
    )
    answer = locating.set_pose(query, START_NS)
    assert isinstance(answer, Response)
    (pose,) = answer.outputs
    assert isinstance(pose, UserPose)
    return pose


@pytest.mark.parametrize("method", ["fixed", "static_targets", "moving_target"])
@pytest.mark.parametrize("track_drift", [None, True])
def test_pose_with_covariance_is_restored_by_any_method(method: str, *, track_drift: bool | None) -> None:
    locating = started(track_drift=track_drift)
    pose = given_back(locating, method)
    assert pose.method == method
    assert pose.covariance == pytest.approx(FOUND, abs=1e-9)
    assert pose.yaw_rad == pytest.approx(0.4)  # of the configured one nothing is left
    assert pose.anchored_ns == 0
    assert locating.is_followed
    figures = {name: value for name, value, _ in locating.figures(START_NS + S)}
    assert figures["anchor age"] is None
    assert list(figures.values())[-1] == pytest.approx(math.degrees(0.1), rel=0.1)
    (later,) = locating.due(START_NS + 60 * S)
    assert isinstance(later, UserPose)
    assert later.covariance[8] > 0.02  # less sure with time
    assert later.anchored_ns == 0


def test_restoring_a_pose_twice_does_not_make_it_more_certain() -> None:
    locating = started()
    given_back(locating, "static_targets")
    again = given_back(locating, "static_targets", yaw_rad=0.42)
    assert again.covariance[8] == pytest.approx(0.01)
    assert again.yaw_rad == pytest.approx(0.42)


def test_without_drift_it_stays_but_is_not_exact() -> None:
    locating = started(track_drift=False)
    pose = given_back(locating, "fixed")
    assert pose.covariance == FOUND
    assert not locating.is_followed


@pytest.mark.parametrize(
    "covariance",
    [
        (0.0, 0.0, 0.0, 1.0, -1e12, 0.0, 1e12, 0.0, 0.0),
        (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0),
        (1e12,) * 9,
        (0.0, 1e12, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (1.0, 1e12, -1e12, -1e12, 0.0, 1.0, 1e12, 1e12, -1e12),
    ],
)
def test_an_anchor_is_asked_for_whatever_a_tracker_says_of_its_certainty(covariance: Covariance) -> None:
    locating = started()
    pose = UserPose(
        stamp_ns=START_NS, position_m=(1.0, 1.0, 0.0), yaw_rad=0.0, method="external", covariance=covariance
    )
    locating.on_pose(pose, START_NS)
    assert isinstance(locating.point_anchor("", START_NS), Response)
    tracking = PoseTracker()
    tracking.set_external(pose)
    _, told = tracking.uncertainty(START_NS)
    assert np.array_equal(told, told.T)
    assert np.linalg.eigvalsh(told)[0] >= -1e-9
    assert np.all(np.diag(told) <= [100.0**2 + 1e-6, 100.0**2 + 1e-6, math.pi**2 + 1e-6])


def place(index: int) -> Vec3:
    return (1.0 + 0.01 * index, 0.0, 1.0)


def robots(stamp_ns: int, *names: str) -> TrackedObjects:
    return TrackedObjects(
        stamp_ns=stamp_ns,
        objects=tuple(
            TrackedObject(id=name, kind="robot", position_m=place(index)) for index, name in enumerate(names)
        ),
    )


def count(procedure: MovingTarget, now_ns: int) -> int:
    news = procedure.cancel(now_ns)[-1]
    return getattr(news, "target_count", -1)


def test_robots_that_left_are_forgotten_without_any_ray() -> None:
    procedure = MovingTarget(config(window_s=10.0, autostart=True))
    procedure.start(START_NS)
    for second in range(300):
        procedure.on_objects("room", robots(START_NS + second * S, f"robot_{second}"))
    assert count(procedure, START_NS + 300 * S) == 11


def test_robots_are_bounded_and_the_newest_stay() -> None:
    procedure = MovingTarget(config(autostart=True))
    procedure.start(START_NS)
    for number in range(2 * MAX_TRACKS):
        procedure.on_objects(f"tracker_{number}", robots(START_NS + number, "drone"))
    assert count(procedure, START_NS) == MAX_TRACKS
