"""Random courses of robots: no fence is crossed and no person approached, whatever happens."""

import asyncio
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.geometry.floor_area import FloorArea
from pointit.geometry.vector import Vec3
from pointit.schemas import RobotKind, Steering
from pointit.schemas.environment import Fence
from pointit.schemas.topics import MAP
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import RobotReport
from tests.unit.robot.flight import CURSOR_S, ROBOT, ROOM, Pilotage, flown
from tests.unit.robot.steered_robot import TICK, Steered

Event = Literal["point", "nothing", "no cursor", "no report", "nan", "jump", "rest", "unsure", "far"]
DISTURBANCES: tuple[Event, ...] = (
    "nothing", "no cursor", "no report", "nan", "jump", "rest", "unsure", "far",
)  # fmt: skip
EVENTS = 6


def star(rng: random.Random, center_m: tuple[float, float], least_m: float, most_m: float) -> FloorArea:
    """Return a polygon around a point, often with corners that point inwards."""
    count = rng.randint(3, 7)
    corners: list[tuple[float, float]] = []
    for index in range(count):
        angle, radius_m = math.tau * index / count, rng.uniform(least_m, most_m)
        corners.append((center_m[0] + radius_m * math.cos(angle), center_m[1] + radius_m * math.sin(angle)))
    return FloorArea(corners)


def random_fences(rng: random.Random) -> tuple[Fence, ...]:
    """Return a fence around the robot's start at the origin, and some volumes beside it."""
    inside = star(rng, (0.0, 0.0), 1.5, 5.0)
    fences = [Fence(id="hall", kind="keep_in", outline_m=inside.corners_m, high_m=2.5)]
    for index in range(rng.randint(0, 3)):
        angle, range_m = rng.uniform(0.0, math.tau), rng.uniform(1.6, 3.5)
        outside = star(rng, (range_m * math.cos(angle), range_m * math.sin(angle)), 0.2, 0.9)
        high_m = rng.choice((None, 1.0))
        fences.append(
            Fence(id=f"v{index}", kind="keep_out", outline_m=outside.corners_m, low_m=-1.0, high_m=high_m)
        )
    return tuple(fences)


def fence_gap_m(fence: Fence, place_m: Vec3, radius_m: float) -> float:
    """Return the distance of a robot's hull from the forbidden side of a fence, negative beyond it."""
    apart_m = FloorArea(fence.outline_m).signed_distance_m(place_m[:2])
    high_m = math.inf if fence.high_m is None else fence.high_m
    if fence.kind == "keep_in":
        return min(-apart_m, high_m - place_m[2]) - radius_m
    return max(apart_m, place_m[2] - high_m) - radius_m


def broken_report(event: Event, report: RobotReport) -> RobotReport:
    match event:
        case "nan":
            return replace(report, position_m=(math.nan, 0.0, 0.0))
        case "jump":
            return replace(report, position_m=(report.position_m[0] + 5.0, *report.position_m[1:]))
        case _:
            return report


@dataclass(frozen=True)
class Course:
    """A room, and what happens in it."""

    config: RobotConfig
    fences: tuple[Fence, ...]
    people_m: dict[str, Vec3]
    person_sigma_m: float
    events: list[tuple[Event, Vec3, float]]
    tick: int = TICK
    """Steps between two checks."""

    @property
    def keep_m(self) -> float:
        return self.config.keep_out_m + self.config.radius_m + 2.0 * self.person_sigma_m


def random_course(kind: RobotKind, seed: int) -> Course:
    """Return a course: numbers drawn by Hypothesis itself are mostly 0 and robots would hardly move."""
    rng = random.Random(seed)
    config = RobotConfig(
        driver="sim",
        kind=kind,
        radius_m=0.2,
        keep_out_m=0.8,
        aim_sigma_deg=0.0,
        max_speed_mps=rng.choice((0.5, 1.0, 2.0, 3.0)),
        max_acceleration_mps2=rng.choice((0.8, 2.0)),
    )
    people_m: dict[str, Vec3] = {"ada": (0.0, -2.5, 0.0)}
    angle, range_m = rng.uniform(0.0, math.tau), rng.uniform(1.8, 4.0)
    people_m["bob"] = (range_m * math.cos(angle), range_m * math.sin(angle), 0.0)
    events: list[tuple[Event, Vec3, float]] = []
    for _ in range(EVENTS):
        target_m = (rng.uniform(-5.0, 5.0), rng.uniform(-5.0, 5.0), rng.choice((0.0, rng.uniform(0.0, 3.0))))
        event: Event = rng.choice(DISTURBANCES) if rng.random() < 0.3 else "point"
        events.append((event, target_m, rng.uniform(0.3, 2.5)))
    return Course(config, random_fences(rng), people_m, rng.choice((0.0, 0.1, 0.3)), events)


def corner_course(seed: int) -> Course:
    """Return a course of a ground robot that turns beside a box while people point behind it."""
    rng = random.Random(seed)
    config = RobotConfig(
        driver="sim",
        kind="ground",
        start_yaw_deg=rng.uniform(0.0, 360.0),
        radius_m=rng.choice((0.2, 0.25, 0.3)),
        aim_sigma_deg=0.0,
        max_speed_mps=rng.choice((1.0, 1.5, 2.0)),
        max_acceleration_mps2=rng.choice((1.0, 2.0, 4.0)),
    )
    x_m, wide_m = rng.uniform(0.35, 0.8), rng.uniform(0.3, 0.8)
    y_m, end_m = rng.uniform(-1.2, 0.3), rng.uniform(0.4, 1.5)
    outline_m = ((x_m, y_m), (x_m + wide_m, y_m), (x_m + wide_m, end_m), (x_m, end_m))
    box = Fence(id="box", kind="keep_out", outline_m=outline_m)
    events: list[tuple[Event, Vec3, float]] = []
    for _ in range(3):
        angle, range_m = rng.uniform(-math.pi / 2.0, math.pi / 2.0), rng.uniform(1.0, 6.0)
        target_m = (range_m * math.cos(angle), range_m * math.sin(angle), 0.0)
        events.append(("point", target_m, rng.uniform(0.5, 2.0)))
    return Course(config, (box,), {"ada": (20.0, 20.0, 0.0)}, 0.0, events, tick=2)


def check_course(course: Course) -> float:
    """Steer the robot through all that happens, check its place every 10 ms, and return its way, m."""
    steered = Steered(
        course.config, course.fences, course.people_m, person_sigma_m=course.person_sigma_m, tick=course.tick
    )
    event: Event = "point"
    places_m: list[Vec3] = []

    def check() -> None:
        place_m = steered.report.position_m
        places_m.append(place_m)
        for each in course.fences:
            assert fence_gap_m(each, place_m, course.config.radius_m) > 0.0, (each, place_m)
        for person_m in course.people_m.values():
            assert math.dist(place_m[:2], person_m[:2]) > course.keep_m, (person_m, place_m)

    steered.on_step = check
    steered.change_report = lambda report: broken_report(event, report)
    for event, target_m, seconds in course.events:
        steered.is_cursor_alive = event != "no cursor"
        steered.are_reports_alive = event != "no report"
        steered.target_m = None if event == "nothing" else (9e5, -9e5, 0.0) if event == "far" else target_m
        steered.interact("idle" if event == "rest" else "pointing", is_unsure=event == "unsure")
        steered.run(0.5 if event == "jump" else seconds)
    return sum(math.dist(start_m, end_m) for start_m, end_m in pairwise(places_m))


@settings(deadline=None, max_examples=8)
@given(st.integers(0, 2**32))
def test_a_quadrotor_crosses_no_fence_and_approaches_nobody(seed: int) -> None:
    check_course(random_course("quadrotor", seed))


@settings(deadline=None, max_examples=8)
@given(st.integers(0, 2**32))
def test_a_ground_robot_crosses_no_fence_and_approaches_nobody(seed: int) -> None:
    check_course(random_course("ground", seed))


@pytest.mark.slow
@pytest.mark.parametrize(
    "seeds",
    [
        # course 127 alone notices a turn whose directions are not checked
        pytest.param((*range(0, 200, 10), 127), id="21 courses"),
        pytest.param(range(200), id="200 courses", marks=pytest.mark.long),
    ],
)
def test_a_ground_robot_that_turns_beside_corners_crosses_none(seeds: Sequence[int]) -> None:
    way_m = [check_course(corner_course(seed)) for seed in seeds]
    assert sum(way_m) > len(way_m) * 0.5


@pytest.mark.parametrize(
    ("max_speed_mps", "max_acceleration_mps2", "start_yaw_deg"), [(1.0, 4.0, 180.0), (1.5, 2.0, 270.0)]
)
def test_a_robot_that_is_led_about_a_corner_neither_slides_over_it_nor_stops_and_goes_on_in_turns(
    max_speed_mps: float, max_acceleration_mps2: float, start_yaw_deg: float
) -> None:
    radius_m = 0.25
    box = Fence(id="box", kind="keep_out", outline_m=((4.0, 1.0), (4.6, 1.0), (4.6, 2.2), (4.0, 2.2)))
    gaps_m: list[float] = []
    config = RobotConfig(
        start_m=(3.6, 1.0, 0.0), start_yaw_deg=start_yaw_deg, radius_m=radius_m, max_speed_mps=max_speed_mps,
        max_acceleration_mps2=max_acceleration_mps2, max_cursor_sigma_m=5.0, keep_out_m=0.1,
    )  # fmt: skip

    @flown(config)
    async def lead(pilotage: Pilotage) -> None:
        pilotage.bench.put(MAP, ROOM.model_copy(update={"fences": (box,)}))
        pilotage.arrive("anna")
        pilotage.steer("anna", Steering(stamp_ns=0, robot=ROBOT, mode="follow"))
        for (x_m, y_m), (to_x_m, to_y_m) in pairwise(((3.6, 1.0), (8.0, 5.0), (0.5, 0.5))):
            steps = round(math.dist((x_m, y_m), (to_x_m, to_y_m)) / (1.5 * CURSOR_S))
            for step in range(steps):
                part = (step + 1) / steps
                pilotage.point("anna", (x_m + part * (to_x_m - x_m), y_m + part * (to_y_m - y_m), 0.0))
                await asyncio.sleep(CURSOR_S)
            await asyncio.sleep(1.0)
        gaps_m.extend(fence_gap_m(box, state.position_m, radius_m) for state in pilotage.states)
        phases = [state.phase for state in pilotage.states]
        assert sum(before != after for before, after in pairwise(phases)) <= 10

    lead()
    assert min(gaps_m) > 0.0


@pytest.mark.parametrize("kind", ["quadrotor", "ground"])
def test_the_robots_of_these_courses_do_move(kind: RobotKind) -> None:
    assert sum(check_course(random_course(kind, seed)) for seed in range(4)) > 4 * 0.5
