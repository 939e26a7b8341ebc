"""Rays of people who point, and whose turn it is to use a robot."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor
from pointit.site.pointing_people import MAX_CURSOR_AGE_S, MIN_SLOPE, TURN_S, PersonRay, PointingPeople

EYES_M = (0.0, 0.0, 1.6)
AHEAD = (1.0, 0.0, 0.0)
BESIDE = (0.0, 1.0, 0.0)

directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda way: vector.norm(way) > 0.1)


def is_ahead(ray: PersonRay) -> bool:
    return ray.direction[0] > 0.9


def point(people: PointingPeople, user: str, at_s: float, direction: Vec3 = AHEAD) -> None:
    stamp_ns = round(at_s * NS_PER_S)
    people.on_cursor(Cursor(stamp_ns=stamp_ns, origin_m=EYES_M, direction=direction), user)


def choose(people: PointingPeople, at_s: float, *, is_busy: bool = False) -> str:
    people.choose_owner(round(at_s * NS_PER_S), is_ahead, is_busy=is_busy)
    return people.owner


@given(direction=directions, height_m=st.floats(-5.0, 5.0))
def test_ray_meets_a_height_on_its_line_ahead(direction: Vec3, height_m: float) -> None:
    ray = PersonRay(0, EYES_M, vector.normalized(direction))
    point_m = ray.at_height(height_m)
    if point_m is None:
        is_level = abs(ray.direction[2]) < MIN_SLOPE
        assert is_level or (height_m - EYES_M[2]) * ray.direction[2] < 0.0
        return
    assert point_m[2] == height_m
    if math.dist(point_m, EYES_M) > 1e-6:
        assert ray.angle_to(point_m) < 1e-5


@pytest.mark.parametrize(
    ("direction", "height_m"),
    [(AHEAD, 0.7), ((0.8, 0.0, 0.6), 0.7), ((0.8, 0.0, -0.6), 2.0), ((0.9999, 0.0, -0.01), 0.7)],
)
def test_ray_that_is_level_or_leads_away_meets_no_height(direction: Vec3, height_m: float) -> None:
    assert PersonRay(0, EYES_M, direction).at_height(height_m) is None


def test_first_by_name_owns_a_free_robot() -> None:
    people = PointingPeople()
    assert choose(people, 0.0) == ""
    point(people, "ben", 0.0)
    point(people, "anna", 0.0)
    point(people, "aaron", 0.0, BESIDE)
    assert choose(people, 0.1) == "anna"
    assert people.owners_ray is not None
    assert "aaron" in people


def test_owner_stays_until_they_point_elsewhere_for_their_turn() -> None:
    people = PointingPeople()
    point(people, "ben", 0.0)
    assert choose(people, 0.0) == "ben"

    changed_s = math.inf
    for step in range(60):
        at_s = 0.1 * step
        point(people, "anna", at_s)
        point(people, "ben", at_s, BESIDE)
        if choose(people, at_s) == "anna":
            changed_s = min(changed_s, at_s)
    assert changed_s == pytest.approx(TURN_S + 0.1)


def test_busy_robot_does_not_change_hands() -> None:
    people = PointingPeople()
    point(people, "ben", 0.0)
    assert choose(people, 0.0) == "ben"
    point(people, "anna", 60.0)
    assert choose(people, 60.0, is_busy=True) == "ben"
    assert people.owners_ray is None
    assert choose(people, 60.0) == "anna"


def test_ray_ends_with_its_cursor_or_its_age() -> None:
    people = PointingPeople()
    point(people, "anna", 0.0)
    assert "anna" in people
    people.on_cursor(Cursor(stamp_ns=1), "anna")
    assert "anna" not in people

    point(people, "anna", 1.0)
    choose(people, 1.0 + 0.9 * MAX_CURSOR_AGE_S)
    assert "anna" in people
    choose(people, 1.1 + MAX_CURSOR_AGE_S)
    assert "anna" not in people
