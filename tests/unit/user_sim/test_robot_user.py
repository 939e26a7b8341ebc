"""People who steer robots: what they point at and when they press, by what they see and hear."""

from typing import Any

import numpy as np
import pytest

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Feedback, RobotState
from pointit.schemas.selection import SIGNS, Cue
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.goal import REST, PersonGoal
from pointit.services.user_sim.perceived_objects import Sight
from pointit.services.user_sim.robot_user import GroundRobotUser, QuadrotorUser
from pointit.services.user_sim.selecting import DecisionTimes

SPOTS: tuple[Vec3, ...] = ((2.0, 1.0, 0.0), (3.0, 1.0, 0.0), (4.0, 1.0, 0.0))
PERIOD_NS = NS_PER_S // 50


class Carol:
    """Her eyes have no delay, and her thumb does what she decides."""

    def __init__(self, behaviour: type[QuadrotorUser] | type[GroundRobotUser], **settings: Any) -> None:
        config = UserSimConfig.model_validate(settings)
        self.mind = behaviour(SPOTS, DecisionTimes(config, 0.0, np.random.default_rng(1)))
        self.sight = Sight(0.0)
        self.now_ns = 0
        self.goal: PersonGoal = REST
        self.robots: dict[str, dict[str, Any]] = {
            "quad": {"kind": "quadrotor", "phase": "landed", "position_m": (1.0, 2.0, 0.0)},
            "rover": {"kind": "ground", "phase": "idle", "position_m": (2.0, 2.0, 0.0)},
        }

    def wait(self, lasting_s: float) -> "Carol":
        for _ in range(round(lasting_s * 50)):
            self.now_ns += PERIOD_NS
            for name, fields in self.robots.items():
                usual = {"yaw_rad": 0.0, "velocity_mps": (0.0, 0.0, 0.0), "radius_m": 0.2}
                self.sight.show(
                    self.now_ns, RobotState.model_validate(usual | fields | {"stamp_ns": self.now_ns}), name
                )
            self.sight.look(self.now_ns)
            self.goal = self.mind.goal(self.now_ns, self.sight)
        return self

    def hear(self, cue: Cue, text: str = "", sign_of: Cue | None = None) -> "Carol":
        sign = SIGNS[sign_of or cue]
        self.sight.show(
            self.now_ns, Feedback(stamp_ns=self.now_ns, cue=cue, text=text, chime=sign.chime), "carol"
        )
        return self.wait(0.02)

    def without(self, name: str) -> "Carol":
        del self.robots[name]
        return self


def test_she_points_at_a_robot_of_her_kind_holds_and_presses_once() -> None:
    carol = Carol(QuadrotorUser).wait(0.5)
    assert (carol.goal.point_m, carol.goal.closed_loop, carol.goal.presses) == ((1.0, 2.0, 0.0), False, 0)
    assert carol.wait(3.0).goal.presses == 1
    assert Carol(GroundRobotUser).wait(0.5).goal.point_m == (2.0, 2.0, 0.0)


def test_she_flies_it_over_the_spot_presses_and_after_the_landing_goes_on_to_the_next() -> None:
    carol = Carol(QuadrotorUser).wait(3.0).hear("selected").wait(1.0)
    assert (carol.goal.point_m, carol.goal.closed_loop, carol.goal.robot) == (SPOTS[0], True, "quad")
    assert carol.wait(10.0).goal.presses == 1
    carol.robots["quad"]["position_m"] = (2.05, 1.0, 0.2)
    assert carol.wait(1.0).goal.presses == 2
    carol.hear("selected").hear("selected", sign_of="localized").wait(0.5)
    assert carol.goal.point_m == (2.05, 1.0, 0.2)  # the quad, which she takes again
    carol.wait(3.0).hear("selected").wait(0.5)
    assert carol.goal.point_m == SPOTS[1]


def test_a_robot_that_refuses_is_left_alone_for_a_while_but_not_one_that_is_unclear() -> None:
    carol = Carol(QuadrotorUser).wait(3.0).hear("refused", "quad is steered by anna").wait(1.0)
    assert carol.goal == REST
    assert carol.wait(5.0).goal.point_m == (1.0, 2.0, 0.0)
    dora = (
        Carol(QuadrotorUser)
        .wait(3.0)
        .hear("refused", "two robots may be meant: point longer at one")
        .wait(1.0)
    )
    assert dora.goal.point_m == (1.0, 2.0, 0.0)
    assert dora.hear("selected").wait(0.1).goal.point_m == SPOTS[0]


def test_she_sets_two_way_points_sends_the_robot_and_then_the_next_two() -> None:
    carol = Carol(GroundRobotUser).wait(3.0).hear("selected").wait(1.0)
    assert (carol.goal.point_m, carol.goal.robot, carol.goal.closed_loop) == (SPOTS[0], "", True)
    assert carol.hear("selected").wait(1.0).goal.point_m == SPOTS[1]
    assert carol.goal.presses == 1
    assert carol.hear("selected").wait(1.5).goal.presses == 2
    carol.hear("selected").wait(5.0)
    assert (carol.goal.point_m, carol.goal.presses) == (SPOTS[1], 2)
    assert carol.hear("selected", sign_of="localized").wait(0.5).goal.point_m == SPOTS[2]


def test_who_has_pointed_at_a_lamp_while_they_steer_goes_on_steering() -> None:
    carol = Carol(GroundRobotUser)
    carol.now_ns = 60 * NS_PER_S
    carol.wait(3.0).hear("selected").wait(2.5)
    carol.hear("refused", "the place is sure to 0.6 m only: choose one nearer to you, or localize again")
    assert carol.goal.gesture == "double"
    carol.now_ns += 5 * NS_PER_S
    carol.wait(3.0).hear("refused", "rover has no way-point yet: stay at a place for 1 s, then press")
    assert carol.wait(0.1).goal.closed_loop


@pytest.mark.parametrize("waits", [False, True])
def test_after_a_turn_she_leaves_the_robot_to_others_the_longer_if_there_are_any(waits: bool) -> None:  # noqa: FBT001
    carol = Carol(GroundRobotUser).wait(3.0)
    if waits:
        carol.hear("refused", "rover is steered by anna").wait(8.0)
    carol.hear("selected")
    for _ in range(2):
        carol.wait(1.0).hear("selected").hear("selected").wait(1.5)
        carol.hear("selected", sign_of="localized")
    assert carol.goal.gesture == "hold"
    assert carol.wait(9.0).goal == REST
    assert (carol.wait(2.0).goal == REST) == waits
    assert carol.wait(50.0).goal != REST


def test_who_has_followed_a_waiting_quadrotor_past_everything_points_at_the_spot_anew() -> None:
    carol = Carol(QuadrotorUser).wait(3.0).hear("selected").wait(1.0)
    before = carol.goal
    assert carol.hear("refused", "quad: carol points past everything").wait(0.1).goal.key != before.key
    assert carol.goal.point_m == before.point_m


@pytest.mark.parametrize("behaviour", [QuadrotorUser, GroundRobotUser])
def test_a_lost_robot_or_a_pause_of_pointing_begins_anew(
    behaviour: type[QuadrotorUser] | type[GroundRobotUser],
) -> None:
    carol = Carol(behaviour).wait(3.0).hear("selected").wait(1.0).hear("deselected").wait(0.1)
    assert not carol.goal.closed_loop
    carol.wait(3.0).hear("selected").wait(1.0)
    assert carol.goal.closed_loop
    carol.now_ns += 5 * NS_PER_S
    assert not carol.wait(0.1).goal.closed_loop
    for name in ("quad", "rover"):
        carol.without(name)
    assert carol.wait(3.0).goal == REST
