"""Goals that a person requests, as by speech: the robot is taken and sent, with the checks of pointing."""

import pytest

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import UserPose
from tests.unit.goal.floor import START_NS
from tests.unit.goal.test_robot_steering import BEYOND, QUAD, THERE, Ben


def test_a_requested_robot_is_taken_and_sent_once_it_obeys() -> None:
    ben = Ben().point(THERE, 0.3)
    ben.outputs += ben.steps.send("rover", BEYOND, ben.now_ns)
    assert (ben.steering.robot, ben.goals) == ("rover", [])
    ben.point(THERE, 0.3)
    (goal,) = ben.goals
    assert (goal.robot, goal.via_m) == ("rover", ())
    assert goal.position_m == pytest.approx(BEYOND)
    ben.outputs += ben.steps.send("", THERE, ben.now_ns)  # it is theirs already
    assert [each.position_m for each in ben.goals] == [pytest.approx(BEYOND), pytest.approx(THERE)]


def test_a_person_who_comes_near_before_the_robot_obeys_keeps_it_where_it_is() -> None:
    ben = Ben().point(THERE, 0.3)
    ben.outputs += ben.steps.send("rover", BEYOND, ben.now_ns)
    ben.steps.on_pose("anna", UserPose(stamp_ns=START_NS, position_m=BEYOND, yaw_rad=0.0))
    ben.point(THERE, 0.3)
    assert ben.goals == []
    assert "from anna" in ben.text
    assert ben.steering.waypoints_m == (), "a press does not send it there either"


@pytest.mark.parametrize(
    ("robot", "place", "why"),
    [
        ("", BEYOND, "say which robot; there are quad, rover"),
        ("tank", BEYOND, "no robot 'tank'"),
        ("quad", BEYOND, "it follows where you point"),
        ("rover", QUAD, "quad stands there"),
        ("rover", (0.1, 0.0, 0.0), "from you"),
    ],
)
def test_a_request_is_refused_for_the_reasons_of_pointing(robot: str, place: Vec3, why: str) -> None:
    ben = Ben().point(THERE, 0.3)
    with pytest.raises(RefusedError, match=why):
        ben.steps.send(robot, place, ben.now_ns)
    assert (ben.goals, ben.steering.robot) == ([], "")


def test_a_robot_of_another_person_is_not_sent() -> None:
    ben = Ben().set("rover", user="anna").point(THERE, 0.3)
    with pytest.raises(RefusedError, match="rover is steered by anna"):
        ben.steps.send("rover", BEYOND, ben.now_ns)
