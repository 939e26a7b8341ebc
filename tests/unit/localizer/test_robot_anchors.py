"""Pointing at a robot whose place is known takes drift out, and never what a visible cursor steered."""

import math

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
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.pose_manager import PoseManager
from tests.unit.localizer.person import Person

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
        found = SetPose(
            position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, covariance=COVARIANCE, method="moving_target"
        )
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
            self.core.on_objects(TrackedObjects(stamp_ns=self.now_ns, objects=(quad,)), "robot.quad")
            self.heard += self.core.on_ray(self.person.ray(target, self.now_ns), self.now_ns)
            self.heard += self.core.step(self.now_ns)

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
def test_what_is_no_measure_corrects_nothing(how: str) -> None:
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


def test_without_lamps_a_robot_that_stands_is_chosen_and_with_lamps_a_lamp() -> None:
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
