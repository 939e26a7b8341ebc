"""Set-points of a drone that lags behind them."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.robot.set_point_sender import MAX_LEAD_M, SetPoint, SetPoints
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.plugins import Command, Follow, FollowPath, Land, Stop, TakeOff
from tests.unit.ros2.robot.test_driver import QUAD

SPEC = dataclasses.replace(QUAD, radius_m=0.1, max_acceleration_mps2=2.0)
STEP_S = 0.05
LAG_S = 0.2
FLOOR = (0.0, 0.0, 0.0)


class Drone:
    """Goes to set-points with a lag, but not through the floor."""

    def __init__(self, at_m: Vec3 = FLOOR) -> None:
        self.points = SetPoints(SPEC, 0.0)
        self.at_m = at_m
        self.sent: list[SetPoint | None] = []
        self.news: list[object] = []
        self.points.on_pose(at_m, 0.0)

    def told(self, command: Command) -> object:
        return self.points.command(command)

    def fly(self, duration_s: float, *, is_stuck: bool = False, is_fresh: bool = True) -> None:
        for _ in range(round(duration_s / STEP_S)):
            point, done = self.points.step(STEP_S, is_fresh=is_fresh)
            self.sent.append(point)
            self.news += [done] if done else []
            before_m = self.at_m
            if point is not None and not is_stuck:
                share = 1.0 - math.exp(-STEP_S / LAG_S)
                left = vector.subtract(point.position_m, self.at_m)
                x, y, z = vector.add(self.at_m, vector.scale(left, share))
                self.at_m = (x, y, max(z, 0.0))
            velocity_mps = vector.scale(vector.subtract(self.at_m, before_m), 1.0 / STEP_S)
            if is_fresh:
                self.points.on_pose(self.at_m, 0.0, velocity_mps)

    def hovering(self) -> "Drone":
        assert self.told(TakeOff(1, 1.0)) == ("active", "")
        self.fly(6.0)
        assert self.news == ["done"]
        self.news.clear()
        self.sent.clear()
        return self


def far_m(a: Vec3, b: Vec3) -> float:
    return vector.norm(vector.subtract(a, b))


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (Stop(0), ("done", "")),
        (Follow(1, (1.0, 0.0, 1.0)), ("refused", "it is on the ground: take off first")),
        (FollowPath(1, ((1.0, 0.0, 1.0),)), ("refused", "it is on the ground: take off first")),
    ],
)
def test_drone_on_the_ground_has_to_take_off_first(command: Command, answer: tuple[str, str]) -> None:
    drone = Drone()
    assert drone.told(command) == answer
    drone.fly(1.0)
    assert not any(drone.sent)


def test_set_points_have_the_final_yaw_and_end_with_landing() -> None:
    drone = Drone().hovering()
    drone.told(FollowPath(2, ((2.0, 0.0, 1.0), (2.0, 1.0, 1.5)), yaw_rad=1.0))
    drone.fly(8.0)
    last = drone.sent[-1]
    assert last is not None
    assert last.yaw_rad == 1.0
    drone.told(Land(3, (1.0, 0.0, 0.0)))
    drone.fly(12.0)
    assert drone.sent[-1] is None


def test_a_stop_brakes_and_holds() -> None:
    drone = Drone().hovering()
    drone.told(Follow(2, (9.0, 0.0, 1.0)))
    drone.fly(2.0)
    at_m = drone.at_m
    drone.told(Stop(3))
    drone.fly(3.0)
    assert 0.0 <= drone.at_m[0] - at_m[0] < 0.5  # 1 m/s, 2 m/s², and the lag
    held = drone.sent[-1]
    assert held is not None
    assert far_m(held.position_m, drone.at_m) < 0.01


def test_set_point_waits_for_a_stuck_drone_or_missing_pose() -> None:
    drone = Drone().hovering()
    at_m = drone.at_m
    drone.told(Follow(2, (9.0, 0.0, 1.0)))
    drone.fly(5.0, is_stuck=True)
    stuck = drone.sent[-1]
    assert stuck is not None
    assert far_m(stuck.position_m, at_m) <= MAX_LEAD_M + 0.5 + 1e-9
    drone.fly(2.0, is_stuck=True, is_fresh=False)
    assert drone.sent[-1] == stuck


METRES = st.floats(-20.0, 20.0)
PLACES = st.tuples(METRES, METRES, st.floats(0.3, 5.0))


@given(st.lists(st.tuples(PLACES, st.floats(0.05, 3.0)), max_size=8), st.floats(0.1, 2.0))
def test_the_set_point_never_moves_faster_than_allowed(
    wishes: list[tuple[Vec3, float]], limit_mps: float
) -> None:
    drone = Drone().hovering()
    for count, (place_m, duration_s) in enumerate(wishes):
        drone.told(Follow(2 + count, place_m, max_speed_mps=limit_mps))
        drone.fly(duration_s)
    places_m = [each.position_m for each in drone.sent if each is not None]
    for before_m, after_m in itertools.pairwise(places_m):
        assert far_m(before_m, after_m) <= min(limit_mps, SPEC.max_speed_mps) * STEP_S + 1e-9
