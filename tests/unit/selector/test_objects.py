"""Objects seen along a ray or under a cursor: angles, positions at its time, occlusion, several trackers."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.schemas import Belt, Cursor, Environment, TrackedObject, TrackedObjects
from pointit.services.selector.object_positions import MAX_TRACKERS, ObjectPositions
from pointit.services.selector.seen_objects import SeenObjects, View
from tests.support import there
from tests.unit.selector.room import EYES, MAP, at, cursor_on_strip, on_strip, package, packages, pointing

SNAP = math.radians(1.5)


def scene(*objects: TrackedObject, time_s: float = 0.0) -> SeenObjects:
    made = SeenObjects(aim="ray")
    made.on_map(MAP)
    made.update("conveyor", packages(time_s, *objects))
    return made


def look(looked: SeenObjects, cursor: Cursor) -> View:
    return there(looked.view_from(cursor))


def picked(looked: SeenObjects, cursor: Cursor, kept: str | None = None) -> str | None:
    return look(looked, cursor).pick(kept, SNAP, 0.3)


def half_width(x_m: float, length_m: float) -> float:
    """Return the half width at the eyes by looking at its two ends, for small objects."""
    ends = [vector.subtract((x_m + side * length_m / 2, 0.0, 0.9), EYES) for side in (-1, 1)]
    return vector.angle_between(*ends) / 2.0


@given(st.floats(1.0, 9.0), st.floats(0.05, 0.5), st.floats(0, 12))
def test_object_is_picked_within_half_width_and_snap_angle(
    x_m: float, length_m: float, raised_deg: float
) -> None:
    limit = half_width(x_m, length_m) + SNAP
    raised = math.radians(raised_deg)
    expected = "a" if raised <= limit else None
    if abs(raised - limit) > 0.003:  # the width is that of a flat angle
        assert (
            picked(scene(package("a", x_m, length_m=length_m)), pointing(0, x_m, raised_rad=raised))
            == expected
        )


def test_object_along_the_line_of_sight_is_narrow() -> None:
    belt = Belt(id="g", line_m=((0.0, 0.0, 0.9), (10.0, 0.0, 0.9)))
    looked = SeenObjects(aim="ray")
    looked.on_map(Environment(stamp_ns=0, name="room", belts=(belt,)))
    looked.update("conveyor", packages(0, package("a", 5.0, length_m=1.0)))
    behind = pointing(0, 5.0, eyes=(0.0, 0.0, 1.6), raised_rad=math.radians(3.0))
    assert picked(looked, behind) is None  # across, half a metre at 5 m would be 5.7 degrees
    across = pointing(0, 5.0, eyes=(5.0, -5.0, 1.6), raised_rad=math.radians(3.0))
    assert picked(looked, across) == "a"


@pytest.mark.parametrize(("share", "expected"), [(0.45, "a"), (0.58, "a"), (0.60, "b")])
def test_hovered_object_is_kept_until_another_is_30_percent_closer(share: float, expected: str) -> None:
    # of the way from a to b; at 0.588 b's angle is 0.7 of a's
    looked = scene(package("a", 5.0), package("b", 5.2))
    x_m = 5.0 + share * 0.2
    assert picked(looked, pointing(0, x_m), kept="a") == expected
    assert picked(looked, pointing(0, x_m)) == ("a" if share < 0.5 else "b")


@given(st.floats(-2, 2), st.floats(-0.9, 0.9))
def test_objects_are_placed_at_the_time_of_the_ray(speed_mps: float, age_s: float) -> None:
    looked = scene(package("a", 5.0, speed_mps=speed_mps))
    shown_m = 5.0 + speed_mps * age_s
    view = look(looked, pointing(age_s, shown_m))
    assert view.pick(None, 1e-4, 0.3) == "a"
    assert view.confidence("a", 0.001) == 1.0
    assert picked(looked, pointing(age_s, shown_m + 0.6)) is None


@given(st.floats(0.2, 2.5), st.floats(-1.0, 1.0), st.floats(-0.9, 0.9))
def test_objects_follow_a_curved_line(position_m: float, speed_mps: float, age_s: float) -> None:
    arc = tuple((math.cos(a / 20), math.sin(a / 20), 0.9) for a in range(60))
    line = Polyline(arc)
    looked = SeenObjects()
    looked.on_map(Environment(stamp_ns=0, name="arc", belts=(Belt(id="g", line_m=arc),)))
    carried = vector.add(line.point_at(position_m), (0.0, 0.0, 0.2))  # its centre is above the belt
    tracked = package("a", position_m, speed_mps=speed_mps).model_copy(update={"position_m": carried})
    looked.update("conveyor", packages(0, tracked))
    reached_m = position_m + speed_mps * age_s
    if not 0.0 < reached_m < line.length_m:
        return
    expected = vector.add(line.point_at(reached_m), (0.0, 0.0, 0.2))
    eyes = (3.0, -1.0, 1.6)
    direction = vector.normalized(vector.subtract(expected, eyes))

    view = look(looked, Cursor(stamp_ns=at(age_s), origin_m=eyes, direction=direction))
    seen = there(view.snapped("a", Cursor(stamp_ns=at(age_s), origin_m=eyes, direction=direction), SNAP))
    # nearest to a ray through its centre is that centre; a short way on an arc is taken to be straight, so
    # that the ray passes it by a little, by more along the arc where that is seen aslant
    passed_rad = vector.angle_between(direction, vector.subtract(seen[0], eyes))
    assert passed_rad * vector.norm(vector.subtract(expected, eyes)) < 0.00125
    assert vector.norm(vector.subtract(seen[0], expected)) < 0.01


def test_objects_have_the_age_of_their_trackers_list() -> None:
    looked = scene(package("a", 4.0, speed_mps=1.0))
    looked.update("other", packages(0.4, package("b", 7.0, speed_mps=-1.0)))
    assert picked(looked, pointing(0.5, 4.5)) == "a"
    assert picked(looked, pointing(0.5, 6.9)) == "b"
    assert picked(looked, pointing(1.2, 5.2)) is None  # the first is stale
    assert picked(looked, pointing(1.2, 6.2)) == "b"
    looked.forget("other")
    assert picked(looked, pointing(0.5, 6.9)) is None


@pytest.mark.parametrize(("solid", "expected"), [("box", None), ("plane", "a"), ("", "a")])
def test_opaque_solid_hides_objects_behind_it(solid: str, expected: str | None) -> None:
    cursor = pointing(0, 5.0).model_copy(update={"surface": "none", "solid": solid, "range_m": 1.0})
    assert picked(scene(package("a", 5.0)), cursor) == expected


@given(st.floats(-1.0, 1.0), st.floats(0.05, 0.6))
def test_snapped_cursor_touches_the_object_within_the_limit(beside_m: float, length_m: float) -> None:
    cursor = pointing(0, 5.0 + beside_m)
    view = look(scene(package("a", 5.0, length_m=length_m)), cursor)
    snapped = view.snapped("a", cursor, SNAP)
    if abs(beside_m) <= length_m / 2:
        assert snapped is None
    elif snapped is not None:
        point_m, position_m = snapped
        assert position_m == pytest.approx(5.0 + math.copysign(length_m / 2, beside_m))
        moved = vector.angle_between(cursor.direction or EYES, vector.subtract(point_m, EYES))
        assert moved <= SNAP + 1e-9
    else:
        end_m = 5.0 + math.copysign(length_m / 2, beside_m)
        end = vector.subtract((end_m, 0.0, 0.9), EYES)
        assert vector.angle_between(cursor.direction or EYES, end) > SNAP - 1e-9


def test_snapped_cursor_is_on_a_nearby_object_despite_a_miss() -> None:
    cursor = pointing(0, 5.0, raised_rad=0.02).model_copy(update={"surface": "none", "point_m": None})
    view = look(scene(package("a", 5.0)), cursor)
    snapped = there(view.snapped("a", cursor, SNAP))
    assert snapped[0] == pytest.approx((5.0, 0.0, 0.9), abs=0.02)
    assert snapped[1] is None
    assert view.snapped("a", cursor, 0.01) is None


def test_confidence_is_shared_among_near_objects() -> None:
    view = look(scene(package("a", 4.9), package("b", 5.1)), pointing(0, 5.0))
    assert view.confidence("a", 0.026) == pytest.approx(0.5)
    nearer = there(look(scene(package("a", 4.9), package("b", 5.1)), pointing(0, 4.9)).confidence("a", 0.026))
    assert 0.6 < nearer < 1.0
    assert look(scene(package("a", 5.0)), pointing(0, 5.0)).confidence("a", 0.026) == 1.0


def test_relative_rate_is_zero_when_the_ray_follows_the_object() -> None:
    view = look(scene(package("a", 5.0, speed_mps=1.0)), pointing(0, 5.0))
    range_m = vector.norm(vector.subtract((5.0, 0.0, 0.9), EYES))
    following = -1.0 / range_m  # along x is to the right of who looks along y: towards less azimuth
    assert view.relative_rate("a", (following, 0.0)) == pytest.approx(0.0, abs=1e-6)
    assert view.relative_rate("a", (0.0, 0.0)) == pytest.approx(1.0 / range_m)


@given(st.floats(-12, 12), st.floats(-0.1, 0.1))
def test_shown_cursor_counts_however_far_the_ray_passes_the_line(raised_deg: float, beside_m: float) -> None:
    """Nothing shows an error across a line: simulated people miss a strip by 4.8 degrees in the median."""
    looked = SeenObjects()
    looked.on_map(MAP)
    looked.update("conveyor", packages(0, package("a", 5.0), package("b", 5.6)))
    cursor = pointing(0, 5.0 + beside_m, raised_rad=math.radians(raised_deg))
    assert picked(looked, cursor) == "a"
    off_the_line = cursor.model_copy(update={"surface": "none", "point_m": None})
    expected = "a" if abs(raised_deg) < 3.5 else None
    if abs(abs(raised_deg) - 4.0) > 0.6:
        assert picked(looked, off_the_line) == expected  # where there is no cursor the ray itself counts
    miss = there(look(looked, cursor).miss_rad("a", cursor))
    assert (
        miss >= math.radians(abs(raised_deg)) - half_width(5.0, 0.3) - 1e-3
    )  # of the ray, whatever is shown


S = 1_000_000_000


def listing(*objects: TrackedObject, stamp_ns: int = S) -> TrackedObjects:
    return TrackedObjects(stamp_ns=stamp_ns, objects=objects)


def cursor(position_m: float, *, stamp_ns: int = S, strip: str = "0") -> Cursor:
    return cursor_on_strip(stamp_ns, position_m, strip)


def under(whereabouts: ObjectPositions, at: Cursor) -> str | None:
    found = whereabouts.hit_test(at)
    return None if found is None else found.id


def test_hit_test_ignores_other_surfaces() -> None:
    whereabouts = ObjectPositions()
    whereabouts.update("one", listing(on_strip("a", 1.0, strip="1")))
    assert under(whereabouts, cursor(1.0)) is None
    assert under(whereabouts, cursor(1.0, strip="1")) == "a"
    assert under(whereabouts, Cursor(stamp_ns=S)) is None
    belt = Cursor(stamp_ns=S, surface="belt", surface_id="1", point_m=(1.0, 0.0, 0.0), position_m=1.0)
    assert under(whereabouts, belt) is None


@given(st.floats(-2, 2), st.floats(-0.5, 0.5))
def test_hit_test_places_objects_at_the_cursors_time(speed_mps: float, age_s: float) -> None:
    whereabouts = ObjectPositions(margin_m=0.0)
    whereabouts.update("one", listing(on_strip("a", 2.0, speed_mps=speed_mps, length_m=0.02)))
    stamp_ns = S + round(age_s * S)
    assert under(whereabouts, cursor(2.0 + speed_mps * age_s, stamp_ns=stamp_ns)) == "a"
    assert under(whereabouts, cursor(2.0 + speed_mps * age_s + 0.02, stamp_ns=stamp_ns)) is None


@given(st.lists(st.floats(0, 5), min_size=1, max_size=30), st.floats(0, 5))
def test_hit_test_finds_the_nearest_object_within_its_reach(positions_m: list[float], at_m: float) -> None:
    whereabouts = ObjectPositions(margin_m=0.05)
    whereabouts.update("one", listing(*(on_strip(str(i), p) for i, p in enumerate(positions_m))))
    gaps = {str(i): abs(p - at_m) for i, p in enumerate(positions_m)}
    best = min(gaps, key=lambda object_id: gaps[object_id])
    assert under(whereabouts, cursor(at_m)) == (best if gaps[best] <= 0.3 / 2 + 0.05 else None)


def test_hit_test_of_free_objects_is_by_distance() -> None:
    robot = TrackedObject(
        id="robot", kind="robot", position_m=(1.0, 0.3, 0.9), velocity_mps=(0.0, -0.5, 0.0), length_m=0.2
    )
    whereabouts = ObjectPositions(margin_m=0.05)
    whereabouts.update("one", listing(robot))
    assert under(whereabouts, cursor(1.0)) is None
    assert under(whereabouts, cursor(1.0, stamp_ns=S + S // 2)) == "robot"
    assert under(whereabouts, Cursor(stamp_ns=S + S // 2)) is None


def test_nearest_object_of_all_trackers_is_hit() -> None:
    whereabouts = ObjectPositions(margin_m=0.3)
    whereabouts.update("one", listing(on_strip("a", 1.0)))
    whereabouts.update("two", listing(on_strip("b", 1.2)))
    assert under(whereabouts, cursor(1.15)) == "b"
    assert under(whereabouts, cursor(1.05)) == "a"
    whereabouts.update("two", listing())
    assert under(whereabouts, cursor(1.15)) == "a"
    assert {o.id: o.kind for o in whereabouts.objects.values()} == {"a": "red"}


def test_longest_silent_trackers_are_forgotten_above_the_limit() -> None:
    whereabouts = ObjectPositions()
    for number in range(10 * MAX_TRACKERS):
        whereabouts.update(f"x{number}", listing(on_strip(f"x{number}", 9.0)))
        whereabouts.update("ours", listing(on_strip("a", 1.0)))
    assert under(whereabouts, cursor(1.0)) == "a"
    assert len(whereabouts.objects) == MAX_TRACKERS


def test_objects_of_a_silent_tracker_cannot_be_hovered() -> None:
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
