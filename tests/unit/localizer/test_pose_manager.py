"""The pose manager: robots as anchors, poses that are given back, lamps, and a map that changes meanwhile."""

import math
from typing import Literal

import numpy as np
import pytest

from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Anchor,
    Environment,
    Lamp,
    Localization,
    RobotState,
    SetPose,
    Strip,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import SAME_PLACE_M, Refusal
from pointit.services.localizer.moving_target import MAX_TRACKS, MovingTarget
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.pose_manager import PoseManager, Response
from pointit.services.localizer.static_targets import lamps_for_pose, map_change_reason
from pointit.services.localizer.tracking import PoseTracker
from tests.unit.localizer.person import ROOM, START_NS, Person, config
from tests.unit.localizer.test_static_targets import LAMPS

QUAD: Vec3 = (2.5, 1.0, 0.3)
DRIFT_RAD = math.radians(6.0)
STEP_NS = NS_PER_S // 50
COVARIANCE = (0.02, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0, math.radians(6.0) ** 2)
BARE = Environment(stamp_ns=1, name="bare")
LIT = Strip(id="1", line_m=((0.0, 3.0, 1.0), (2.0, 3.0, 1.0)), pixels=60)


class Room:
    """Anna, whose IMU has turned by `DRIFT_RAD` since she was found, and a robot."""

    def __init__(self, environment: Environment = BARE, **fields: object) -> None:
        config = LocalizerConfig(method="moving_target", reaction_s=0.2, hold_s=0.5).model_copy(update=fields)
        self.core = PoseManager("anna", config)
        self.person = Person(0.0, 0.0, DRIFT_RAD)
        self.now_ns = 1000 * NS_PER_S
        self.heard: list[Output] = []
        self.core.on_map(environment, self.now_ns)
        found = SetPose(position_m=(0.0, 0.0, 0.0), covariance=COVARIANCE, method="moving_target")
        assert not isinstance(self.core.set_pose(found, self.now_ns), Refusal)
        self.drive("")

    def point(self, target: Vec3, seconds: float, *, speed_mps: float = 0.0) -> None:
        place = QUAD
        for _ in range(round(seconds * 50)):
            self.now_ns += STEP_NS
            place = (place[0] + speed_mps / 50.0, place[1], place[2])
            quad = TrackedObject(
                id="quad", kind="robot", position_m=place, velocity_mps=(speed_mps, 0.0, 0.0)
            )
            self.core.procedures.on_objects(
                TrackedObjects(stamp_ns=self.now_ns, objects=(quad,)), "robot.quad"
            )
            self.heard += self.core.on_ray(self.person.ray(target, self.now_ns), self.now_ns)
            self.heard += self.core.procedures.step(self.now_ns)

    def drive(self, user: str, *, speed_mps: float = 0.0) -> None:
        state = RobotState(
            stamp_ns=self.now_ns,
            kind="quadrotor",
            phase="idle",
            position_m=QUAD,
            yaw_rad=0.0,
            velocity_mps=(speed_mps, 0.0, 0.0),
            radius_m=0.2,
            user=user,
        )
        self.heard += self.core.on_robot(state, "quad", self.now_ns)

    @property
    def anchors(self) -> list[Anchor]:
        return [each for each in self.heard if isinstance(each, Anchor)]

    @property
    def yaw_rad(self) -> float:
        """The yaw that was published last."""
        return next(each.yaw_rad for each in reversed(self.heard) if isinstance(each, UserPose))


@pytest.mark.parametrize("how", ["no strips", "strips that do not show the cursor"])
def test_taking_a_robot_corrects_the_yaw(how: str) -> None:
    lit = BARE.model_copy(update={"strips": (LIT,)})
    room = Room() if how == "no strips" else Room(lit, anchor_at_robots=True)
    room.point(QUAD, 1.0)
    room.drive("anna")
    (anchor,) = room.anchors
    assert (anchor.target_id, anchor.accepted) == ("quad", True)
    assert 0.4 * DRIFT_RAD < room.yaw_rad < 1.1 * DRIFT_RAD
    room.drive("anna")
    assert len(room.anchors) == 1


@pytest.mark.parametrize("how", ["strips", "moves", "switched off", "somebody else", "was hers", "arm moves"])
def test_taking_a_robot_corrects_nothing_when_it_is_no_measure(how: str) -> None:
    lit = BARE.model_copy(update={"strips": (LIT,)})
    room = Room(lit if how == "strips" else BARE, anchor_at_robots=None if how != "switched off" else False)
    if how == "was hers":
        room.drive("anna")
        room.heard.clear()
    room.point(QUAD, 1.0)
    if how == "arm moves":
        room.point((QUAD[0], QUAD[1] + 2.0, 1.0), 0.2)
    room.drive("ben" if how == "somebody else" else "anna", speed_mps=1.0 if how == "moves" else 0.0)
    assert room.anchors == []


def test_a_robot_is_pointed_at_on_request() -> None:
    room = Room()
    room.point(QUAD, 0.2)
    assert not isinstance(room.core.point_anchor("quad", room.now_ns), Refusal)
    room.point(QUAD, 3.0)
    (anchor,) = room.anchors
    assert (anchor.target_id, anchor.accepted) == ("quad", True)
    assert room.yaw_rad > 0.4 * DRIFT_RAD


def test_anchoring_chooses_a_lamp_or_a_standing_robot_without_lamps() -> None:
    for lamps, expected in (((), "quad"), ((Lamp(id="led", position_m=(0.0, 2.0, 1.0)),), "led")):
        room = Room(BARE.model_copy(update={"lamps": lamps}))
        room.point(QUAD, 0.2)
        answer = room.core.point_anchor("", room.now_ns)
        assert not isinstance(answer, Refusal)
        assert answer.message == f"point at {expected}"


def test_a_robot_that_moves_or_is_gone_is_refused() -> None:
    room = Room()
    room.point(QUAD, 0.2, speed_mps=1.0)
    refused = room.core.point_anchor("quad", room.now_ns)
    assert isinstance(refused, Refusal)
    assert "robot quad moves; let it stand" in refused.reason

    refused = room.core.point_anchor("quad", room.now_ns + 5 * NS_PER_S)
    assert isinstance(refused, Refusal)
    assert "robot quad is not tracked now" in refused.reason

    room = Room(hold_s=2.0)
    room.point(QUAD, 0.2)
    room.core.point_anchor("quad", room.now_ns)
    room.point(QUAD, 4.0, speed_mps=0.09)
    ends = [each for each in room.heard if isinstance(each, Localization)]
    assert ends[-1].phase == "refused"
    assert "robot quad moved by" in ends[-1].reason


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
def test_anchor_is_requested_whatever_certainty_a_tracker_states(covariance: Covariance) -> None:
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


A, B, C = LAMPS
AT_ORIGIN = Lamp(id="zero", position_m=(0.0, 0.0, 0.1))


def at(lamp: Lamp, x_m: float = 0.0, z_m: float = 0.0, name: str = "") -> Lamp:
    x, y, z = lamp.position_m
    return Lamp(id=name or f"{lamp.id}2", position_m=(x + x_m, y, z + z_m))


def room(*lamps: Lamp) -> Environment:
    return Environment(stamp_ns=0, name="lab", lamps=lamps)


NEEDS = "needs two at different places"


@pytest.mark.parametrize(
    ("lamps", "choice", "sentence"),
    [
        ((A, B), config(), ""),
        ((A,), config(), NEEDS),
        (tuple(at(A, 1e-6 * n, name=f"led_{n}") for n in range(5)), config(order="informative"), NEEDS),
        ((A, at(A, 0.04)), config(order="informative"), NEEDS),
        ((A, at(A, 0.06)), config(order="informative"), ""),
        ((AT_ORIGIN, at(AT_ORIGIN, SAME_PLACE_M)), config(), ""),  # exactly at the limit
        ((A, at(A), B), config(targets=2), NEEDS),
        ((A, at(A), B), config(), ""),
        ((A, at(A), B), config(order="informative", targets=2), ""),
        ((A, at(A, 0.04, 1.0)), config(order="informative"), "above one another"),
        ((A, at(A, 0.0, 1.0), B), config(targets=2), "above one another"),
    ],
)
def test_lamps_that_can_tell_no_pose_are_refused_at_once(
    lamps: tuple[Lamp, ...], choice: LocalizerConfig, sentence: str
) -> None:
    result = lamps_for_pose(room(*lamps), choice)
    if sentence:
        assert isinstance(result, Refusal)
        assert sentence in result.reason
        assert "; " not in result.reason or result.reason.count(";") == 1
    else:
        assert result == list(lamps)


def test_configured_lamps_come_in_their_order() -> None:
    assert lamps_for_pose(room(A, B, C), config(lamps=("c", "a"))) == [C, A]


def test_map_change_reason_names_lamps_that_left_or_moved() -> None:
    assert map_change_reason([A, B], room(B, A, C)) == ""
    assert map_change_reason([A, B], room(A, at(B, 0.04, name="b"))) == ""
    assert map_change_reason([A, B], room(A, at(B, 0.06, name="b"))) == "lamp b moved by 0.06 m"
    assert map_change_reason([A, B], room(B)) == "lamp a left"


def localizing(procedure: Literal["pose", "anchor"]) -> PoseManager:
    """Return one that points at a, or may."""
    config = LocalizerConfig(position_m=(0.5, 0.5, 0.0))
    locating = PoseManager("anna", config)
    locating.begin(START_NS)
    locating.on_map(room(A, B, C), START_NS)
    if procedure == "pose":
        answer = locating.start("static_targets", START_NS)
    else:
        answer = locating.point_anchor("a", START_NS)
    assert isinstance(answer, Response)
    return locating


@pytest.mark.parametrize("procedure", ["pose", "anchor"])
@pytest.mark.parametrize("lamps", [(B, C), (at(A, 0.5, name="a"), B, C), ()])
def test_a_map_that_changes_ends_it_with_a_sentence(
    procedure: Literal["pose", "anchor"], lamps: tuple[Lamp, ...]
) -> None:
    locating = localizing(procedure)
    (news,) = locating.on_map(room(*lamps), START_NS + NS_PER_S)
    assert not locating.procedures.is_busy
    assert isinstance(news, Localization)
    assert news.phase == "cancelled"
    assert news.reason.startswith("the map changed while anna was pointing at its lamps: lamp a ")
    assert news.reason.endswith("; start again")


def test_a_map_that_changes_elsewhere_is_taken() -> None:
    locating = localizing("pose")
    assert locating.on_map(room(A, B, C, at(C)), START_NS) == []
    assert locating.procedures.is_busy
    locating = localizing("anchor")
    assert locating.on_map(room(A), START_NS) == []
    assert locating.procedures.is_busy
