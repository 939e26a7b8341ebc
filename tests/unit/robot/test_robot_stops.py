"""Distances and times until robots stop, and courses among fences and people."""

import asyncio
import math
import random
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import pytest

from pointit.geometry.floor_area import FloorArea
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Interaction, RobotKind, RobotState, Steering, StopRobot
from pointit.schemas.environment import Fence
from pointit.schemas.topics import CURSOR, INTERACTION, MAP, ROBOT_STATE, SERVICE_ALIVE, STOP_ROBOT
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import LinkLost, ReportItem, RobotReport, Stop
from tests.unit.robot.flight import CURSOR_S, FLOOR, ROBOT, ROOM, FaultyDriver, Pilotage, cursor_at, flown
from tests.unit.robot.steered_robot import TICK, Steered

GUIDE = Path(__file__).parents[3] / "docs/how-to/robot-safety.md"
CONFIG = RobotConfig(kind="quadrotor", aim_sigma_deg=0.5)
FOLLOW = Steering(stamp_ns=0, robot=ROBOT, mode="follow")
FAR = (5.0, 3.0, 0.0)
STEP_S = 0.01
BRAKING_S = 1.25
"""From full speed, 1 m/s, with 1 m/s² and the jerk of the simulated quadrotor."""

Cause = Callable[[Pilotage, FaultyDriver], Coroutine[None, None, None]]


async def stop_request(pilotage: Pilotage, _driver: FaultyDriver) -> None:
    assert ROBOT in (await pilotage.bench.bus.call(STOP_ROBOT, StopRobot(), ROBOT)).message


async def let_go(pilotage: Pilotage, _driver: FaultyDriver) -> None:
    pilotage.steer("anna", Steering(stamp_ns=0))


def interacting(**fields: object) -> Cause:
    async def interact(pilotage: Pilotage, _driver: FaultyDriver) -> None:
        now = Interaction.model_validate({"stamp_ns": pilotage.bench.clock.now_ns(), **fields})
        pilotage.bench.put(INTERACTION, now, "anna")

    return interact


def standing(**changes: object) -> Cause:
    async def stand(pilotage: Pilotage, _driver: FaultyDriver) -> None:
        pilotage.pose("anna", (-3.0, 0.0, 0.0), **changes)

    return stand


async def end_of_supervisor(pilotage: Pilotage, _driver: FaultyDriver) -> None:
    supervisor = pilotage.bench.bus.announce(SERVICE_ALIVE, "supervisor.anna")
    await asyncio.sleep(0.0)
    supervisor.close()


async def end_of_services(pilotage: Pilotage, _driver: FaultyDriver) -> None:
    pilotage.leave("anna")


async def silent_arm(pilotage: Pilotage, _driver: FaultyDriver) -> None:
    pilotage.point("anna", None)


async def pointing_past(pilotage: Pilotage, _driver: FaultyDriver) -> None:
    pilotage.point("anna", None)
    for _ in range(20):
        now_ns = pilotage.bench.clock.now_ns()
        nowhere = cursor_at(FAR, now_ns).model_copy(update={"point_m": None})
        pilotage.bench.put(CURSOR, nowhere, "anna")
        await asyncio.sleep(STEP_S)


async def no_reports(_pilotage: Pilotage, driver: FaultyDriver) -> None:
    driver.change = lambda _item: ()


async def lost_link(_pilotage: Pilotage, driver: FaultyDriver) -> None:
    driver.change = lambda _item: ()
    driver.say(LinkLost("the robot is switched off: switch it on"))
    await asyncio.sleep(2.0)
    driver.change = lambda item: (item,)


def moving(by_m: float) -> Cause:
    async def move(_pilotage: Pilotage, driver: FaultyDriver) -> None:
        driver.change = lambda item: (moved(item, by_m),)

    return move


async def person_ahead(pilotage: Pilotage, driver: FaultyDriver) -> None:
    pilotage.pose("bob", beside(driver, 1.6, 0.9))


async def robot_ahead(pilotage: Pilotage, driver: FaultyDriver) -> None:
    x, y, _ = beside(driver, 0.9, 0.5)
    other = RobotState(
        stamp_ns=pilotage.bench.clock.now_ns(), kind="ground", phase="idle", position_m=(x, y, 0.2),
        yaw_rad=0.0, velocity_mps=(0.0, 0.0, 0.0), radius_m=0.3,
    )  # fmt: skip
    pilotage.bench.put(ROBOT_STATE, other, "cart")


async def fence_ahead(pilotage: Pilotage, driver: FaultyDriver) -> None:
    x, y, _ = beside(driver, 0.5, 4.0)
    outline_m = ((-4.0, -4.0), (x, -4.0), (x, y), (-4.0, y))
    hall = Fence(id="hall", kind="keep_in", outline_m=outline_m)
    now_ns = pilotage.bench.clock.now_ns()
    pilotage.bench.put(MAP, Environment(stamp_ns=now_ns, name="hall", planes=(FLOOR,), fences=(hall,)))


def beside(driver: FaultyDriver, x_m: float, y_m: float) -> Vec3:
    assert driver.truth is not None
    x, y, _ = driver.truth.position_m
    return x + x_m, y + y_m, 0.0


def changed(item: ReportItem, **fields: Any) -> ReportItem:
    """Return a report with other fields; other items as they are."""
    return replace(item, **fields) if isinstance(item, RobotReport) else item


def moved(item: ReportItem, by_m: float) -> ReportItem:
    """Return a report that is `by_m` off along x; other items as they are."""
    if not isinstance(item, RobotReport):
        return item
    x, y, z = item.position_m
    return replace(item, position_m=(x + by_m, y, z))


def late(item: ReportItem, by_s: float) -> ReportItem:
    """Return a report of a clock that is `by_s` behind; other items as they are."""
    if not isinstance(item, RobotReport):
        return item
    return replace(item, stamp_ns=item.stamp_ns - round(by_s * NS_PER_S))


@dataclass(frozen=True)
class Case:
    """A reason to stop."""

    cause: Cause
    within_s: float
    """Stated time to the order to stop, s."""
    said: str
    """Part of the sentence for the person."""
    frees: bool = True


UNSURE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
STOPS: dict[str, Case] = {
    "somebody stops it": Case(stop_request, 0.05, "somebody has stopped the robot"),
    "the person lets it go": Case(let_go, 0.05, ""),
    "the pointing ends (button)": Case(interacting(state="idle"), 0.05, "anna is not pointing"),
    "the person's supervisor ends": Case(end_of_supervisor, 0.05, "anna is not pointing"),
    "the person's services end": Case(end_of_services, 0.05, ""),
    "the IMU or its link is silent": Case(silent_arm, 0.4, "the last cursor of anna", frees=False),
    "the person points past everything": Case(pointing_past, 0.1, "", frees=False),
    "the cursor's sigma is too large": Case(
        standing(covariance=UNSURE), 0.1, "m only, limit 0.5 m", frees=False
    ),
    "the person's direction is uncertain": Case(
        interacting(state="pointing", is_unsure=True), 0.05, "has become uncertain", frees=False
    ),
    "the pose from a tracker is stale": Case(
        standing(method="external"), 2.1, "look at the tracker", frees=False
    ),
    "the robot does not report": Case(no_reports, 1.1, "has not reported its place"),
    "the robot's link was lost": Case(lost_link, 0.1, "the robot is switched off"),
    "the robot reports NaN": Case(moving(math.nan), 0.1, "no number"),
    "the robot's place jumps": Case(moving(4.0), 0.1, "jumped by 4.0 m"),
    "a person is in its way": Case(person_ahead, 0.1, "bob", frees=False),
    "a robot is in its way": Case(robot_ahead, 0.1, "robot cart", frees=False),
    "a fence is in its way": Case(fence_ahead, 0.1, "fence hall", frees=False),
}


@pytest.mark.parametrize("name", STOPS)
@flown(CONFIG)
async def test_robot_stops_within_the_stated_time(
    pilotage: Pilotage, drivers: list[FaultyDriver], name: str
) -> None:
    case = STOPS[name]
    driver = await at_full_speed(pilotage, drivers)
    pilotage.bench.bus.subscribe(ROBOT_STATE, lambda state, _name: said.append(state.reason), ROBOT)
    said: list[str] = []
    orders = len(driver.commands)
    since_ns = pilotage.bench.clock.now_ns()
    causing = asyncio.create_task(case.cause(pilotage, driver))

    def passed_s() -> float:
        return (pilotage.bench.clock.now_ns() - since_ns) / NS_PER_S

    ordered_s = rest_s = math.inf
    while passed_s() < case.within_s + BRAKING_S + 1.0:
        if ordered_s == math.inf and any(isinstance(each, Stop) for each in driver.commands[orders:]):
            ordered_s = passed_s()
        if rest_s == math.inf and speed_mps(driver) < 0.05:
            rest_s = passed_s()
        await asyncio.sleep(STEP_S)
    await causing

    print(f"| {name} | {case.within_s:.2f} s | {ordered_s:.2f} s | {rest_s:.2f} s |")  # noqa: T201 - the table
    assert ordered_s <= case.within_s + STEP_S
    assert rest_s <= case.within_s + BRAKING_S
    assert any(case.said in each for each in said), said
    assert pilotage.state.user == ("" if case.frees else "anna")

    if case.frees:  # pointing again, and the cause gone, do not move it
        driver.change = lambda item: (item,)
        pilotage.point("anna", (-1.0, -1.0, 0.0))
        await asyncio.sleep(2.0)
        assert speed_mps(driver) < 0.1


@flown(CONFIG)
async def test_robot_that_reports_no_velocity_stops_before_a_person(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await at_full_speed(pilotage, drivers)
    driver.change = lambda item: (changed(item, velocity_mps=(0.0, 0.0, 0.0)),)
    await asyncio.sleep(0.6)
    orders = len(driver.commands)
    await person_ahead(pilotage, driver)
    await asyncio.sleep(0.1)
    assert any(isinstance(each, Stop) for each in driver.commands[orders:])
    assert "bob" in pilotage.state.reason


@flown(CONFIG)
async def test_robot_with_a_fast_clock_is_lost_equally_early(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await at_full_speed(pilotage, drivers)
    driver.change = lambda item: (late(item, -0.9),)
    await asyncio.sleep(0.2)
    driver.change = lambda _item: ()
    orders = len(driver.commands)
    await asyncio.sleep(1.1)
    assert any(isinstance(each, Stop) for each in driver.commands[orders:])


@pytest.mark.parametrize("mode", ["follow", "land"])
@flown(CONFIG)
async def test_quadrotor_neither_rises_nor_lands_beside_an_approaching_person(
    pilotage: Pilotage, drivers: list[FaultyDriver], mode: str
) -> None:
    if mode == "land":
        driver = await at_full_speed(pilotage, drivers)
        pilotage.steer("anna", Steering(stamp_ns=0, mode="land", robot=ROBOT))
    else:
        pilotage.arrive("anna", FAR)
        await pilotage.until(lambda state: state.phase == "landed")
        driver = drivers[0]
        pilotage.steer("anna", FOLLOW)
    await pilotage.until(lambda state: abs(state.velocity_mps[2]) > 0.2)

    orders = len(driver.commands)
    pilotage.pose("bob", beside(driver, 0.0, 0.3))
    since_ns = pilotage.bench.clock.now_ns()
    stopped = await pilotage.until(lambda state: state.phase == "stopped" and "bob" in state.reason)
    assert stopped.reason_code == "people"
    assert pilotage.bench.clock.now_ns() - since_ns <= 0.1 * NS_PER_S
    assert isinstance(driver.commands[orders], Stop)

    if mode == "follow":
        return
    await asyncio.sleep(BRAKING_S)
    orders = len(driver.commands)
    await asyncio.sleep(5.0)  # it does not come down in many small steps either
    assert driver.commands[orders:] == []

    pilotage.pose("bob", beside(driver, 0.0, 3.0))
    await pilotage.until(lambda state: state.phase == "landed")


def test_guide_states_these_times() -> None:
    rows = [line.split(" | ")[:2] for line in GUIDE.read_text(encoding="utf-8").splitlines()]
    stated = {cells[0].removeprefix("| "): cells[1] for cells in rows if len(cells) == 2}
    assert {name: stated.get(name) for name in STOPS} == {
        name: f"{case.within_s:.2f} s" for name, case in STOPS.items()
    }


def speed_mps(driver: FaultyDriver) -> float:
    assert driver.truth is not None
    return math.hypot(*driver.truth.velocity_mps)


async def at_full_speed(pilotage: Pilotage, drivers: list[FaultyDriver]) -> FaultyDriver:
    """Let anna steer the robot until it is at its full speed; return its driver."""
    pilotage.arrive("anna", FAR)
    await pilotage.until(lambda state: state.phase == "landed")
    pilotage.steer("anna", FOLLOW)
    for _ in range(1000):
        if drivers[0].truth is not None and speed_mps(drivers[0]) > 0.98:
            return drivers[0]
        await asyncio.sleep(STEP_S)
    raise AssertionError(pilotage.state)


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
        angle = math.tau * index / count
        radius_m = rng.uniform(least_m, most_m)
        corners.append((center_m[0] + radius_m * math.cos(angle), center_m[1] + radius_m * math.sin(angle)))
    return FloorArea(corners)


def random_fences(rng: random.Random) -> tuple[Fence, ...]:
    """Return a fence around the robot's start at the origin, and some volumes beside it."""
    inside = star(rng, (0.0, 0.0), 1.5, 5.0)
    fences = [Fence(id="hall", kind="keep_in", outline_m=inside.corners_m, high_m=2.5)]
    for index in range(rng.randint(0, 3)):
        angle = rng.uniform(0.0, math.tau)
        range_m = rng.uniform(1.6, 3.5)
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
    """Return a course of the seed `seed`."""
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
    angle = rng.uniform(0.0, math.tau)
    range_m = rng.uniform(1.8, 4.0)
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
    x_m = rng.uniform(0.35, 0.8)
    wide_m = rng.uniform(0.3, 0.8)
    y_m = rng.uniform(-1.2, 0.3)
    end_m = rng.uniform(0.4, 1.5)
    outline_m = ((x_m, y_m), (x_m + wide_m, y_m), (x_m + wide_m, end_m), (x_m, end_m))
    box = Fence(id="box", kind="keep_out", outline_m=outline_m)
    events: list[tuple[Event, Vec3, float]] = []
    for _ in range(3):
        angle = rng.uniform(-math.pi / 2.0, math.pi / 2.0)
        range_m = rng.uniform(1.0, 6.0)
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


@pytest.mark.parametrize("kind", ["quadrotor", "ground"])
def test_robot_moves_crosses_no_fence_and_approaches_nobody(kind: RobotKind) -> None:
    assert sum(check_course(random_course(kind, seed)) for seed in range(8)) > 8 * 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "seeds",
    [
        # course 127 alone notices a turn whose directions are not checked
        pytest.param((*range(0, 200, 10), 127), id="21 courses"),
        pytest.param(range(200), id="200 courses", marks=pytest.mark.long),
    ],
)
def test_ground_robot_that_turns_beside_corners_crosses_none(seeds: Sequence[int]) -> None:
    way_m = [check_course(corner_course(seed)) for seed in seeds]
    assert sum(way_m) > len(way_m) * 0.5


@pytest.mark.parametrize(
    ("max_speed_mps", "max_acceleration_mps2", "start_yaw_deg"), [(1.0, 4.0, 180.0), (1.5, 2.0, 270.0)]
)
def test_robot_led_about_a_corner_keeps_clear_and_moves_steadily(
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
