"""Rows of things, and steps among them: every thing is reached."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.schemas import Cursor, Step, TrackedObject
from pointit.services.selector.methods.rows import neighbour, place_in, rows_of

EYES = (0.0, 0.0, 1.64)
AHEAD = Cursor(stamp_ns=0, origin_m=EYES, direction=(1.0, 0.0, 0.0))
STEPS = [Step(stamp_ns=0, by=by, to=to) for by in (-1, 1) for to in ("beside", "row")]


def things_at(*boxes: tuple[float, float, float, float]) -> list[TrackedObject]:
    """Return boxes at (x, y, z, height), m."""
    return [
        TrackedObject(
            id=f"t{index}", kind="thing", position_m=(x, y, z), size_m=(0.2, 0.2, height), length_m=0.2
        )
        for index, (x, y, z, height) in enumerate(boxes)
    ]


def distances(things: list[TrackedObject], start: str) -> dict[str, int]:
    """Return the least number of steps from `start` to each thing that can be reached."""
    reached = {start: 0}
    edge = [start]
    while edge:
        here = edge.pop(0)
        for step in STEPS:
            there = neighbour(things, AHEAD, here, step)
            if there not in reached:
                reached[there] = reached[here] + 1
                edge.append(there)
    return reached


coordinates = st.floats(-4, 4).filter(lambda each: abs(each) > 1e-3)
rooms = st.lists(
    st.tuples(coordinates, coordinates, st.floats(0, 2.5), st.floats(0.02, 2.0)), min_size=1, max_size=14
)


@given(rooms)
def test_each_thing_is_reachable_in_rows_plus_columns_steps(
    boxes: list[tuple[float, float, float, float]],
) -> None:
    things = things_at(*boxes)
    rows = rows_of(things, EYES)
    assert sorted(name for row in rows for name in row) == sorted(each.id for each in things)
    most = len(rows) + max(map(len, rows))
    for start in things:
        assert distances(things, start.id).keys() == {each.id for each in things}
        assert max(distances(things, start.id).values()) <= most


def test_row_step_leads_up_or_down_and_stops_at_ends() -> None:
    things = things_at(*((2.5, y, z, 0.3) for z in (1.6, 1.0, 0.4) for y in (0.8, 0.0, -0.8)))
    down = Step(stamp_ns=0, by=1, to="row")
    up = Step(stamp_ns=0, by=-1, to="row")
    assert [neighbour(things, AHEAD, each, down) for each in ("t2", "t5", "t8")] == ["t5", "t8", "t8"]
    assert neighbour(things, AHEAD, "t1", up) == "t1"


def test_touching_drawers_are_rows_and_a_tall_fridge_joins_one() -> None:
    things = things_at((2, 0.4, 1.2, 0.2), (2, 0.4, 1.0, 0.2), (2, 0.4, 0.8, 0.2), (2, -0.5, 0.9, 1.8))
    assert rows_of(things, EYES) == [["t0", "t3"], ["t1"], ["t2"]]


def test_row_around_the_person_begins_behind_its_widest_gap() -> None:
    angles = [-120.0, 0.0, 100.0, 170.0]
    points = [vector.direction(math.radians(each), 0.0) for each in angles]
    things = things_at(*((3 * x, 3 * y, 1.0, 0.3) for x, y, _ in points))
    assert rows_of(things, EYES) == [["t0", "t3", "t2", "t1"]]


@pytest.mark.parametrize(
    ("heights_m", "place"),
    [
        ((1.0,), "2 of 2"),
        ((1.0, 1.5), "2 of 2, lower row"),
        ((0.5, 1.0, 1.5), "2 of 2, middle row"),
        ((1.0, 1.3, 1.6, 1.9), "2 of 2, row 4 of 4 from above"),
    ],
)
def test_place_names_number_and_row(heights_m: tuple[float, ...], place: str) -> None:
    things = things_at((2, 1, 1.0, 0.2), (2, -1, 1.0, 0.2), *((2, 1, z, 0.2) for z in heights_m if z != 1.0))
    assert place_in(rows_of(things, EYES), "t1") == place
