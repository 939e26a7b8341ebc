"""Goals on request, and the robot that is meant."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import NS_PER_S, PointingRay, UserPose
from pointit.services.goal.robot_choice import Identification, IdentificationSettings, RobotIdentifier
from tests.unit.goal.floor import START_NS
from tests.unit.goal.floor import START_NS as BEGIN_NS
from tests.unit.goal.test_robot_steering import BEYOND, QUAD, THERE, Ben

LEFT: Vec3 = (2.0, 1.5, 1.0)
RIGHT: Vec3 = (2.0, -1.5, 0.2)
WALL: Vec3 = (-3.0, 0.0, 1.2)
RATE_HZ = 50.0
STEP_NS = round(NS_PER_S / RATE_HZ)
COVARIANCE = (0.02, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.005)


class Pointer:
    """A person who is 5 degrees off, and robots that report ten times a second."""

    def __init__(self, robots: dict[str, Vec3], *, at_m: Vec3 = (0, 0, 0), yaw_rad: float = 0) -> None:
        self.core = RobotIdentifier(IdentificationSettings(none_prior=0.2))  # who seldom points beside one
        self.robots = robots
        self._at_m = at_m
        self._yaw_rad = yaw_rad
        self.now_ns = BEGIN_NS
        self.core.on_pose(UserPose(stamp_ns=0, position_m=at_m, yaw_rad=yaw_rad, covariance=COVARIANCE))

    def at(self, place_m: Vec3, duration_s: float) -> Identification:
        eyes = vector.add(self._at_m, (0.0, 0.0, 1.64))
        away = vector.subtract(place_m, eyes)
        azimuth = vector.azimuth(away) - self._yaw_rad + math.radians(5.0)
        aim = vector.direction(azimuth, vector.elevation(away) - math.radians(3.0))
        for number in range(round(duration_s * RATE_HZ)):
            self.now_ns += STEP_NS
            self.core.on_ray(PointingRay(stamp_ns=self.now_ns, origin_m=(0.0, 0.0, 1.64), direction=aim))
            if number % 5 == 0:
                for robot, robot_m in self.robots.items():
                    self.core.on_robot(robot, self.now_ns, robot_m)
        return self.core.identify(self.now_ns)


def test_neither_of_two_adjacent_robots_is_chosen() -> None:
    near = {"a": LEFT, "b": vector.add(LEFT, (0.0, 0.25, 0.0))}
    assert Pointer(near).at(LEFT, 3.0).chosen == ""


def test_pointing_at_no_robot_chooses_none() -> None:
    found = Pointer({"left": LEFT, "right": RIGHT}).at(WALL, 3.0)
    assert found.chosen == ""
    assert found.none_probability > 0.99


def test_other_robot_is_chosen_soon_after_the_arm_has_turned() -> None:
    pointer = Pointer({"left": LEFT, "right": RIGHT})
    assert pointer.at(LEFT, 3.0).chosen == "left"
    assert pointer.at(RIGHT, 1.2).chosen == "right"


def test_no_robot_is_identified_without_pose_rays_or_recent_reports() -> None:
    pointer = Pointer({"left": LEFT})
    assert pointer.core.identify(BEGIN_NS) == Identification()
    assert pointer.at(LEFT, 1.0).chosen == "left"
    assert pointer.core.identify(pointer.now_ns + 2 * NS_PER_S) == Identification()
    pointer.core.on_pose(None)
    assert pointer.core.identify(pointer.now_ns) == Identification()
    pointer = Pointer({"left": LEFT})
    pointer.at(LEFT, 1.0)
    pointer.core.forget("left")
    assert pointer.core.identify(pointer.now_ns) == Identification()


def test_new_window_starts_when_a_clock_is_set_back() -> None:
    pointer = Pointer({"left": LEFT, "right": RIGHT})
    pointer.at(LEFT, 3.0)
    pointer.now_ns -= 60 * NS_PER_S
    assert pointer.at(RIGHT, 1.2).chosen == "right"


@given(
    shift=st.tuples(*[st.floats(-100.0, 100.0)] * 2),
    yaw_rad=st.floats(-math.pi, math.pi),
    covariance=st.lists(st.floats(-1e12, 1e12), min_size=9, max_size=9),
)
@settings(max_examples=25, deadline=None)
def test_identification_works_far_from_the_origin_and_with_invalid_covariances(
    shift: tuple[float, float], yaw_rad: float, covariance: list[float]
) -> None:
    moved = (*shift, 0.0)
    robots = {"left": vector.add(LEFT, moved), "right": vector.add(RIGHT, moved)}
    pointer = Pointer(robots, at_m=moved, yaw_rad=yaw_rad)
    here = Pointer({"left": LEFT, "right": RIGHT}).at(LEFT, 0.5)
    there = pointer.at(robots["left"], 0.5)
    assert there.none_probability == pytest.approx(here.none_probability, abs=1e-6)
    assert [each.object_id for each in there.candidates] == ["left", "right"]
    odd_pose = {"stamp_ns": 0, "position_m": moved, "yaw_rad": yaw_rad, "covariance": tuple(covariance)}
    pointer.core.on_pose(UserPose.model_validate(odd_pose))
    odd = pointer.core.identify(pointer.now_ns)
    assert sum(each.probability for each in odd.candidates) + odd.none_probability == pytest.approx(1.0)


def test_two_reports_at_nearly_the_same_time_are_no_error() -> None:
    pointer = Pointer({"left": LEFT})
    pointer.at(LEFT, 1.2)
    for number in range(40, -1, -1):
        stamp_ns = pointer.now_ns - number * STEP_NS // 2
        pointer.core.on_robot("right", stamp_ns - 1, RIGHT)
        pointer.core.on_robot("right", stamp_ns, (2.0, 1.0, 0.5))
    found = pointer.core.identify(pointer.now_ns)
    assert {each.object_id for each in found.candidates} == {"left", "right"}


def test_requested_robot_is_taken_and_sent_once_it_obeys() -> None:
    ben = Ben().point(THERE, 0.3)
    ben.outputs += ben.steps.send("rover", BEYOND, ben.now_ns)
    assert (ben.steering.robot, ben.goals) == ("rover", [])
    ben.point(THERE, 0.3)
    (goal,) = ben.goals
    assert (goal.robot, goal.via_m) == ("rover", ())
    assert goal.position_m == pytest.approx(BEYOND)
    ben.outputs += ben.steps.send("", THERE, ben.now_ns)  # it is theirs already
    assert [each.position_m for each in ben.goals] == [pytest.approx(BEYOND), pytest.approx(THERE)]


def test_requested_robot_is_not_sent_when_a_person_comes_near() -> None:
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
def test_request_is_refused_for_the_reasons_of_pointing(robot: str, place: Vec3, why: str) -> None:
    ben = Ben().point(THERE, 0.3)
    with pytest.raises(RefusedError, match=why):
        ben.steps.send(robot, place, ben.now_ns)
    assert (ben.goals, ben.steering.robot) == ([], "")
