"""Robots of a run: landings, goals and fences are counted from their states alone."""

from typing import Any

from pointit.geometry.vector import Vec3
from pointit.launch.robots import RobotsScore, goal_lines, score_lines
from pointit.schemas import Environment, Goal, RobotState
from pointit.schemas.environment import Fence

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
RACK = ((3.0, 3.0), (4.0, 3.0), (4.0, 4.0), (3.0, 4.0))
ROOM = Environment(
    stamp_ns=0,
    name="arena",
    fences=(
        Fence(id="area", kind="keep_in", outline_m=SQUARE, high_m=2.0),
        Fence(id="rack", kind="keep_out", outline_m=RACK),
    ),
)


def state(position_m: Vec3, phase: Any = "moving", **fields: Any) -> RobotState:
    usual: dict[str, Any] = {
        "stamp_ns": 0,
        "kind": "quadrotor",
        "yaw_rad": 0.0,
        "velocity_mps": (0.0, 0.0, 0.0),
        "radius_m": 0.2,
    }
    return RobotState(phase=phase, position_m=position_m, **(usual | fields))


def test_a_landing_counts_with_its_distance_from_the_nearest_spot() -> None:
    score = RobotsScore([(1.0, 1.0, 0.0), (3.0, 1.0, 0.0)])
    score.on_state("quad", state((1.0, 1.0, 0.2)))
    score.on_state("quad", state((1.0, 1.1, 0.1), "landing", target_m=(1.0, 1.2, 0.0)))
    score.on_state("quad", state((1.0, 1.1, 0.0), "landed"))
    score.on_state("quad", state((1.0, 1.1, 0.0), "landed"))
    assert score.as_dict()["quad"]["landed_off_m"] == [0.1]
    assert score_lines(score.as_dict()) == ["quad landed once, 0.10 m from the place."]


def test_a_goal_is_reached_where_the_robot_ends_near_it() -> None:
    score = RobotsScore()
    for goal_ns, end_m in ((5, 2.0), (7, 1.0)):
        score.on_state("rover", state((0.5, 0.5, 0.0), "idle"))
        score.on_goal(sent(goal_ns=goal_ns))
        score.on_state("rover", state((0.6, 0.5, 0.0), goal_ns=goal_ns))
        score.on_state("rover", state((end_m, 0.5, 0.0), "idle"))
    assert score_lines(score.as_dict()) == ["rover reached 1 of 2 goals."]


def sent(robot: str = "rover", goal_ns: int = 5, x_m: float = 2.0) -> Goal:
    return Goal(
        stamp_ns=goal_ns,
        position_m=(x_m, 0.5, 0.0),
        robot=robot,
        yaw_rad=0.0,
        age_s=0.0,
        position_sigma_m=0.1,
        clearance_m=2.0,
        proposed_ns=goal_ns,
        confirmed_by="press",
    )


def test_summary_has_the_person_and_the_distance_of_each_landing_and_goal() -> None:
    score = RobotsScore([(1.0, 1.0, 0.0)])
    for user, y in (("anna", 1.1), ("anna", 1.05), ("ben", 1.2)):
        score.on_state("quad", state((1.0, y, 0.2), user=user))
        score.on_state("quad", state((1.0, y, 0.1), "landing", user=user))
        score.on_state("quad", state((1.0, y, 0.0), "landed"))  # it is free then
    score.on_state("rover", state((0.5, 0.5, 0.0), "idle"))
    for goal_ns, end_m in ((5, 2.0), (7, 1.9)):
        score.on_goal(sent(goal_ns=goal_ns), "ben")
        score.on_state("rover", state((0.6, 0.5, 0.0), goal_ns=goal_ns))
        score.on_state("rover", state((end_m, 0.5, 0.0), "idle"))
    anna, ben = "landed 2 times for anna, 0.10 and 0.05 m", "landed once for ben, 0.20 m"
    assert score_lines(score.as_dict()) == [
        f"quad {anna} from the place; {ben} from the place.",
        "rover reached 2 of 2 goals of ben, 0.00 and 0.10 m from them.",
    ]
    assert score.as_dict()["quad"]["people"]["anna"]["landed_off_m"] == [0.1, 0.05]
    assert score.goals_without_robot == {}


def test_goals_that_no_robot_takes_are_in_the_summary_with_their_person() -> None:
    score = RobotsScore()
    score.on_goal(sent("", x_m=1.0), "anna")
    score.on_goal(sent("", x_m=2.0), "anna")
    assert goal_lines(score.goals_without_robot) == [
        "anna sent a robot 2 times, last to 2.00, 0.50 m (1 sigma 0.10 m at most); none drives here."
    ]
    score.on_state("rover", state((0.5, 0.5, 0.0), "idle"))
    assert score.goals_without_robot == {}


def test_each_crossing_of_a_fence_counts_once() -> None:
    score = RobotsScore()
    score.on_map(ROOM)
    for place_m in ((1.0, 1.0, 0.2), (3.5, 3.5, 0.2), (3.6, 3.5, 0.2), (1.0, 1.0, 0.2), (1.0, 1.0, 2.1)):
        score.on_state("quad", state(place_m))
    assert score.as_dict()["quad"]["fences_crossed"] == 2
    assert score_lines(score.as_dict()) == ["quad crossed fences 2 times."]
