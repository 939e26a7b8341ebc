"""A person takes a robot by pointing at it, steers it, and hears what it does; the robot decides."""

import math
from typing import Any, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Environment,
    Feedback,
    Goal,
    Interaction,
    PointingRay,
    RobotState,
    Steering,
    UserPose,
)
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.robot_steering import Output, RobotSteering
from tests.unit.goal.floor import EYES, POINTING, ROOM, START_NS, STEP_S, cursor

THERE: Vec3 = (1.5, 1.5, 0.0)
BEYOND: Vec3 = (-1.0, 2.0, 0.0)


QUAD: Vec3 = (2.0, 0.0, 0.0)
ROVER: Vec3 = (0.0, 2.0, 0.1)
STEP_NS = round(STEP_S * NS_PER_S)


class Ben:
    """He stands in the origin and steers; his robots report every 0.1 s."""

    def __init__(self, *, alone: str = "", **settings: Any) -> None:
        self.steps = RobotSteering(GoalConfig.model_validate({"steer": "robots"} | settings), "ben")
        self.now_ns = START_NS
        self.outputs: list[Output] = []
        self.robots: dict[str, dict[str, Any]] = {
            "quad": {"kind": "quadrotor", "phase": "landed", "position_m": QUAD},
            "rover": {"kind": "ground", "phase": "idle", "position_m": ROVER},
        }
        if alone:
            self.robots = {alone: self.robots[alone]}
        self.obeys = True
        """Robots accept who asks, unless somebody has them."""
        self.steps.on_map(ROOM)
        self.steps.on_pose("ben", UserPose(stamp_ns=START_NS, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
        self.outputs += self.steps.on_interaction(POINTING, self.now_ns)

    def set(self, robot: str, **fields: Any) -> "Ben":
        self.robots[robot] |= fields
        return self.report(robot)

    def report(self, robot: str) -> "Ben":
        usual = {"stamp_ns": self.now_ns, "yaw_rad": 0.0, "velocity_mps": (0.0, 0.0, 0.0), "radius_m": 0.2}
        state = RobotState.model_validate(usual | self.robots[robot])
        self.outputs += self.steps.on_robot(robot, state, self.now_ns)
        return self

    def point(self, at_m: Vec3, lasting_s: float = 1.5) -> "Ben":
        """Point at a place, or a robot, on the floor."""
        for step in range(round(lasting_s / STEP_S)):
            self.now_ns += STEP_NS
            direction = vector.normalized(vector.subtract(at_m, EYES))
            self.steps.on_ray(PointingRay(stamp_ns=self.now_ns, origin_m=EYES, direction=direction))
            self.outputs += self.steps.on_cursor(cursor(self.now_ns, at_m), self.now_ns)
            if step % 5 == 0:
                for robot, fields in self.robots.items():
                    if self.obeys and self.steps.robot == robot and not fields.get("user"):
                        fields["user"] = "ben"
                    self.report(robot)
        return self

    def press(self, ago_s: float = 0.0, source: str = "device") -> "Ben":
        stamp_ns = self.now_ns - round(ago_s * NS_PER_S)
        event = ButtonEvent(stamp_ns=stamp_ns, gesture="press", source=source)
        self.outputs += self.steps.on_button(event, self.now_ns)
        return self

    def wait(self, lasting_s: float) -> "Ben":
        """Let time pass without any message."""
        self.now_ns += round(lasting_s * NS_PER_S)
        self.outputs += self.steps.tick(self.now_ns)
        return self

    def start(self) -> "Ben":
        began = POINTING.model_copy(update={"stamp_ns": self.now_ns})
        self.outputs += self.steps.on_interaction(began, self.now_ns)
        return self

    def rest(self, state: Literal["idle", "localizing"] = "idle") -> "Ben":
        self.outputs += self.steps.on_interaction(Interaction(stamp_ns=self.now_ns, state=state), self.now_ns)
        return self

    def take(self, robot: str) -> "Ben":
        at_m: Vec3 = self.robots[robot]["position_m"]
        return self.point(at_m).press().point(at_m, 0.3)

    @property
    def steering(self) -> Steering:
        return [each for each in self.outputs if isinstance(each, Steering)][-1]

    @property
    def goals(self) -> list[Goal]:
        return [each for each in self.outputs if isinstance(each, Goal)]

    @property
    def cues(self) -> list[Feedback]:
        return [each for each in self.outputs if isinstance(each, Feedback)]

    @property
    def text(self) -> str:
        return self.cues[-1].text


def test_press_takes_the_pointed_robot_which_then_follows() -> None:
    ben = Ben().point(QUAD)
    assert (ben.steering.robot, ben.steering.candidates[0].object_id) == ("", "quad")
    assert ben.steering.candidates[0].probability > 0.9
    ben.press().point(QUAD, 0.3)
    assert (ben.steering.robot, ben.steering.mode, ben.steering.candidates) == ("quad", "follow", ())
    assert [cue.cue for cue in ben.cues] == ["selected"]
    assert ben.text == "quad is yours: it takes off and follows where you point; press to land it there"


def test_staying_takes_a_robot_when_configured() -> None:
    ben = Ben(take="dwell").point(ROVER, 0.8)
    assert ben.steering.robot == ""
    assert ben.point(ROVER, 2.0).steering.robot == "rover"
    assert Ben().point(ROVER, 4.0).steering.robot == ""


def test_stay_on_an_unclear_robot_asks_and_another_takes_it() -> None:
    ben = Ben(take="dwell", alone="quad")
    beside: Vec3 = (2.5, 0.0, 0.0)
    ben.point(beside, 2.0)
    assert (ben.steering.robot, ben.text) == ("", "quad may be meant: stay on it to take it")
    assert ben.point(beside, 0.8).steering.robot == "quad"
    left = Ben(take="dwell", alone="quad").point(beside, 2.0).point((-2.0, 1.0, 0.0), 3.0)
    assert left.point(beside, 1.0).steering.robot == ""  # the stay counts from its start


def test_adjacent_robots_need_longer_pointing_or_neither_is_taken() -> None:
    ben = Ben()
    ben.robots["rover"]["position_m"] = (2.0, 0.15, 0.1)
    ben.point((2.0, 0.07, 0.0)).press()
    assert ben.text in {
        f"two robots may be meant, {names}: point longer at one"
        for names in ("quad and rover", "rover and quad")
    }
    assert (ben.cues[-1].cue, ben.steering.robot) == ("refused", "")
    ben.robots["rover"]["position_m"] = (0.0, 2.0, 0.1)  # it drives away
    ben.point(QUAD, 2.5)
    assert ben.steering.robot == "quad"


def test_unclear_press_is_forgotten_after_three_seconds() -> None:
    ben = Ben()
    ben.robots["rover"]["position_m"] = (2.0, 0.15, 0.1)
    ben.point((2.0, 0.07, 0.0)).press().point((2.0, 0.07, 0.0), 3.2)
    ben.robots["rover"]["position_m"] = (0.0, 2.0, 0.1)
    assert ben.point(QUAD, 3.0).steering.robot == ""


def test_press_away_from_robots_takes_none() -> None:
    ben = Ben().point((-2.0, -1.0, 0.0), 2.0).press()
    assert (ben.steering.robot, ben.text) == ("", "no robot is where you point: point at one, then press")


def test_press_that_began_the_pointing_takes_nothing() -> None:
    ben = Ben().point(QUAD, 0.1)
    ben.press(ago_s=0.1)
    assert ben.cues == []


def test_robot_of_another_person_is_refused_at_once() -> None:
    ben = Ben().set("quad", user="anna").take("quad")
    assert ben.steering.robot == ""
    assert ben.text == "quad is steered by anna: wait until it is free, or point at another robot"


def test_robot_decides_on_its_user_when_two_request_it() -> None:
    ben = Ben()
    ben.obeys = False
    ben.point(QUAD).press()
    assert ben.steering.robot == "quad"
    ben.set("quad", user="anna")
    assert ben.steering.robot == ""
    assert "steered by anna" in ben.text
    assert "selected" not in [cue.cue for cue in ben.cues]


def test_robots_reason_is_its_answer_and_silence_ends_a_request() -> None:
    ben = Ben()
    ben.obeys = False
    ben.set("quad", reason="the battery is empty: charge it").point(QUAD).press().point(QUAD, 1.0)
    assert (ben.steering.robot, ben.text) == ("", "quad: the battery is empty: charge it")
    ben.set("quad", reason="").point(QUAD).press().point(QUAD, 3.5)
    assert (ben.steering.robot, ben.text) == ("", "quad does not answer: see that it runs, and take it again")


def test_press_lands_the_quadrotor_at_the_cursor_of_just_before() -> None:
    ben = Ben().take("quad").set("quad", phase="idle").point(THERE).point((1.6, 1.7, 0.0), 0.08).press()
    assert (ben.steering.robot, ben.steering.mode) == ("quad", "land")
    assert ben.steering.target_m == pytest.approx(THERE)  # the press moved the arm
    ben.set("quad", phase="landing").press()
    assert ben.steering.mode == "land"
    ben.set("quad", phase="landed", position_m=THERE, user="")
    assert (ben.steering.robot, ben.steering.mode, ben.text) == ("", "none", "quad has landed")
    assert ben.cues[-1].chime == "double"
    assert ben.steering.target_m is None


def test_long_headset_press_lands_the_quadrotor_at_the_earlier_cursor() -> None:
    ben = Ben().take("quad").set("quad", phase="idle").point(THERE)
    ben.point((THERE[0] + 0.3, THERE[1], 0.0), 1.5).press(ago_s=1.5, source="headset")
    assert ben.steering.mode == "land"
    assert ben.steering.target_m == pytest.approx(THERE)


def test_reason_that_the_robot_has_as_it_accepts_is_told_once_if_it_lasts() -> None:
    unsure = "the pointed place is sure to 0.8 m only: localize again"
    ben = Ben().set("quad", reason=unsure).take("quad").point(THERE, 1.0)
    assert ben.text.startswith("quad is yours")

    ben.point(THERE, 1.5)
    assert ben.text == f"quad: {unsure}"
    ben.point(THERE, 3.0)
    assert len(ben.cues) == 2

    passing = Ben().set("quad", reason=unsure).take("quad").set("quad", reason="").point(THERE, 4.0)
    assert passing.text.startswith("quad is yours")


def test_quadrotor_follows_on_after_a_refused_landing() -> None:
    ben = Ben().take("quad").set("quad", phase="idle").point(THERE).press()
    ben.set("quad", reason="a fence is there: point at another place")
    assert (ben.steering.mode, ben.text) == ("follow", "quad: a fence is there: point at another place")
    assert len(ben.cues) == 3
    ben.report("quad")
    assert len(ben.cues) == 3  # each reason once


def test_changing_reasons_are_reported_every_two_seconds() -> None:
    ben = Ben().take("quad").set("quad", phase="idle")
    for away_m in range(30):
        ben.set("quad", reason=f"the fence is {away_m / 10:.1f} m away").point(THERE, 0.1)
    assert [cue.cue for cue in ben.cues] == ["selected", "refused", "refused"]


def test_nothing_lands_near_a_person_or_on_a_wall() -> None:
    ben = Ben().take("quad").set("quad", phase="idle")
    ben.steps.on_pose("anna", UserPose(stamp_ns=START_NS, position_m=THERE, yaw_rad=0.0))
    ben.point(THERE).press()
    assert ben.steering.mode == "follow"
    assert "from anna" in ben.text
    ben.steps.on_map(Environment(stamp_ns=START_NS, name="void"))
    ben.point(BEYOND).press()
    assert ben.text == "no robot lands there: point at the floor as you press"


def test_stays_are_way_points_and_a_press_sends_the_path() -> None:
    ben = Ben().take("rover").point(ROVER, 2.0)
    assert ben.steering.waypoints_m == ()  # still at the robot
    ben.point(THERE).point(BEYOND)
    assert len(ben.steering.waypoints_m) == 2
    assert ben.text == "way-point 2: press to send rover, or stay at the next place"
    ben.press()
    (goal,) = ben.goals
    assert (goal.robot, goal.confirmed_by, goal.via_m) == ("rover", "press", (pytest.approx(THERE),))
    assert (goal.position_m, goal.yaw_rad) == (pytest.approx(BEYOND), pytest.approx(math.atan2(2.0, -1.0)))
    assert ben.steering.waypoints_m == ()
    ben.set("rover", phase="moving", goal_ns=goal.stamp_ns).point(BEYOND, 4.0)
    assert ben.text == "rover goes there"
    ben.set("rover", phase="idle", goal_ns=0, position_m=(-1.1, 2.0, 0.1))
    assert (ben.text, ben.cues[-1].chime, ben.steering.robot) == ("rover has arrived", "double", "rover")


def test_missed_or_ignored_goal_is_reported() -> None:
    ben = Ben().take("rover").point(THERE).press()
    ben.set("rover", phase="moving", goal_ns=ben.goals[0].stamp_ns).set("rover", phase="idle", goal_ns=0)
    assert "before its goal: send it again" in ben.text
    ben.point(BEYOND).press().point(BEYOND, 3.5)
    assert ben.text == "rover has not taken the goal: set its way-points again"


def test_press_without_way_points_only_takes_another_pointed_robot() -> None:
    ben = Ben().take("rover").point((-2.0, -1.0, 0.0), 0.5).press()
    assert (ben.goals, ben.steering.robot) == ([], "rover")
    assert ben.text == "rover has no way-point yet: stay at a place for 1 s, then press"
    ben.point(QUAD, 3.0)
    assert ben.steering.waypoints_m == ()
    assert ben.text == "quad stands there: press to take it instead, or stay at another place"
    ben.press().point(QUAD, 0.3)
    assert (ben.goals, ben.steering.robot, ben.steering.mode) == ([], "quad", "follow")


def test_end_of_pointing_releases_the_robot() -> None:
    ben = Ben().take("rover").point(THERE)
    ben.rest()
    assert (ben.steering.robot, ben.steering.mode, ben.steering.waypoints_m) == ("", "none", ())
    assert ben.text == "rover is let go, as you stopped pointing: it stays where it is"
    ben.point(QUAD).press()
    assert ben.steering.robot == ""


def test_localizing_keeps_a_ground_robot_and_releases_a_quadrotor() -> None:
    ben = Ben().take("rover").point(THERE)
    before = len(ben.cues)
    ben.rest("localizing").set("rover", phase="stopped", reason="rover waits until ben is localized")
    assert (ben.steering.robot, ben.steering.waypoints_m) == ("rover", (THERE,))
    ben.start().report("rover")  # not heard yet of the pointing
    ben.set("rover", phase="idle", reason="").point(BEYOND)
    assert [cue.cue for cue in ben.cues[before:]] == ["selected"]
    assert ben.steering.waypoints_m == (THERE, BEYOND)
    assert Ben().take("quad").rest("localizing").steering.robot == ""


def test_uncertain_direction_is_reported_before_the_robots_answer() -> None:
    ben = Ben().set("rover", user="anna").point(ROVER)
    ben.steps.on_interaction(POINTING.model_copy(update={"is_unsure": True}), ben.now_ns)
    ben.press()
    assert ben.text == "your direction has become uncertain: press twice, then point at a lamp once"


def test_robot_that_frees_itself_or_falls_silent_is_lost() -> None:
    ben = Ben().take("rover")
    ben.set("rover", user="", phase="stopped", reason="anna stopped it")
    assert (ben.steering.robot, ben.text) == ("", "rover is no longer yours: anna stopped it")
    ben.set("rover", reason="").take("rover").wait(2.5)
    assert (ben.steering.robot, ben.cues[-1].cue) == ("", "deselected")
    assert ben.text == "rover is lost: it reports nothing; see that its process runs"
    ben.press()
    assert ben.steering.robot == ""


ACTS = st.lists(
    st.one_of(
        st.tuples(st.just("point"), st.sampled_from([QUAD, ROVER, THERE, BEYOND, (0.2, 0.1, 0.0)])),
        st.tuples(st.sampled_from(["press", "rest", "start", "wait"]), st.none()),
        st.tuples(
            st.just("state"),
            st.tuples(
                st.sampled_from(["quad", "rover"]),
                st.sampled_from(["", "ben", "anna"]),
                st.sampled_from(["landed", "idle", "moving", "stopped", "lost"]),
                st.sampled_from(["", "it is stuck"]),
            ),
        ),
    ),
    max_size=14,
)


@settings(max_examples=25, deadline=None)
@given(ACTS)
def test_steering_agrees_with_the_taken_robot_for_any_actions(acts: list[tuple[str, Any]]) -> None:
    ben = Ben()
    for act, what in acts:
        before = len(ben.goals)
        match act:
            case "point":
                ben.point(what, 1.2)
            case "press" | "rest" | "start":
                getattr(ben, act)()
            case "state":
                robot, user, phase, reason = what
                ben.set(robot, user=user, phase=phase, reason=reason)
            case _:
                ben.wait(2.5)
        steering = ben.steering
        assert steering.robot == ben.steps.robot
        assert (steering.mode == "none") == (steering.robot == "")
        assert (steering.target_m is not None) == (steering.mode == "land")
        assert not steering.waypoints_m or steering.mode == "goals"
        for goal in ben.goals[before:]:
            assert act == "press"
            assert goal.robot == "rover" == steering.robot
            assert ben.robots["rover"]["user"] == "ben"
    for cue in ben.cues:
        assert cue.text
        assert not cue.text.endswith(".")


def test_press_beside_a_lone_robot_asks_and_another_takes_it() -> None:
    for behind_m in (0.5, 1.0, 1.5):
        assert Ben(alone="quad").point((2.0 + behind_m, 0.0, 0.0)).press().steering.robot == "", behind_m
    ben = Ben(alone="quad").point((2.5, 0.0, 0.0)).press()
    assert ben.text == "quad may be meant: press again to take it"
    ben.point((2.5, 0.0, 0.0), 4.0).press()
    assert ben.steering.robot == ""  # that press came too late, and asks again
    assert ben.point((2.5, 0.0, 0.0), 1.0).press().steering.robot == "quad"
