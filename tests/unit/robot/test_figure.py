"""The figure for localization: more informative than a circle and a line, closed, and away from people."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.services.robot import followed_figure
from pointit.services.robot.followed_figure import AssumedPerson, best_figure, figures, position_sigmas_m

START: Vec3 = (2.5, 0.5, 1.2)
PERSON = AssumedPerson((0.0, 0.0, 0.0), 1.5)


def sigma_m(points: np.ndarray) -> float:
    return float(position_sigmas_m(points[None], np.array([PERSON.place_m]))[0, 0])


@pytest.mark.parametrize("start", [START, (2.5, 0.5, 0.0)])
def test_the_best_figure_tells_more_than_a_circle_and_a_line_of_the_same_length(start: Vec3) -> None:
    best = figures(start, [PERSON], length_m=5.0, is_flying=start[2] > 0.0)[0]
    turned = np.linspace(0.0, math.tau, 25)
    radius_m = 5.0 / math.tau
    away = np.array(start) + np.stack(
        [radius_m * (1.0 - np.cos(turned)), radius_m * np.sin(turned), 0.0 * turned], axis=1
    )
    across = np.array(start) + np.stack([0.0 * turned, 1.25 * np.sin(turned), 0.0 * turned], axis=1)
    assert best.sigma_m < 0.8 * sigma_m(away)
    assert best.sigma_m < 0.8 * sigma_m(across)
    assert best.sigma_m < 0.3


@given(st.floats(1.6, 5.0), st.floats(-math.pi, math.pi), st.floats(1.0, 6.0), st.sampled_from([0.0, 1.2]))
@settings(max_examples=20, deadline=None)
def test_figures_are_closed_as_long_as_asked_and_away_from_people(
    reach_m: float, way_rad: float, length_m: float, height_m: float
) -> None:
    start = (reach_m * math.cos(way_rad), reach_m * math.sin(way_rad), height_m)
    found = figures(start, [PERSON], length_m=length_m, is_flying=height_m > 0.0)
    assert found == sorted(found, key=lambda figure: figure.sigma_m)
    for each in found:
        points = np.array(each.points_m)
        assert points[0] == pytest.approx(start)
        assert points[-1] == pytest.approx(start, abs=1e-6)
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(length_m, rel=0.01)
        assert np.hypot(points[:, 0], points[:, 1]).min() >= 1.5
        assert height_m > 0.0 or (points[:, 2] == 0.0).all()


@pytest.mark.parametrize("start", [START, (2.5, 0.5, 0.0)])
def test_an_unknown_latency_costs_little_on_the_best_figure_and_much_on_a_circle(
    monkeypatch: pytest.MonkeyPatch, start: Vec3
) -> None:
    """The tracker is late, at constant speed: a circle turns the pose by it, and no residual tells."""
    best = even(np.array(figures(start, [PERSON], length_m=4.0, is_flying=start[2] > 0.0)[0].points_m))
    turned = np.linspace(0.0, math.tau, 101)
    circle = np.array(start) + 4.0 / math.tau * np.stack(
        [1.0 - np.cos(turned), np.sin(turned), 0.0 * turned], axis=1
    )
    sigmas_m: list[tuple[float, float]] = []
    for late_s in (0.001, 0.5):
        monkeypatch.setattr(followed_figure, "PRIOR", np.append(followed_figure.PRIOR[:4], late_s**-2))
        sigmas_m.append((sigma_m(best), sigma_m(circle)))
    (best_m, circle_m), (best_late_m, circle_late_m) = sigmas_m
    assert best_late_m < 2.0 * best_m
    assert circle_late_m > 4.0 * circle_m


def even(points: np.ndarray) -> np.ndarray:
    """Return 101 points at equal distances along `points` (n x 3)."""
    passed_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    wanted_m = np.arange(101) * float(passed_m[-1]) / 100.0
    return np.stack([np.interp(wanted_m, passed_m, points[:, axis]) for axis in range(3)], axis=1)


def test_what_a_robot_at_rest_shows_is_not_enough() -> None:
    assert sigma_m(np.tile(START, (25, 1))) > 5.0


def test_the_choice_does_not_depend_on_where_the_room_lies() -> None:
    moved = (1000.0, -500.0, 0.0)
    here = figures(START, [PERSON], length_m=4.0, is_flying=True)[0]
    start = (START[0] + moved[0], START[1] + moved[1], START[2])
    there = figures(start, [AssumedPerson(moved, 1.5)], length_m=4.0, is_flying=True)[0]
    assert there.sigma_m == pytest.approx(here.sigma_m, rel=1e-3)


def test_the_best_permitted_figure_is_taken_and_none_if_there_is_none() -> None:
    ranked = figures(START, [PERSON], length_m=4.0, is_flying=True)
    found = best_figure(ranked, lambda points: points != ranked[0].points_m)
    assert found is ranked[1]
    assert best_figure(ranked, lambda _points: False) is None
    assert figures((0.5, 0.0, 1.2), [PERSON], length_m=4.0, is_flying=True) == []
