"""Evaluation of robots: flights and their landings."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.errors import ConfigError
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets.hri_landing import MOVES, TRAJECTORIES, read_moves
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.robots import flight as flight_module
from pointit_lab.evaluation.robots import following
from pointit_lab.evaluation.robots.flight import FlightScore, fly
from pointit_lab.evaluation.robots.flight_row import flight_row, recorded_rows
from pointit_lab.evaluation.robots.flight_setup import CONDITIONS, FlightCondition, flight_of
from pointit_lab.evaluation.robots.identification import rates, recorded_results
from pointit_lab.evaluation.robots.simulated_follower import RATE_HZ, SimulatedFollower
from tests.support import there


def test_people_who_follow_the_figure_are_found_better_than_by_a_circle_or_a_line() -> None:
    rows = following.simulated_rows(range(20))
    for kind in ("ground", "quadrotor"):
        of = {row.solver: row for row in rows if row.subject == "all" and row.condition == f"5 s, {kind}"}
        medians = {name: row.position_m.median for name, row in of.items() if row.position_m is not None}
        assert medians[following.FIGURE] < min(0.8 * medians[following.CIRCLE], medians[following.LINE])
        assert medians[following.FIGURE] < 0.5
        assert (of[following.FIGURE].within_2_sigma or 0.0) >= 0.9
    (against_circle,) = [
        each
        for each in following.intervals(rows)
        if (each.condition, each.solver) == ("5 s, ground", following.CIRCLE)
    ]
    assert there(against_circle.ratio).low > 1.0


def recorded(subject: str, way_rad: float, seconds: float) -> LocalizationTrial:
    rng = np.random.default_rng(round(100 * way_rad))
    person = replace(SimulatedFollower.drawn(rng), x_m=0.0, y_m=0.0, yaw_rad=0.0)
    times_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)

    def course(at_s: np.ndarray) -> np.ndarray:
        turned = 0.8 * at_s
        x, y = 2.0 + np.sin(turned), 1.2 * np.cos(turned)
        cos, sin = np.cos(way_rad), np.sin(way_rad)
        return np.stack([x * cos - y * sin, x * sin + y * cos, 1.0 + 0.3 * np.sin(2.0 * turned)], axis=1)

    rays = person.directions(course, times_s + 10.0, rng)
    rays[times_s < 1.0] = rays[times_s >= 1.0][0]
    origins = np.tile([0.0, 0.0, person.eyes_m], (len(times_s), 1))
    return LocalizationTrial(
        set="set", subject=subject, condition=f"{seconds:g} s",
        pointings=Pointings(times_s, origins, rays, course(times_s + 10.0)), eye_height_m=person.eyes_m,
        x_m=0.0, y_m=0.0, yaw_rad=0.0,
    )  # fmt: skip


def test_a_recorded_robot_is_told_from_that_of_another_person() -> None:
    trials = [recorded(name, way, 3.0) for name, way in (("anna", 0.3), ("ben", 1.6), ("carla", 2.9))]
    found = {(rate.subject, rate.method): rate for rate in rates(recorded_results(trials, (3.0,)))}
    assert found["all", "with a pose"].n == 3
    assert found["all", "with a pose"].right.value == 1.0
    assert found["anna", "without a pose"].n == 1
    assert recorded_results(trials[:1], (3.0,)) == []


def test_recorded_people_are_scored_person_by_person() -> None:
    rows = following.recorded_rows([recorded(name, way, 5.0) for name, way in (("anna", 0.3), ("ben", 1.6))])
    assert [row.subject for row in rows] == ["all", "anna", "ben"]
    assert all(row.position_m is not None and row.position_m.median < 1.0 for row in rows)


LANDINGS = [condition for condition in CONDITIONS if condition.bench == "landing"]


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.name)
def test_people_steer_the_robot_to_the_spot_in_every_condition(condition: FlightCondition) -> None:
    score = fly(flight_of(condition, 2))
    assert score.error_m is not None
    assert score.error_m < 0.25
    assert score.time_s is not None
    assert 1.0 < score.time_s < 30.0
    assert score.detour is not None
    assert score.detour > 0.9


def test_a_person_who_never_gets_the_robot_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_module, "LIMIT_S", 5.0)
    flight = flight_of(LANDINGS[0], 0)
    far = replace(flight, start_m=(900.0, 0.0, flight.start_m[2]), spot_m=(0.2, 0.0, 0.0))
    score = fly(far)
    assert score == FlightScore(simulated_s=score.simulated_s)
    assert score.simulated_s >= 5.0


def test_rows_have_the_medians_of_those_that_ended_and_count_the_others() -> None:
    scores = [FlightScore(simulated_s=9.0, error_m=0.1 * number, time_s=1.0) for number in range(1, 6)]
    row = flight_row(LANDINGS[0], [*scores, FlightScore(simulated_s=60.0)])
    assert (row.n, row.failed) == (6, 1)
    assert there(row.error_m).median == pytest.approx(0.3)
    assert row.taking_s is None


STATES = [[0.0, "STATE_IDLE"], [1.0, "STATE_GOAL"], [9.0, "STATE_LANDING"]]


def write(folder: Path, *moves: dict[str, object], rows: str = "") -> Path:
    """Write a move from (-1, 0) to (1, 0), with a corner at (0, 1), that ends 0.1 m beside the spot."""
    usual: dict[str, object] = {
        "move": 0, "subject": "a", "mode": "pointing", "from_xy": [-1.0, 0.0], "to_xy": [1.0, 0.0],
        "states": STATES,
    }  # fmt: skip
    lines = [json.dumps(usual | move) for move in moves or ({},)]
    (folder / MOVES).write_text("\n".join(lines) + "\n", encoding="utf-8")
    way = "".join(
        f"{number},{row}\n"
        for number in range(len(lines))
        for row in ("0.5,-5,0,1", "1,-1,0,1", "5,0,1,1", "9,1,0.1,0.6", "9.5,7,7,0")
    )
    (folder / TRAJECTORIES).write_text(f"move,t,x,y,z\n{rows or way}", encoding="utf-8")
    return folder


def test_error_time_and_detour_count_from_the_steering_to_the_landing(tmp_path: Path) -> None:
    (move,) = read_moves(write(tmp_path))
    assert (move.error_m, move.time_s) == pytest.approx((0.1, 8.0))
    assert move.detour == pytest.approx((2.0**0.5 + (1.0 + 0.9**2) ** 0.5) / 2.0)


def test_a_move_without_a_landing_is_left_out(tmp_path: Path) -> None:
    moves = read_moves(write(tmp_path, {"states": STATES[:2]}, {"move": 1, "subject": "b"}))
    assert [move.subject for move in moves] == ["b"]


def test_rows_are_those_of_the_devices_that_were_recorded(tmp_path: Path) -> None:
    rows = recorded_rows(write(tmp_path, {}, {"move": 1, "mode": "joystick"}, {"move": 2}))
    assert [(row.who, row.n, row.people) for row in rows] == [
        ("people, pointing", 2, 1),
        ("people, joystick", 1, 1),
    ]
    assert rows[0].error_m is None
    assert there(rows[0].ordered_error_m).median == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("move", "rows", "said"),
    [
        ({"move": 7}, "", "move 7 has no way"),
        ({"to_xy": [-1.0, 0.0]}, "", "has no way from spot to spot"),
        ({"mode": "mouse"}, "", "line 1: mode"),
        ({"subject": "all"}, "", "is reserved"),
        ({"states": [[9.0, "STATE_GOAL"], [1.0, "STATE_LANDING"]]}, "", "time goes backwards"),
        ({}, "0,1,-1,0,1\n0,9,1,0,1\n0,5,1,0,1\n", "line 4, column 't': time goes backwards"),
        ({}, "0,1,x,0,1\n", "column 'x'"),
    ],
)
def test_damage_is_told_with_its_line(tmp_path: Path, move: dict[str, object], rows: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        read_moves(write(tmp_path, move, rows=rows))
