"""Objects under a cursor: on lines, in space, moving, of several trackers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import Cursor, TrackedObject, TrackedObjects
from pointit.services.selector.objects.object_positions import MAX_TRACKERS, ObjectPositions

S = 1_000_000_000


def on_strip(
    object_id: str, position_m: float, *, speed_mps: float = 0.0, strip: str = "0", length_m: float = 0.3
) -> TrackedObject:
    return TrackedObject(
        id=object_id,
        kind="red",
        position_m=(position_m, 0.0, 0.0),
        length_m=length_m,
        surface="strip",
        surface_id=strip,
        surface_position_m=position_m,
        surface_speed_mps=speed_mps,
    )


def listing(*objects: TrackedObject, stamp_ns: int = S) -> TrackedObjects:
    return TrackedObjects(stamp_ns=stamp_ns, objects=objects)


def cursor(position_m: float, *, stamp_ns: int = S, strip: str = "0") -> Cursor:
    return Cursor(
        stamp_ns=stamp_ns,
        surface="strip",
        surface_id=strip,
        point_m=(position_m, 0.0, 0.0),
        position_m=position_m,
    )


def under(whereabouts: ObjectPositions, at: Cursor) -> str | None:
    found = whereabouts.hit_test(at)
    return None if found is None else found.id


@pytest.mark.parametrize(
    ("position_m", "expected"), [(0.79, None), (0.81, "a"), (1.0, "a"), (1.19, "a"), (1.21, None)]
)
def test_half_the_length_and_the_margin_count(position_m: float, expected: str | None) -> None:
    whereabouts = ObjectPositions(margin_m=0.05)
    whereabouts.update("one", listing(on_strip("a", 1.0)))
    assert under(whereabouts, cursor(position_m)) == expected


def test_other_surfaces_do_not_count() -> None:
    whereabouts = ObjectPositions()
    whereabouts.update("one", listing(on_strip("a", 1.0, strip="1")))
    assert under(whereabouts, cursor(1.0)) is None
    assert under(whereabouts, cursor(1.0, strip="1")) == "a"
    assert under(whereabouts, Cursor(stamp_ns=S)) is None
    belt = Cursor(stamp_ns=S, surface="belt", surface_id="1", point_m=(1.0, 0.0, 0.0), position_m=1.0)
    assert under(whereabouts, belt) is None


@given(st.floats(-2, 2), st.floats(-0.5, 0.5))
def test_objects_are_taken_where_they_were_at_the_cursors_time(speed_mps: float, age_s: float) -> None:
    whereabouts = ObjectPositions(margin_m=0.0)
    whereabouts.update("one", listing(on_strip("a", 2.0, speed_mps=speed_mps, length_m=0.02)))
    stamp_ns = S + round(age_s * S)
    assert under(whereabouts, cursor(2.0 + speed_mps * age_s, stamp_ns=stamp_ns)) == "a"
    assert under(whereabouts, cursor(2.0 + speed_mps * age_s + 0.02, stamp_ns=stamp_ns)) is None


@given(st.lists(st.floats(0, 5), min_size=1, max_size=30), st.floats(0, 5))
def test_arrays_find_what_looking_at_each_finds(positions_m: list[float], at_m: float) -> None:
    whereabouts = ObjectPositions(margin_m=0.05)
    whereabouts.update("one", listing(*(on_strip(str(i), p) for i, p in enumerate(positions_m))))
    gaps = {str(i): abs(p - at_m) for i, p in enumerate(positions_m)}
    best = min(gaps, key=lambda object_id: gaps[object_id])
    assert under(whereabouts, cursor(at_m)) == (best if gaps[best] <= 0.3 / 2 + 0.05 else None)


def test_free_objects_count_by_their_distance_to_the_point() -> None:
    robot = TrackedObject(
        id="robot", kind="robot", position_m=(1.0, 0.3, 0.0), velocity_mps=(0.0, -0.5, 0.0), length_m=0.2
    )
    whereabouts = ObjectPositions(margin_m=0.05)
    whereabouts.update("one", listing(robot))
    assert under(whereabouts, cursor(1.0)) is None
    assert under(whereabouts, cursor(1.0, stamp_ns=S + S // 2)) == "robot"
    assert under(whereabouts, Cursor(stamp_ns=S + S // 2)) is None


def test_trackers_list_their_own_and_the_nearest_of_all_wins() -> None:
    whereabouts = ObjectPositions(margin_m=0.3)
    whereabouts.update("one", listing(on_strip("a", 1.0)))
    whereabouts.update("two", listing(on_strip("b", 1.2)))
    assert under(whereabouts, cursor(1.15)) == "b"
    assert under(whereabouts, cursor(1.05)) == "a"
    whereabouts.update("two", listing())
    assert under(whereabouts, cursor(1.15)) == "a"
    assert {o.id: o.kind for o in whereabouts.objects.values()} == {"a": "red"}


def test_of_trackers_without_number_the_longest_unheard_are_forgotten() -> None:
    whereabouts = ObjectPositions()
    for number in range(10 * MAX_TRACKERS):
        whereabouts.update(f"x{number}", listing(on_strip(f"x{number}", 9.0)))
        whereabouts.update("ours", listing(on_strip("a", 1.0)))
    assert under(whereabouts, cursor(1.0)) == "a"
    assert len(whereabouts.objects) == MAX_TRACKERS


def test_a_silent_trackers_objects_cannot_be_hovered() -> None:
    whereabouts = ObjectPositions(stale_after_s=1.0, ended_after_s=5.0)
    whereabouts.update("one", listing(on_strip("a", 1.0)))
    assert under(whereabouts, cursor(1.0, stamp_ns=2 * S)) == "a"
    assert whereabouts.silent(2 * S) == []
    assert under(whereabouts, cursor(1.0, stamp_ns=2 * S + 1)) is None
    assert whereabouts.silent(2 * S + 1) == ["one"]
    assert not whereabouts.forget(6 * S)
    assert {o.id: o.kind for o in whereabouts.objects.values()} == {"a": "red"}
    assert whereabouts.forget(6 * S + 1)
    assert not whereabouts.objects
    assert whereabouts.silent(6 * S + 1) == []


def test_objects_are_hovered_where_they_are_displayed_which_is_where_they_were() -> None:
    whereabouts = ObjectPositions(margin_m=0.0, display_lag_s=0.5)
    whereabouts.update("one", listing(on_strip("a", 2.0, speed_mps=1.0)))
    assert under(whereabouts, cursor(1.5)) == "a"
    assert under(whereabouts, cursor(2.5)) is None
