"""Ways of robots near fences and people, and refusals."""

import math

import pytest

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Interaction, RobotState, UserPose
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import RobotReport
from pointit.services.robot.safety.people import PeopleNearRobot
from pointit.services.robot.safety.safety import Safety
from tests.support import there
from tests.unit.robot.flight import cursor_at
from tests.unit.robot.steered_robot import START_NS, Steered, fence

HALL = fence("keep_in", (-3, -3), (3, -3), (3, 3), (-3, 3), high_m=2.0)
DESK = fence("keep_out", (1, -1), (2, -1), (2, 1), (1, 1), (1, 0))
GROUND = RobotConfig(driver="sim", kind="ground", radius_m=0.2, aim_sigma_deg=0.0)


def steered(config: RobotConfig = GROUND, **people_m: Vec3) -> Steered:
    return Steered(config, (HALL, DESK), people_m or {"ada": (0.0, -8.0, 0.0)})


def cart(phase: str = "idle") -> RobotState:
    fields = {"phase": phase, "kind": "ground", "position_m": (-1.0, 2.0, 0.0), "yaw_rad": 0.0}
    rest = {"stamp_ns": START_NS, "velocity_mps": (0.0, 0.0, 0.0), "radius_m": 0.3}
    return RobotState.model_validate({**fields, **rest})


def after(robot: Steered, seconds: float, target_m: Vec3) -> Vec3:
    """Return where the robot is after a person has pointed at a place for a while."""
    robot.target_m = target_m
    robot.run(seconds)
    return robot.report.position_m


def test_cursor_beyond_a_fence_is_followed_along_the_fence() -> None:
    robot = steered()
    assert math.dist(after(robot, 8.0, (-6.0, -2.0, 0.0))[:2], (-2.7, -2.0)) < 0.07
    assert "keep_in" in robot.problem
    assert math.dist(after(robot, 8.0, (-6.0, 2.0, 0.0))[:2], (-2.7, 2.0)) < 0.07


def test_cursor_behind_a_volume_leads_to_its_edge_only() -> None:
    robot = steered()
    assert math.dist(after(robot, 8.0, (2.6, 0.0, 0.0))[:2], (0.7, 0.0)) < 0.07
    assert "keep_out" in robot.problem
    assert math.dist(after(robot, 12.0, (1.5, 2.0, 0.0))[:2], (1.5, 2.0)) < 0.1
    assert robot.problem == ""


def test_person_exactly_in_between_is_passed() -> None:
    config = GROUND.model_copy(update={"start_m": (0.0, -2.5, 0.0), "keep_out_m": 0.8})
    robot = steered(config, ada=(-1.0, 0.0, 0.0))
    assert math.dist(after(robot, 30.0, (-2.0, 2.5, 0.0))[:2], (-2.0, 2.5)) < 0.15


def test_robot_is_slow_near_people() -> None:
    config = GROUND.model_copy(update={"start_m": (-2.5, 2.5, 0.0), "max_speed_mps": 2.0})
    robot = steered(config, ada=(-2.5, -2.5, 0.0))
    speeds: dict[bool, float] = {True: 0.0, False: 0.0}

    def note() -> None:
        is_near = math.dist(robot.report.position_m[:2], (-2.5, -2.5)) < 1.0 + 0.2 + 1.0
        speeds[is_near] = max(speeds[is_near], robot.speed_mps)

    robot.on_step = note
    after(robot, 10.0, (-2.5, -2.0, 0.0))
    assert speeds[True] == pytest.approx(config.max_approach_mps, abs=0.1)
    assert speeds[False] > 1.0


def test_robot_behind_a_fence_can_only_come_back() -> None:
    config = GROUND.model_copy(update={"start_m": (-4.0, 0.0, 0.0)})
    robot = steered(config)
    assert after(robot, 4.0, (-6.0, 0.0, 0.0))[0] > -4.05
    assert math.dist(after(robot, 15.0, (0.0, 0.0, 0.0))[:2], (0.0, 0.0)) < 0.1


@pytest.mark.parametrize(
    ("points_m", "sentence"),
    [
        ([(-2.0, 1.0, 0.0)], ""),
        ([(0.0, 2.0, 0.0), (2.5, 2.0, 0.0)], ""),
        ([(2.5, 0.0, 0.0)], "the way to the place comes too near to fence keep_out-5: set way-points"),
        ([(1.5, 0.0, 0.0)], "the place is beyond fence keep_out-5: choose one on the robot's side of it"),
        ([(5.0, 0.0, 0.0), (0.0, 0.0, 0.0)], "way-point 1 is beyond fence keep_in-4: choose one"),
        ([(-2.0, -2.0, 0.0)], "the place is 1.3 m too near to bob: choose one farther away"),
        ([(-1.0, 2.0, 0.0)], "the place is 0.6 m too near to robot cart: choose one farther away"),
    ],
)
def test_goals_are_permitted_or_refused_in_one_sentence(points_m: list[Vec3], sentence: str) -> None:
    robot = steered(GROUND, ada=(0.0, -8.0, 0.0), bob=(-2.0, -2.0, 0.0))
    robot.safety.on_robot("cart", cart())
    robot.run(0.1)
    said = robot.safety.target_problem("ada", points_m, robot.now_ns, sigma_m=0.1)
    assert said.startswith(sentence)
    assert bool(said) == bool(sentence)


@pytest.mark.parametrize(
    ("phases", "age_s", "is_kept_clear_of"),
    [
        (["idle"], 0, True),
        (["idle", "lost"], 500, True),
        (["idle", "lost"], 700, False),
        (["lost"], 0, False),
    ],
)
def test_lost_robot_is_kept_clear_of_for_ten_minutes(
    phases: list[str], age_s: int, *, is_kept_clear_of: bool
) -> None:
    robot = steered()
    for phase in phases:
        robot.safety.on_robot("cart", cart(phase))
    robot.run(0.1)
    robot.now_ns += age_s * NS_PER_S
    robot.run(0.1)
    assert ("cart" in robot.safety.way_problem([(-1.0, 2.0, 0.0)])) == is_kept_clear_of


def test_goal_is_refused_if_unsure_or_without_a_pointing_person() -> None:
    robot = steered()
    robot.run(0.1)
    assert "sure to 0.7 m only" in robot.safety.target_problem("ada", [], robot.now_ns, sigma_m=0.7)
    robot.interact("idle")
    assert "not pointing" in robot.safety.target_problem("ada", [], robot.now_ns, sigma_m=0.1)


@pytest.mark.parametrize("kind", ["ground", "quadrotor"])
def test_ground_robot_stays_its_users_while_they_point_at_lamps(kind: str) -> None:
    robot = steered(GROUND.model_copy(update={"kind": kind}))
    robot.run(0.1)
    robot.interact("localizing")
    stop = there(robot.safety.stop("ada", "goals", robot.now_ns))
    assert stop.is_freeing == (kind == "quadrotor")
    assert robot.safety.take_problem("ada", robot.now_ns) == stop.text


def test_robot_stays_before_the_map_has_come() -> None:
    safety = Safety(GROUND, "quad")
    now_ns = START_NS
    safety.on_report(RobotReport(now_ns, (0.0, 0.0, 0.0), velocity_mps=(0.3, 0.0, 0.0)), now_ns)
    safety.people.on_pose("ada", UserPose(stamp_ns=now_ns, position_m=(0.0, -8.0, 0.0), yaw_rad=0.0))
    safety.people.on_interaction("ada", Interaction(stamp_ns=now_ns, state="pointing"))
    said = "the map of the room has not come yet"
    assert safety.take_problem("ada", now_ns).startswith(said)
    assert safety.way_problem([(1.0, 0.0, 0.0)]).startswith(said)
    assert there(safety.stop("", "none", now_ns)).text.startswith(said)
    safety.on_map(Environment(stamp_ns=now_ns, name="room"))
    assert not safety.take_problem("ada", now_ns)
    assert not safety.way_problem([(1.0, 0.0, 0.0)])
    assert safety.stop("", "none", now_ns) is None


def test_quadrotor_does_not_take_off_beside_a_person() -> None:
    config = RobotConfig(driver="sim", kind="quadrotor", radius_m=0.2)
    robot = steered(config, ada=(0.0, -0.8, 0.0))
    landed = RobotReport(robot.now_ns, (0.0, 0.0, 0.0))
    robot.safety.on_report(landed, robot.now_ns)
    said = robot.safety.take_problem("ada", robot.now_ns)
    assert said == (
        "quad would hover 0.4 m too near to ada: carry it away, or let ada step back and localize again: "
        "the known position does not follow them"
    )

    pose = UserPose(stamp_ns=robot.now_ns, position_m=(0.0, -0.8, 0.0), yaw_rad=0.0, method="static_targets")
    covariance = (0.09, 0.0, 0.0, 0.0, 0.04, *pose.covariance[5:])
    robot.safety.people.on_pose("ada", pose.model_copy(update={"covariance": covariance}))
    problem = robot.safety.take_problem("ada", robot.now_ns)
    assert "the known position (1 sigma 0.30 m) does not follow" in problem

    robot.safety.people.on_pose("ada", pose.model_copy(update={"method": "external"}))
    assert robot.safety.take_problem("ada", robot.now_ns).endswith("carry it away, or make room")
    robot.place("ada", (0.0, -2.0, 0.0))
    assert robot.safety.take_problem("ada", robot.now_ns) == ""


@pytest.mark.parametrize(
    ("cursor_s", "pointing_s", "text"),
    [
        (12.0, 0.1, "quad waits for ada's first cursor; if none comes, look at the wrist's battery and link"),
        (None, 0.1, "quad waits for ada's first cursor; if none comes, look at the wrist's battery and link"),
        (0.31, 5.0, "the last cursor of ada is 0.4 s old: look at the wrist's battery and link"),
        (-0.31, 5.0, "ada's arm is 0.4 s ahead of this machine: synchronize the two clocks"),
        (0.29, 5.0, None),
    ],
)
def test_cursor_from_before_a_localization_indicates_no_lost_wrist(
    cursor_s: float | None, pointing_s: float, text: str | None
) -> None:
    people = PeopleNearRobot(RobotConfig(cursor_timeout_s=0.3), "quad")
    now_ns = START_NS + 20 * NS_PER_S

    def state_ago(state: str, seconds: float) -> Interaction:
        stamp_ns = now_ns - round(seconds * NS_PER_S)
        return Interaction.model_validate({"stamp_ns": stamp_ns, "state": state, "next_step": "point"})

    people.on_pose("ada", UserPose(stamp_ns=now_ns, position_m=(0.0, -1.0, 0.0), yaw_rad=0.0))
    people.on_interaction("ada", state_ago("localizing", pointing_s + 5.0))
    people.on_interaction("ada", state_ago("pointing", pointing_s))
    people.on_interaction("ada", state_ago("pointing", 0.0))  # another sentence, not another beginning
    if cursor_s is not None:
        stamp_ns = now_ns - round(cursor_s * NS_PER_S)
        people.on_cursor("ada", cursor_at((0.0, 0.0, 0.0), stamp_ns))
    stop = people.cursor_stop_reason("ada", now_ns, follows=True)
    assert (stop and stop.text) == text


def test_robots_pass_over_low_volumes_and_under_high_ones() -> None:
    outline_m = ((1.0, -9.0), (2.0, -9.0), (2.0, 9.0), (1.0, 9.0))
    low = fence("keep_out", *outline_m, low_m=-1.0, high_m=1.0)
    high = fence("keep_out", *outline_m, low_m=1.0, high_m=3.0)
    for volume, kind, height_m in ((low, "quadrotor", 1.5), (high, "ground", 0.0)):
        config = RobotConfig.model_validate(
            {"driver": "sim", "kind": kind, "radius_m": 0.2, "aim_sigma_deg": 0.0, "hover_m": height_m or 0.2}
        )
        robot = Steered(config, (volume,))
        assert after(robot, 10.0, (3.0, 0.0, 0.0))[0] == pytest.approx(3.0, abs=0.1)
