"""People as REP-155 defines them."""

import dataclasses
import math
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import LATCHED
from pointit.bridges.ros2.outbound.humans import BODY, JOINTS, MAX_KNOWN, NEAR_M, confidence, shoulder
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.bridges.ros2.types.definitions import ROS4HRI_MESSAGES, Definitions
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures, ImuSample, UserPose, UserProfile
from pointit.schemas.topics import POSE
from tests.support.bench import until
from tests.unit.ros2.graph_of_one import Bench, bench
from tests.unit.ros2.scenes import NOW_NS, furnished, jazzy, out, sent
from tests.unit.ros2.scenes import POSE as PLACE

TALL = UserProfile(
    stamp_ns=NOW_NS, hand="left", body=BodyMeasures(footprint_to_neck_m=1.6, neck_to_eyes_m=0.2)
)
LIST = "hri_msgs/msg/IdsList"
BOOL = "std_msgs/msg/Bool"
FLOAT = "std_msgs/msg/Float32"
TEXT = "std_msgs/msg/String"
TRACKED = "/humans/persons/tracked"
ANNA = "/humans/persons/anna"


@pytest.fixture
def table() -> Routes:
    return routes(ros4hri=True)


def arm(azimuth_rad: float, elevation_rad: float) -> ImuSample:
    turned = rotation.from_azimuth_elevation(azimuth_rad, elevation_rad, 0.3)
    return ImuSample(stamp_ns=NOW_NS, orientation_xyzw=turned)


def spread(sigma_m: float, *, across_m: float | None = None, turned_rad: float = 0.0) -> UserPose:
    """A place that is known to `sigma_m` along one direction and `across_m` across it."""
    c = math.cos(turned_rad)
    s = math.sin(turned_rad)
    along = sigma_m**2
    across = (sigma_m if across_m is None else across_m) ** 2
    xx = c * c * along + s * s * across
    xy = c * s * (along - across)
    yy = s * s * along + c * c * across
    return PLACE.model_copy(update={"covariance": (xx, xy, 0.0, xy, yy, 0.0, 0.0, 0.0, 0.0)})


def here(*people: str) -> ConversionState:
    scene = furnished()
    for person in people:
        scene.person(person).is_here = True
    return scene


def frame(table: Routes, name: str, scene: ConversionState, place: UserPose = PLACE) -> Any:
    (message,) = sent(out(table, name), place, scene, "anna")
    (transform,) = message.transforms
    return transform


def origin(transform: Any) -> Vec3:
    at = transform.transform.translation
    return at.x, at.y, at.z


def forward(transform: Any) -> Vec3:
    turned = transform.transform.rotation
    return rotation.rotate((turned.x, turned.y, turned.z, turned.w), (1.0, 0.0, 0.0))


def test_ros4hri_routes_are_changed_by_file_without_a_prefix(tmp_path: Path) -> None:
    path = tmp_path / "routes.yaml"
    path.write_text("prefix: /site1\nroutes: {head_tf: {enabled: false}}\n")
    assert not any(row.ros.startswith("/humans/") for row in routes(path).outward)
    rows = {row.name: row for row in routes(path, ros4hri=True).outward}
    assert rows["tracked_people"].ros == TRACKED
    assert rows["packages"].ros == "/site1/packages"
    assert not rows["head_tf"].enabled


def test_definitions_have_the_hashes_of_another_implementation() -> None:
    store = Definitions("jazzy").store
    hashes = {
        "hri_msgs/msg/IdsList": "7e0812d1ac945c98fd3e393568d581ad0ab567f37b24eff633eab778c1bfe62d",
        "hri_msgs/msg/IdsMatch": "1c649d4a87ca2d4fe5f606395e83a863640e411c9192dfda6d399a68019966f0",
    }
    assert set(hashes) == set(ROS4HRI_MESSAGES)
    for name, digits in hashes.items():
        for distro in ("jazzy", "lyrical"):
            assert Types(distro).kind(name).hash == store.hash_rihs01(name) == f"RIHS01_{digits}"


def test_latching_follows_rep_155_and_body_ids_differ_from_persons(table: Routes) -> None:
    for name in ("anonymous", "body_id", "tracked_people", "known_people", "tracked_bodies"):
        assert out(table, name).qos == LATCHED
    assert not out(table, "location_confidence").qos.latched
    (match,) = sent(out(table, "candidate_matches"), PLACE, here("anna"), "anna")
    assert (match.id1, match.id1_type, match.id2, match.id2_type) == ("anna_body", 3, "anna", 1)
    assert match.confidence == 1.0


@given(st.floats(0.01, 5.0), st.floats(0.01, 5.0), st.floats(0.0, math.pi))
def test_confidence_is_the_share_of_the_distribution_within_reach(
    a_m: float, b_m: float, turned_rad: float
) -> None:
    expected = 1.0 - math.exp(-(NEAR_M**2) / (2.0 * max(a_m, b_m) ** 2))  # by the worst direction only
    assert confidence(spread(a_m, across_m=b_m, turned_rad=turned_rad)) == pytest.approx(expected, rel=1e-6)
    assert confidence(spread(0.0)) == 1.0


def test_head_is_at_the_eyes_and_hips_at_half_height(table: Routes) -> None:
    scene = here("anna")
    scene.take("anna", TALL, NOW_NS)
    for name, parent, child, at_m in (
        ("person_tf", "world", "person_anna", (1.0, 2.0, 0.5 + 1.8)),
        ("body_tf", "world", "body_anna_body", (1.0, 2.0, 0.5 + 0.9)),
        ("head_tf", "body_anna_body", "head_anna_body", (0.0, 0.0, 0.9)),
    ):
        found = frame(table, name, scene)
        assert origin(found) == pytest.approx(at_m)
        assert (found.header.frame_id, found.child_frame_id) == (parent, child)


def test_body_faces_the_last_direction_of_a_raised_arm(table: Routes) -> None:
    scene = here("anna")
    ahead = vector.direction(PLACE.yaw_rad, 0.0)
    assert forward(frame(table, "body_tf", scene)) == pytest.approx(ahead), "x of {H} without an arm"
    for azimuth_rad, elevation_rad, facing_rad in ((0.7, 0.2, 0.7), (-2.0, -1.5, 0.7), (-2.0, -0.5, -2.0)):
        scene.take("anna", arm(azimuth_rad, elevation_rad), NOW_NS)
        expected = vector.direction(PLACE.yaw_rad + facing_rad, 0.0)
        for name in ("body_tf", "person_tf"):
            assert forward(frame(table, name, scene)) == pytest.approx(expected, abs=1e-9)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.sampled_from([1.0, -1.0]))
def test_the_shoulder_turns_as_in_the_reference_model(
    azimuth_rad: float, elevation_rad: float, side: float
) -> None:
    wanted = vector.direction(azimuth_rad, elevation_rad)
    turn_rad, lift_rad = shoulder(wanted, is_left=side > 0.0)
    # axes of the joints in human-tpl.xacro: y_shoulder (0, 0, -side), then p_shoulder (side, 0, 0)
    lifted = rotation.rotate(rotation.from_axis_angle((side, 0.0, 0.0), lift_rad), (0.0, 0.0, -1.0))
    found = rotation.rotate(rotation.from_axis_angle((0.0, 0.0, -side), turn_rad), lifted)
    assert found == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(("hand", "outward"), [("left", 1.0), ("right", -1.0)])
def test_joints_follow_the_pointing_arm_and_others_are_zero(
    table: Routes, hand: Literal["left", "right"], outward: float
) -> None:
    scene = here("anna")
    scene.take("anna", TALL.model_copy(update={"hand": hand}), NOW_NS)
    scene.take("anna", arm(1.2, 0.0), NOW_NS)  # where she faces
    (joints,) = sent(out(table, "joint_states"), arm(1.2 + outward * 0.4, 1.5), scene, "anna")
    angles = dict(zip(joints.name, joints.position, strict=True))
    assert set(angles) == {f"{name}_anna_body" for name in JOINTS}
    moved = {name: angle for name, angle in angles.items() if angle}
    turn = f"{hand[0]}_y_shoulder_anna_body"
    lift = f"{hand[0]}_p_shoulder_anna_body"
    assert moved == pytest.approx({turn: math.pi / 2 - 0.4, lift: math.pi / 2 + 1.5})


def test_only_present_people_with_a_position_are_listed(table: Routes) -> None:
    scene = here("anna", "ben")
    (people,) = sent(out(table, "tracked_people"), PLACE, scene, "ben")
    assert people.ids == ["ben"]
    (people,) = sent(out(table, "tracked_people"), PLACE, scene, "3d-printer")
    assert people.ids == ["ben"]
    scene.person("3d-printer").is_here = True
    (bodies,) = sent(out(table, "tracked_bodies"), PLACE, scene, "3d-printer")
    assert bodies.ids == [BODY.format(user=name) for name in ("_3d_printer", "ben")]


def test_known_people_are_bounded_and_those_who_are_here_stay(table: Routes) -> None:
    known = out(table, "known_people")
    scene = here("anna")
    (people,) = sent(known, PLACE, scene, "anna")
    for count in range(MAX_KNOWN):
        scene.person(f"user{count}").is_here = True
        (people,) = sent(known, PLACE, scene, f"user{count}")
        scene.forget(f"user{count}")
    assert len(people.ids) == MAX_KNOWN
    assert {"anna", f"user{MAX_KNOWN - 1}", "user1"} <= set(people.ids)
    assert "user0" not in people.ids


def of_lists_and_people() -> Routes:
    table = routes(ros4hri=True)
    rows = [row for row in table.outward if row.is_ros4hri and row.name not in {"body_tf", "head_tf"}]
    return dataclasses.replace(table, outward=tuple(rows))


def come(bridge: Bench, user: str) -> None:
    bridge.scene.person(user).is_here = True
    bridge.outbox.join(user)
    bridge.scene.take(user, PLACE, bridge.clock.now_ns())
    pose: Any = POSE
    bridge.outbox.take(pose, PLACE, user)


def leave(bridge: Bench, user: str) -> None:
    bridge.outbox.leave(user)
    bridge.scene.forget(user)


async def test_lists_follow_people_and_reach_late_readers() -> None:
    async with bench(jazzy(), of_lists_and_people()) as bridge:
        come(bridge, "anna")
        come(bridge, "ben")

        def listed(which: str = "tracked") -> list[str]:
            seen = bridge.heard(f"/humans/persons/{which}", LIST)
            return seen[-1].ids if seen else []

        await until(lambda: listed() == ["anna", "ben"])
        count = len(bridge.backend.sent[TRACKED])
        await until(lambda: len(bridge.backend.sent[TRACKED]) > count + 1, what="the list to be repeated")
        leave(bridge, "anna")
        await until(lambda: listed() == ["ben"])
        assert set(listed("known")) == {"anna", "ben"}
        assert [each.data for each in bridge.heard(f"{ANNA}/location_confidence", FLOAT)] == [0.0]
        assert [each.data for each in bridge.heard(f"{ANNA}/body_id", TEXT)] == ["anna_body", ""]
        assert [each.data for each in bridge.heard(f"{ANNA}/anonymous", BOOL)] == [False]
        assert f"{ANNA}/anonymous" not in bridge.backend.writers
    assert bridge.heard(TRACKED, LIST)[-1].ids == [], "the last value when the bridge ends"


async def test_people_are_left_to_a_person_manager_but_not_bodies() -> None:
    async with bench(jazzy(), of_lists_and_people(), is_read=True) as bridge:
        come(bridge, "anna")
        assert "/tf" in bridge.backend.writers
        bridge.look(("publisher", TRACKED))
        assert TRACKED not in bridge.backend.writers
        assert "/tf" not in bridge.backend.writers, "person_anna is the manager's"
        assert {"/humans/bodies/tracked", "/humans/candidate_matches"} <= set(bridge.backend.writers)
        bridge.look()
        await until(lambda: {TRACKED, "/tf"} <= set(bridge.backend.writers))
