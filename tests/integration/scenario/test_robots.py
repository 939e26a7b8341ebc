"""People and robots in virtual time: flights, paths, goals."""

import statistics
from collections.abc import Callable, Iterable

import pytest

from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import read_scenario
from tests.integration.scenario.play import play
from tests.integration.scenario.steered_robots import Flights, play_robots

SOME = [
    pytest.param(range(1, 3), 32.0, id="2 seeds"),
    pytest.param(range(1, 21), 120.0, id="20 seeds", marks=pytest.mark.long),
]
WITHOUT_FENCES = ("pui.map=lab",)
"""For less computing."""
LANDED_M = 0.25
"""Largest median distance of landings from where they were meant to be."""


def fences_crossed(flights: Flights) -> int:
    return sum(score.fences_crossed for score in flights.robots.robots.values())


@pytest.mark.slow
@pytest.mark.parametrize(("seeds", "duration_s"), SOME)
def test_quadrotor_lands_at_the_pointed_place_without_crossing_a_fence(
    seeds: Iterable[int], duration_s: float
) -> None:
    off_m: list[float] = []
    for seed in seeds:
        flights = play_robots("scenario_5", duration_s, seed=seed)
        assert len(flights.landed_off_m) >= duration_s // 25.0, seed
        assert statistics.median(flights.landed_off_m) < LANDED_M, seed
        assert fences_crossed(flights) == 0, seed
        assert flights.nearest_m > 1.0
        assert ("rover", "moving") not in flights.phases
        off_m += flights.landed_off_m
    assert statistics.median(off_m) < 0.15


@pytest.mark.parametrize(("seeds", "duration_s"), SOME)
@pytest.mark.slow
def test_people_send_a_rover_along_paths_by_strip_light(seeds: Iterable[int], duration_s: float) -> None:
    off_m: list[float] = []
    for seed in seeds:
        flights = play_robots("scenario_6", duration_s, seed=seed)
        rover = flights.robots.robots["rover"].as_dict()
        assert rover["goals_reached"] >= duration_s // 25.0, seed
        assert rover["goals"] - rover["goals_reached"] <= 1, seed  # the last is on its way
        assert fences_crossed(flights) == 0, seed
        assert flights.nearest_m > 1.0
        assert ("quad", "moving") not in flights.phases
        off_m += flights.sent_off_m
    assert statistics.median(off_m) < LANDED_M


def reached(flights: Flights, user: str) -> bool:
    return any("has arrived" in text or "has landed" in text for text in flights.texts(user))


THREE_USERS = ("anna", "ben", "cleo")


def play_three(
    scenario: str, duration_s: float, seed: int, is_done: Callable[[Flights, str], bool]
) -> Flights:
    """Play until all of three people, whom a robot localizes, are done."""

    def are_done(seen: Flights) -> bool:
        return all(is_done(seen, user) for user in THREE_USERS)

    return play_robots(scenario, duration_s, seed=seed, users=THREE_USERS, localized_by="", until=are_done)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["scenario_5", "scenario_6"])
def test_one_robot_finds_three_people_before_anybody_takes_it(scenario: str) -> None:
    flights = play_three(scenario, 30.0, 1, lambda seen, user: "You are localized." in seen.texts(user))
    for user in THREE_USERS:
        assert "You are localized." in flights.texts(user), user
        assert not [text for text in flights.texts(user) if "two or more" in text]
    texts = [cue.text for _, cue in flights.cues]
    found = max(at for at, text in enumerate(texts) if text == "You are localized.")
    assert not [text for text in texts[:found] if "is yours" in text]


@pytest.mark.parametrize(
    ("seeds", "scenario"),
    [
        pytest.param(range(2, 3), "scenario_5", marks=pytest.mark.slow, id="1 seed"),
        pytest.param(range(1, 21), "scenario_5", marks=pytest.mark.long, id="20 seeds"),
        pytest.param(range(1, 21), "scenario_6", marks=pytest.mark.long, id="20 seeds of a rover"),
    ],
)
def test_three_people_whom_a_robot_localizes_all_reach_a_goal(seeds: Iterable[int], scenario: str) -> None:
    for seed in seeds:
        flights = play_three(scenario, 400.0, seed, reached)
        assert {user for user in THREE_USERS if reached(flights, user)} == set(THREE_USERS), seed
        assert flights.nearest_m > 1.0, seed


def turns(flights: Flights, robot: str) -> list[str]:
    """Return the people who steered a robot, in turn. Checks that it was free in between."""
    users = [user for name, user in flights.owners if name == robot]
    assert users[1::2] == [""] * (len(users) // 2)
    return users[::2]


@pytest.mark.slow
def test_two_people_share_one_quadrotor_which_is_never_of_both() -> None:
    flights = play_robots("scenario_5", 50.0, seed=2, users=("anna", "ben"), settings=WITHOUT_FENCES)
    assert set(turns(flights, "quad")) == {"anna", "ben"}
    told = [*flights.texts("anna"), *flights.texts("ben")]
    assert any(text.startswith("quad is steered by ") for text in told)
    assert statistics.median(flights.landed_off_m) < LANDED_M


@pytest.mark.slow
def test_two_people_steer_two_robots_at_once() -> None:
    scenario = read_scenario("scenario_5")
    scenario.site["robot.swift"] = {"kind": "quadrotor", "start_m": [1.2, 2.0, 0.0], "radius_m": 0.15}
    scenario.user["user-sim"]["spots_m"] = [[3.6, 3.4, 0.0], [1.4, 3.2, 0.0]]
    flights = play_robots(scenario, 24.0, seed=1, users=("anna", "ben"), settings=WITHOUT_FENCES)
    assert turns(flights, "quad")
    assert turns(flights, "swift")

    own: dict[str, str] = {}
    both = False
    for robot, user in flights.owners:
        if user:
            assert user not in own.values()  # a person has one robot at most
            own[robot] = user
        else:
            own.pop(robot, None)
        both |= len(own) == 2

    assert both
    assert flights.landed_off_m


@pytest.mark.slow
@pytest.mark.parametrize(("skill", "least", "farthest_m"), [(0.0, 5, 0.8), (1.0, 8, 0.4)])
def test_goals_are_where_they_were_meant_to_be(skill: float, least: int, farthest_m: float) -> None:
    outcome = play("send_a_robot", Choices(seed=1, settings=(f"user-sim.aim.skill={skill}",)), 120.0)
    assert len(outcome.goals) >= least
    assert max(away_m for _, away_m in outcome.goals) < farthest_m
    for goal, _ in outcome.goals:
        assert goal.surface_id == "workspace/horizontal"
        assert goal.position_m[2] == pytest.approx(0.0, abs=1e-9)
        assert goal.clearance_m >= 0.5
    texts = [cue.text for cue in outcome.cues]
    assert texts.count("the robot is sent there") == len(outcome.goals)
    assert outcome.states[-1] == "pointing"
