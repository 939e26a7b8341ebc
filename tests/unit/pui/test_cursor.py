"""Cursors, misses, and whatever messages come."""

import math
from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.polyline import Hit, Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    FARTHEST,
    NS_PER_S,
    Belt,
    Box,
    Cursor,
    Cylinder,
    Environment,
    Feedback,
    Interaction,
    Lamp,
    Plane,
    PointingRay,
    SetWorkspace,
    Sphere,
    Strip,
    UserPose,
)
from pointit.schemas.topics import FEEDBACK
from pointit.services.pui.cursor import NearbyLamps, PersonCursor
from pointit.services.pui.passing import AGAIN_NS, PASSING_TIMEOUT_NS, Passing
from pointit.services.pui.surfaces import ALL_KINDS, Kind, Surface, Surfaces
from pointit.services.pui.tracked_objects import Tracked
from tests.support import there
from tests.unit.pui.room import EYES, LAB, S, pose_at, ray_to, room
from tests.unit.schemas.strategies import messages


def on_strip(number: int, position_m: float) -> Vec3:
    return Polyline(LAB.strips[number].line_m).point_at(position_m)


@given(
    number=st.integers(0, 1),
    position_m=st.floats(0.05, 4.95),
    stand=st.tuples(st.floats(-2, 4), st.floats(-3, 3), st.floats(-0.2, 0.5)),
    yaw_rad=st.floats(-math.pi, math.pi),
)
def test_pointing_at_a_strip_puts_the_cursor_there(
    number: int, position_m: float, stand: Vec3, yaw_rad: float
) -> None:
    pose = pose_at(stand, yaw_rad)
    person = PersonCursor(Surfaces(LAB))
    person.set_pose(pose)
    target = on_strip(number, position_m)
    cursor = there(person.cursor(ray_to(target, pose, stamp_ns=5)))
    assert (cursor.surface, cursor.stamp_ns) == ("strip", 5)
    assert cursor.point_m is not None
    eyes = vector.add(pose.position_m, EYES)
    assert vector.angle_between(vector.subtract(target, eyes), vector.subtract(cursor.point_m, eyes)) < 1e-6
    if cursor.surface_id == LAB.strips[number].id:
        assert cursor.position_m == pytest.approx(position_m, abs=1e-4)


def test_ending_clears_one_cursor_once_and_never_with_older_stamps() -> None:
    person = PersonCursor(Surfaces(LAB))
    assert person.set_interaction(Interaction(stamp_ns=0, state="pointing")) is None
    person.set_pose(pose_at())
    assert person.cursor(ray_to(on_strip(0, 1.0), pose_at(), stamp_ns=50)) is not None
    ended = there(person.set_interaction(Interaction(stamp_ns=20, state="idle")))
    assert (ended.surface, ended.point_m, ended.stamp_ns) == ("none", None, 50)
    assert person.set_interaction(Interaction(stamp_ns=0, state="localizing")) is None
    assert person.clear(60) is None
    assert person.cursor(ray_to(on_strip(0, 1.0), pose_at())) is None


@given(st.integers(0, 1), st.floats(0.05, 4.95), st.floats(math.radians(-15), math.radians(15)))
def test_rays_at_the_estimated_pose_hit_their_target(number: int, position_m: float, bias_rad: float) -> None:
    target = on_strip(number, position_m)
    person = PersonCursor(Surfaces(LAB, ["strip"]))
    person.set_pose(pose_at(bias_rad=bias_rad))
    cursor = there(person.cursor(ray_to(target, pose_at(), bias_rad=bias_rad)))
    assert cursor.miss_rad < 1e-6


@pytest.mark.parametrize("bias_rad", [1e6, -1e6, math.pi, -3.0])
@pytest.mark.parametrize("elevation_rad", [-math.pi / 2, -1.0, 0.0, 1.5, math.pi / 2])
def test_no_bias_turns_a_ray_over(bias_rad: float, elevation_rad: float) -> None:
    cast: list[Vec3] = []

    class Spy(Surfaces):
        def hit_test(self, origin_m: Vec3, direction: Vec3) -> None:
            assert origin_m[2] == EYES[2]
            cast.append(direction)

    person = PersonCursor(Spy(LAB))
    person.set_pose(pose_at((1.0, 0.5, 0.0), 0.0, bias_rad))
    person.cursor(PointingRay(stamp_ns=0, origin_m=EYES, direction=vector.direction(0.4, elevation_rad)))
    (direction,) = cast
    assert vector.norm(direction) == pytest.approx(1.0)
    assert direction[0] >= -1e-9  # still ahead
    moved = abs(vector.elevation(direction) - elevation_rad)
    assert moved <= math.radians(45.0) + 1e-9


def test_newer_of_two_pose_sources_counts_while_both_report() -> None:
    surfaces = Surfaces(LAB)
    person = PersonCursor(surfaces)

    def x_m() -> float:
        seen = there(person.cursor(ray_to(on_strip(1, 2.5), pose_at())))
        assert seen.point_m is not None
        return round(seen.point_m[0], 6)

    person.set_pose(pose_at((1.0, 0.5, 0.0), stamp_ns=5 * S), now_ns=10 * S)
    tracker = x_m()
    person.set_pose(pose_at((2.0, 0.5, 0.0), stamp_ns=4 * S), now_ns=11 * S)
    assert x_m() == tracker
    person.set_pose(pose_at((2.0, 0.5, 0.0), stamp_ns=6 * S), now_ns=11 * S)
    assert x_m() != tracker
    person.set_pose(
        pose_at((1.0, 0.5, 0.0), stamp_ns=3 * S), now_ns=14 * S
    )  # the other is silent: its clock was ahead
    assert x_m() == tracker


STEP_NS = NS_PER_S // 50
STRIP = Environment(
    stamp_ns=0, name="one", strips=(Strip(id="s", line_m=((3.0, 1.0, 1.64), (3.0, -1.0, 1.64)), pixels=9),)
)
"""At the eyes' height, 3 m ahead."""
TABLE = SetWorkspace(kind="horizontal", anchor="point", point_m=(1.0, 0.0, 0.0))


def aimed(azimuth_deg: float, elevation_deg: float, stamp_ns: int = 0) -> PointingRay:
    direction = vector.direction(math.radians(azimuth_deg), math.radians(elevation_deg))
    return PointingRay(stamp_ns=stamp_ns, origin_m=EYES, direction=direction)


def person(environment: Environment = STRIP) -> PersonCursor:
    someone = PersonCursor(Surfaces(environment, ["strip", "lamp"]))
    someone.set_pose(UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
    return someone


def shown(someone: PersonCursor, ray: PointingRay) -> Cursor:
    return there(someone.cursor(ray))


@given(azimuth_deg=st.floats(-170, 170), elevation_deg=st.floats(-50, 80))
def test_turning_as_told_meets_the_point(azimuth_deg: float, elevation_deg: float) -> None:
    cursor = shown(person(), aimed(azimuth_deg, elevation_deg))
    assert (cursor.passed is None) == (cursor.surface != "none")
    if cursor.passed is None:
        return
    passed = cursor.passed
    direction = there(cursor.direction)
    turned = vector.direction(
        vector.azimuth(direction) - passed.right_rad, vector.elevation(direction) + passed.up_rad
    )
    to = vector.subtract(passed.point_m, EYES)
    assert vector.angle_between(turned, to) < 1e-6
    assert (passed.surface, passed.surface_id) == ("strip", "s")
    ends = [vector.angle_between(direction, vector.subtract(end, EYES)) for end in STRIP.strips[0].line_m]
    assert vector.angle_between(direction, to) <= min(ends) + 1e-9


def test_nearest_by_angle_is_named_whatever_its_priority() -> None:
    both = STRIP.model_copy(update={"lamps": (Lamp(id="l", position_m=(0.0, 3.0, 1.64)),)})
    near_lamp = there(shown(person(both), aimed(70.0, 0.0)).passed)
    near_strip = there(shown(person(both), aimed(35.0, 0.0)).passed)
    assert (near_lamp.surface, near_strip.surface) == ("lamp", "strip")
    assert near_strip.position_m == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("azimuth_deg", "elevation_deg", "text"),
    [
        (0.0, -26.0, "you point 25° below strip s: raise your arm"),
        (0.0, 13.0, "you point 15° above strip s: lower your arm"),
        (48.0, 0.0, "you point 30° to the left of strip s: turn right"),
        (-48.0, 5.0, "you point 30° to the right of strip s: turn left"),
        (170.0, 0.0, "strip s is behind you: turn around by your right"),
    ],
)
def test_text_says_where_after_a_while(azimuth_deg: float, elevation_deg: float, text: str) -> None:
    someone = person()
    texts: list[tuple[int, str]] = []
    for stamp_ns in range(0, 2 * NS_PER_S, STEP_NS):
        passed = there(shown(someone, aimed(azimuth_deg, elevation_deg, stamp_ns)).passed)
        texts.append((stamp_ns, passed.text))
    assert all(said == "" for stamp_ns, said in texts if stamp_ns < PASSING_TIMEOUT_NS)
    assert texts[-1][1] == text


def test_cue_comes_after_a_while_and_then_pauses_longer() -> None:
    someone = person()
    cued_ns: list[int] = []
    for stamp_ns in range(0, 16 * NS_PER_S, STEP_NS):
        someone.cursor(aimed(0.0, -20.0, stamp_ns))
        if (cue := someone.cue()) is not None:
            assert cue.stamp_ns == stamp_ns
            assert cue.turn_rad == pytest.approx((0.0, math.radians(20.0)), abs=1e-6)
            cued_ns.append(stamp_ns)
    assert cued_ns[0] == pytest.approx(PASSING_TIMEOUT_NS, abs=NS_PER_S // 5)
    assert len(cued_ns) == 3
    assert all(after - before >= AGAIN_NS for before, after in pairwise(cued_ns))


def test_sweeping_past_and_a_resting_arm_are_not_told() -> None:
    someone = person()
    for stamp_ns in range(0, 20 * NS_PER_S, STEP_NS):
        is_past = stamp_ns % (2 * NS_PER_S) < NS_PER_S
        someone.cursor(aimed(0.0, -20.0 if is_past else 0.0, stamp_ns))
        assert someone.cue() is None
    for stamp_ns in range(20 * NS_PER_S, 40 * NS_PER_S, STEP_NS):
        assert shown(someone, aimed(0.0, -60.0, stamp_ns)).passed is None
        assert someone.cue() is None


def test_time_of_misses_starts_over_after_a_pause_in_pointing() -> None:
    someone = person()
    for stamp_ns in range(0, NS_PER_S, STEP_NS):
        someone.cursor(aimed(0.0, -20.0, stamp_ns))
    someone.set_interaction(Interaction(stamp_ns=NS_PER_S, state="idle"))
    someone.set_interaction(Interaction(stamp_ns=NS_PER_S, state="pointing"))
    for stamp_ns in range(NS_PER_S, 2 * NS_PER_S, STEP_NS):
        someone.cursor(aimed(0.0, -20.0, stamp_ns))
        assert someone.cue() is None


def cues_of(someone: PersonCursor, from_s: int, to_s: int, elevation_deg: float = -20.0) -> list[Feedback]:
    """Return the cues while they point to the left of the strip from one second until another."""
    cues: list[Feedback] = []
    for stamp_ns in range(from_s * NS_PER_S, to_s * NS_PER_S, STEP_NS):
        passed = shown(someone, aimed(40.0, elevation_deg, stamp_ns)).passed
        if (cue := someone.cue()) is not None:
            assert cue.turn_rad == (there(passed).right_rad, there(passed).up_rad)
            cues.append(cue)
    return cues


def test_cues_come_again_when_the_clock_was_set_back() -> None:
    someone = person()
    assert len(cues_of(someone, 100, 102)) == 1
    assert not cues_of(someone, 50, 51)
    assert len(cues_of(someone, 51, 52)) == 1


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_thing_across_the_half_turn_is_beside_the_ray(side: float) -> None:
    passing = Passing(Placed(vector.direction(math.radians(-179.0 * side), 0.0)))
    ray = vector.direction(math.radians(179.0 * side), 0.0)
    passing.miss((0.0, 0.0, 0.0), ray, 0)
    passed = there(passing.miss((0.0, 0.0, 0.0), ray, PASSING_TIMEOUT_NS))
    assert passed.right_rad == pytest.approx(math.radians(-2.0 * side))
    turn, here = ("left", "right") if side > 0.0 else ("right", "left")
    assert passed.text == f"you point 5° to the {here} of lamp l: turn {turn}"


def test_a_hidden_thing_is_not_passed() -> None:
    wall = Box(id="wall", center_m=(1.5, 0.0, 1.64), size_m=(0.1, 1.0, 1.0))
    someone = person(STRIP.model_copy(update={"boxes": (wall,)}))
    cursor = shown(someone, aimed(0.0, 0.0))
    assert (cursor.surface, cursor.passed) == ("none", None)


def aims_past(someone: PersonCursor, begin_ns: int, end_ns: int) -> int:
    cues = 0
    for stamp_ns in range(begin_ns, end_ns, STEP_NS):
        someone.cursor(aimed(0.0, 30.0, stamp_ns))
        cues += someone.cue() is not None
    return cues


def test_on_a_workspace_nothing_more_is_told_of_the_map() -> None:
    someone = person()
    assert aims_past(someone, 0, 2 * NS_PER_S) == 1
    someone.set_workspace(TABLE, Tracked(STRIP))
    assert aims_past(someone, 2 * NS_PER_S, 20 * NS_PER_S) == 0
    someone.set_workspace(SetWorkspace(kind="none"), Tracked(STRIP))
    assert someone.cue() is None
    assert aims_past(someone, 20 * NS_PER_S, 20 * NS_PER_S + PASSING_TIMEOUT_NS) == 0
    assert aims_past(someone, 20 * NS_PER_S + PASSING_TIMEOUT_NS, 22 * NS_PER_S) == 1


class Placed:
    """A single thing, ahead or at `point_m`."""

    def __init__(self, point_m: Vec3 = (1.0, 0.0, 0.0)) -> None:
        self._point_m = point_m

    def nearest(self, _origin_m: Vec3, _direction: Vec3) -> tuple[Surface, Hit]:
        return Surface("lamp", "l"), Hit(0, 0.0, self._point_m, 1.0, 1.0, 1.0)


async def test_the_service_publishes_the_cue() -> None:
    async with room() as here:
        cues = here.bench.collect(FEEDBACK)
        await here.pose()
        cursors = [await here.point(vector.direction(0.0, math.radians(40.0))) for _ in range(101)]
        passed = there(cursors[-1].passed)
        assert [cue.text for cue in cues] == [passed.text]
        assert "lower your arm" in passed.text
        assert (cues[0].cue, cues[0].target_id) == ("target", passed.surface_id)


def miss(someone: PersonCursor, from_s: float, to_s: float) -> str:
    for stamp_ns in range(int(from_s * NS_PER_S), int(to_s * NS_PER_S), STEP_NS):
        someone.cursor(aimed(0.0, -20.0, stamp_ns))
    return someone.passing.hint


def test_hint_follows_a_minute_of_misses_until_a_hit() -> None:
    someone = person()
    assert miss(someone, 0.0, 59.0) == ""
    assert miss(someone, 59.0, 61.0) == "you point 20° below strip s: raise your arm"
    someone.cursor(aimed(0.0, 0.0, 62 * NS_PER_S))
    assert someone.passing.hint == ""
    assert miss(someone, 62.0, 120.0) == ""


def test_a_resting_arm_is_no_miss() -> None:
    someone = person()
    miss(someone, 0.0, 50.0)
    for stamp_ns in range(50 * NS_PER_S, 200 * NS_PER_S, STEP_NS):
        someone.cursor(aimed(0.0, -60.0, stamp_ns))
    assert someone.passing.hint == ""
    assert miss(someone, 200.0, 205.0) == ""
    assert miss(someone, 205.0, 215.0) != ""


DIAGONAL = (3**-0.5, 3**-0.5, 3**-0.5)
far = st.one_of(st.floats(-5.0, 5.0), st.floats(-FARTHEST, FARTHEST), st.sampled_from([-FARTHEST, FARTHEST]))
to_mm = far.map(lambda value: round(value, 3))
places = st.tuples(to_mm, to_mm, to_mm)
lines = st.lists(places, min_size=2, max_size=3, unique=True)


def room_with(place: Vec3, line: list[Vec3], size: float) -> Environment:
    return Environment(
        stamp_ns=0,
        name="room",
        lamps=(Lamp(id="lamp", position_m=place),),
        strips=(Strip(id="strip", line_m=tuple(line), pixels=10),),
        belts=(Belt(id="belt", line_m=tuple(line[::-1])),),
        boxes=(Box(id="box", center_m=place, size_m=(size, size, size)),),
        planes=(Plane(id="floor", center_m=place, normal=(0.0, 0.0, 1.0)),),
        cylinders=(Cylinder(id="column", center_m=line[0], radius_m=size, height_m=size),),
        spheres=(Sphere(id="ball", center_m=line[0], radius_m=size),),
    )


rooms = st.builds(room_with, places, lines, st.sampled_from([0.01, 1.0, FARTHEST]))


@given(
    rooms,
    messages(UserPose),
    st.lists(messages(PointingRay), min_size=1, max_size=3),
    st.sampled_from([0.2, 3.0]),
    st.sets(st.sampled_from([kind for kind in ALL_KINDS if kind != "points"]), min_size=1),
)
@example(  # the nearest thing reaches beyond what can be told
    room_with((0.0, FARTHEST, 0.0), [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)], 1.0),
    UserPose(stamp_ns=0, position_m=(0.0, 0.0, 1.0), yaw_rad=1.0),
    [PointingRay(stamp_ns=0, origin_m=(0.0, 0.0, 0.0), direction=DIAGONAL)],
    0.2,
    {"box", "strip"},
)
def test_any_room_pose_and_rays_give_valid_cursors(
    room: Environment, pose: UserPose, rays: list[PointingRay], tolerance_rad: float, kinds: set[Kind]
) -> None:
    surfaces = Surfaces(room, sorted(kinds), tolerance_rad=tolerance_rad)
    person = PersonCursor(surfaces, lamps=NearbyLamps(room.lamps, 1.0))
    person.set_pose(pose)
    for ray in rays:
        assert person.cursor(ray) is not None
