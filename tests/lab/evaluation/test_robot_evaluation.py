"""Identification and localization by robots, evaluated over simulated people and over trials."""

from dataclasses import replace

import numpy as np
import pytest

from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.localization.trial import Trial
from pointit_lab.evaluation.robots.following import (
    CIRCLE,
    FIGURE,
    LINE,
    intervals,
    recorded_rows,
    simulated_rows,
)
from pointit_lab.evaluation.robots.identification import rates, recorded_results, share
from pointit_lab.evaluation.robots.simulated_follower import RATE_HZ, SimulatedFollower


def test_people_who_follow_the_figure_are_found_better_than_by_a_circle_or_a_line() -> None:
    rows = simulated_rows(range(20))
    for kind in ("ground", "quadrotor"):
        of = {row.solver: row for row in rows if row.subject == "all" and row.condition == f"5 s, {kind}"}
        medians = {name: row.position_m.median for name, row in of.items() if row.position_m is not None}
        assert medians[FIGURE] < min(0.8 * medians[CIRCLE], medians[LINE])
        assert medians[FIGURE] < 0.5
        assert (of[FIGURE].within_2_sigma or 0.0) >= 0.9
    (against_circle,) = [
        each for each in intervals(rows) if (each.condition, each.solver) == ("5 s, ground", CIRCLE)
    ]
    assert against_circle.ratio is not None
    assert against_circle.ratio.low > 1.0


def recorded(subject: str, way_rad: float, seconds: float) -> Trial:
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
    return Trial(
        set="set",
        subject=subject,
        condition=f"{seconds:g} s",
        pointings=Pointings(times_s, origins, rays, course(times_s + 10.0)),
        eye_height_m=person.eyes_m,
        x_m=0.0,
        y_m=0.0,
        yaw_rad=0.0,
    )


def test_a_recorded_robot_is_told_from_that_of_another_person() -> None:
    trials = [recorded(name, way, 3.0) for name, way in (("anna", 0.3), ("ben", 1.6), ("carla", 2.9))]
    found = {(rate.subject, rate.method): rate for rate in rates(recorded_results(trials, (3.0,)))}
    assert found["all", "with a pose"].n == 3
    assert found["all", "with a pose"].right.value == 1.0
    assert found["anna", "without a pose"].n == 1
    assert recorded_results(trials[:1], (3.0,)) == []


def test_recorded_people_are_scored_person_by_person() -> None:
    rows = recorded_rows([recorded(name, way, 5.0) for name, way in (("anna", 0.3), ("ben", 1.6))])
    assert [row.subject for row in rows] == ["all", "anna", "ben"]
    assert all(row.position_m is not None and row.position_m.median < 1.0 for row in rows)


def test_a_share_has_an_interval() -> None:
    assert share(20, 20).value == 1.0
    assert share(20, 20).high == pytest.approx(1.0)
    assert 0.8 < share(20, 20).low < 0.9
