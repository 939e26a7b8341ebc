"""True pose of a person who uses the mouse."""

import math

import pytest

from pointit.bridges.web.config import Place
from pointit.bridges.web.model.assumed_pose import AssumedPose, choose_pose, middle, places
from pointit.schemas import Belt, Environment, Lamp, Localization, Plane, UserPose


def pose(x: float, yaw: float = 0.0) -> UserPose:
    return UserPose(stamp_ns=1, position_m=(x, 0.0, 0.0), yaw_rad=yaw)


def progress(phase: str, purpose: str = "pose") -> Localization:
    return Localization.model_validate({"stamp_ns": 1, "phase": phase, "purpose": purpose})


def lamps(*positions: tuple[float, float, float]) -> Environment:
    return Environment(
        stamp_ns=0, name="room", lamps=tuple(Lamp(id=f"l{k}", position_m=p) for k, p in enumerate(positions))
    )


def test_the_newest_pose_counts_then_the_configured_place_then_the_room() -> None:
    standing = AssumedPose(Place(position_m=(1.0, 2.0, 0.0), yaw_deg=90.0))
    assert standing.at[0] == (1.0, 2.0, 0.0)
    assert standing.at[1] == pytest.approx(math.pi / 2)
    assert standing.assumed == standing.at
    standing.pose(pose(3.0))
    assert standing.assumed is None
    standing.pose(pose(4.0, 0.5))
    assert standing.at == ((4.0, 0.0, 0.0), 0.5)
    unknown = AssumedPose()
    assert unknown.assumed is None
    unknown.room(((7.0, 7.0, 0.0), 1.0))
    assert unknown.at == ((7.0, 7.0, 0.0), 1.0)


def test_while_a_localization_samples_the_truth_is_where_it_began() -> None:
    standing = AssumedPose()
    standing.pose(pose(1.0))
    standing.localization(progress("sampling"))
    standing.pose(pose(2.0))
    standing.localization(progress("sampling"))
    assert standing.at[0][0] == 1.0
    standing.localization(progress("solved"))
    assert standing.at[0][0] == 2.0


def test_an_anchor_is_pointed_at_as_the_pose_says() -> None:
    standing = AssumedPose()
    standing.localization(progress("sampling", "anchor"))
    standing.pose(pose(2.0))
    assert standing.at[0][0] == 2.0


def test_in_a_wide_room_one_stands_in_its_middle() -> None:
    room = lamps((4.0, 0.0, 1.0), (-4.0, 0.0, 1.0), (0.0, 4.0, 2.0), (0.0, -4.0, 1.0))
    (x, y, z), _ = choose_pose(room)
    assert (x, y, z) == (0.0, 0.0, 0.0)
    assert middle(room) == (0.0, 0.0, 1.5)


def test_at_a_belt_one_stands_two_metres_beside_it_and_faces_it() -> None:
    room = Environment(
        stamp_ns=0, name="hall", belts=(Belt(id="b", line_m=((-3.0, 0.0, 1.0), (3.0, 0.0, 1.0))),)
    )
    (x, y, _), yaw_rad = choose_pose(room)
    assert 2.0 <= abs(y) < 2.6
    assert abs(x) < 1.0
    to_middle = math.atan2(-y, -x)
    assert yaw_rad == pytest.approx(to_middle)


def test_in_a_narrow_room_nobody_stands_outside() -> None:
    (x, y, _), _ = choose_pose(lamps((1.5, 0.0, 1.0), (-1.5, 0.0, 1.0), (0.0, 1.5, 2.0), (0.0, -1.5, 1.0)))
    assert math.hypot(x, y) < 0.5


def test_an_empty_or_endless_room_has_a_place_too() -> None:
    floor = Environment(
        stamp_ns=0,
        name="floor",
        planes=(Plane(id="floor", center_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),),
    )
    assert len(places(floor)) == 0
    assert choose_pose(floor) == ((0.0, 0.0, 0.0), 0.0)
    assert middle(floor)[0] > 0.0
