"""Surfaces about a person: where they are, that nothing jumps as they are laid, what cannot be laid."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    Cursor,
    Interaction,
    PointingRay,
    SetWorkspace,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Surfaces
from pointit.services.pui.tracked_objects import Tracked
from pointit.services.pui.workspace import Workspace, WorkspaceError, WorkspaceKind, WorkspaceStart
from tests.support import there
from tests.unit.pui.room import EYES, LAB, S

SURFACES = Surfaces(LAB)
KINDS: list[WorkspaceKind] = ["horizontal", "facing", "cylinder", "sphere"]

kinds = st.sampled_from(KINDS)
stands = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-0.2, 0.5))
angles = st.floats(-math.pi, math.pi)


class Person:
    """Somebody with a cursor, who sends rays."""

    def __init__(
        self, feet_m: Vec3 = (0.0, 0.0, 0.0), yaw_rad: float = 0.0, start: WorkspaceStart | None = None
    ) -> None:
        self.core = PersonCursor(SURFACES, start=start or WorkspaceStart())
        self.tracked = Tracked(LAB)
        self.stand(feet_m, yaw_rad)

    def stand(self, feet_m: Vec3, yaw_rad: float = 0.0) -> None:
        self.feet_m = feet_m
        self.yaw_rad = yaw_rad
        self.core.set_pose(UserPose(stamp_ns=0, position_m=feet_m, yaw_rad=yaw_rad))

    @property
    def eyes_m(self) -> Vec3:
        return vector.add(self.feet_m, EYES)

    def point(self, direction: Vec3, stamp_ns: int = 0) -> Cursor:
        turned = vector.rotate_z(direction, -self.yaw_rad)
        return there(self.core.cursor(PointingRay(stamp_ns=stamp_ns, origin_m=EYES, direction=turned)))

    def point_at(self, place: Vec3, stamp_ns: int = 0) -> Cursor:
        return self.point(vector.normalized(vector.subtract(place, self.eyes_m)), stamp_ns)

    def ask(self, kind: WorkspaceKind, **more: object) -> None:
        self.core.set_workspace(SetWorkspace.model_validate({"kind": kind, **more}), self.tracked)


def laid(kind: WorkspaceKind, through: Vec3, feet: Vec3 = (0.0, 0.0, 0.0)) -> Workspace:
    return Workspace(kind, through, feet_m=feet, eyes_m=vector.add(feet, EYES))


# where they are


@given(
    stands, st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(0, 3)), angles, st.floats(-1.5, 1.5),
    kinds,
)  # fmt: skip
def test_cursors_are_on_the_surface(
    feet: Vec3, through: Vec3, azimuth: float, elevation: float, kind: WorkspaceKind
) -> None:
    try:
        workspace = laid(kind, through, feet)
    except WorkspaceError:
        return
    eyes = vector.add(feet, EYES)
    direction = vector.direction(azimuth, elevation)
    hit = workspace.intersect(eyes, direction, feet)
    if hit is None:
        return

    assert hit.miss_rad < 1e-7
    point = hit.point_m
    if kind == "horizontal":
        assert point[2] == pytest.approx(through[2])
    elif kind == "facing":
        away = vector.subtract(through, eyes)
        normal = vector.normalized((away[0], away[1], 0.0))
        assert vector.dot(vector.subtract(point, through), normal) == pytest.approx(0.0, abs=1e-6)
    elif kind == "cylinder":
        radius = math.hypot(through[0] - feet[0], through[1] - feet[1])
        assert math.hypot(point[0] - feet[0], point[1] - feet[1]) == pytest.approx(radius)
    else:
        assert math.dist(point, eyes) == pytest.approx(math.dist(through, eyes))


def test_uv_of_hits_on_each_kind_of_workspace() -> None:
    feet = (1.0, 0.0, 0.2)
    eyes = vector.add(feet, EYES)
    ahead = {kind: laid(kind, (3.0, 0.0, 0.5), feet).intersect(eyes, (1.0, 0.0, 0.0), feet) for kind in KINDS}
    assert ahead["horizontal"] is None  # level: never met
    facing, cylinder, sphere = (there(ahead[kind]) for kind in ("facing", "cylinder", "sphere"))
    assert facing.uv_m == pytest.approx((0.0, 1.34))
    assert cylinder.uv_m == pytest.approx((0.0, 1.64))
    assert sphere.uv_m == pytest.approx((0.0, 0.0))
    left = there(laid("facing", (3.0, 0.0, 0.5), feet).intersect(eyes, vector.direction(0.1, 0.0), feet))
    assert left.uv_m is not None
    assert left.uv_m[0] == pytest.approx(-2.0 * math.tan(0.1))  # u is to the right of a viewer


@pytest.mark.parametrize(("angle_deg", "met"), [(4.9, False), (5.1, True)])
@pytest.mark.parametrize("kind", ["horizontal", "facing", "cylinder"])
def test_a_ray_near_parallel_to_a_workspace_misses(kind: WorkspaceKind, angle_deg: float, met: bool) -> None:
    angle = math.radians(angle_deg)
    direction = vector.direction(0.0, -angle if kind == "horizontal" else angle - math.pi / 2)
    hit = laid(kind, (2.0, 0.0, 0.5)).intersect(EYES, direction, (0.0, 0.0, 0.0))
    assert (hit is not None) is met


def test_facing_plane_stays_and_other_workspaces_move_with_the_person() -> None:
    for kind in KINDS:
        person = Person()
        person.point_at((2.0, 0.0, 0.5))
        person.ask(kind, anchor="point", point_m=(2.0, 0.0, 0.5))
        there(person.point_at((2.0, 0.0, 0.5)).point_m)
        person.stand((1.0, 0.0, 0.0))
        now = there(person.point(vector.normalized(vector.subtract((2.0, 0.0, 0.5), EYES))).point_m)
        # a metre on, but for the upright plane, which the same ray now meets higher
        expected = (2.0, 0.0, 1.64 - 0.57) if kind == "facing" else (3.0, 0.0, 0.5)
        assert now == pytest.approx(expected)


# switching


@settings(max_examples=200)
@given(
    stands,
    angles,
    st.floats(0.3, 4.7),
    st.tuples(st.floats(-8, 8), st.floats(-8, 8)),
    st.lists(kinds, min_size=1, max_size=4),
)
def test_nothing_jumps_when_a_workspace_is_laid_through_the_pointer(
    feet: Vec3, yaw: float, along_m: float, off_deg: tuple[float, float], order: list[WorkspaceKind]
) -> None:
    # pointing beside a strip, to which the cursor is drawn by up to the tolerance; then one after the other
    person = Person(feet, yaw)
    start = LAB.strips[1].line_m[0]
    end = LAB.strips[1].line_m[-1]
    place = vector.add(start, vector.scale(vector.subtract(end, start), along_m / 5.0))
    reach = vector.subtract(place, person.eyes_m)
    direction = vector.direction(
        vector.azimuth(reach) + math.radians(off_deg[0]), vector.elevation(reach) + math.radians(off_deg[1])
    )
    before = person.point(direction)
    for kind in order:
        try:
            person.ask(kind)
        except WorkspaceError:
            after = person.point(direction)
            assert (after.surface_id, after.point_m) == (
                before.surface_id,
                before.point_m,
            )  # the old one stays
            continue
        after = person.point(direction)
        assert before.point_m is not None
        assert after.point_m is not None
        assert math.dist(after.point_m, before.point_m) < 1e-5 * max(1.0, before.range_m)
        assert after.surface_id == f"workspace/{kind}"
        # and goes on smoothly
        turned = vector.direction(vector.azimuth(direction) + 1e-4, vector.elevation(direction))
        soon = person.point(turned)
        if soon.point_m is not None and soon.range_m < 10.0:
            assert math.dist(soon.point_m, after.point_m) < 0.1
        before = person.point(direction)


def test_cursor_states_its_true_ray_and_the_drawn_distance() -> None:
    person = Person()
    strip = LAB.strips[1].line_m[0]
    direction = vector.normalized(
        vector.add(vector.normalized(vector.subtract(strip, EYES)), (0.05, -0.04, 0.06))
    )
    drawn = person.point(direction)
    person.ask("sphere")
    cursor = person.point(direction)
    assert cursor.direction == pytest.approx(direction)
    assert cursor.miss_rad == pytest.approx(drawn.miss_rad)
    assert drawn.miss_rad > 0.05


# objects


def robot(stamp_ns: int, **more: object) -> TrackedObjects:
    fields = {"id": "drone", "kind": "robot", "position_m": (2.0, 1.0, 0.8), **more}
    return TrackedObjects(stamp_ns=stamp_ns, objects=(TrackedObject.model_validate(fields),))


def test_a_package_is_moved_on_round_the_bend() -> None:
    room = LAB.model_copy(
        update={
            "strips": (
                LAB.strips[0].model_copy(
                    update={"id": "l", "line_m": ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 5.0, 1.0))}
                ),
            )
        }
    )
    tracked = Tracked(room)

    package = TrackedObject(
        id="p", kind="red", position_m=(0.5, 0.1, 1.0), velocity_mps=(1.0, 0.0, 0.0),
        surface="strip", surface_id="l", surface_position_m=0.5, surface_speed_mps=1.0,
    )  # fmt: skip
    tracked.on_objects("sim", TrackedObjects(stamp_ns=S, objects=(package,)))
    assert tracked.where("p", 2 * S) == pytest.approx((1.0, 0.6, 1.0))
    assert tracked.where("p", S) == pytest.approx((0.5, 0.1, 1.0))

    slower = package.model_copy(update={"surface_speed_mps": -0.2})
    tracked.on_objects("sim", TrackedObjects(stamp_ns=S, objects=(slower,)))
    assert tracked.where("p", 2 * S) == pytest.approx((0.3, 0.1, 1.0))


def test_newer_of_two_trackers_counts_and_lost_objects_are_gone() -> None:
    tracked = Tracked(LAB)
    tracked.on_objects("a", robot(3 * S))
    tracked.on_objects("b", robot(2 * S, position_m=(9.0, 9.0, 9.0)))
    assert tracked.where("drone", 3 * S) == (2.0, 1.0, 0.8)
    tracked.on_objects("a", TrackedObjects(stamp_ns=4 * S))
    tracked.on_objects("b", TrackedObjects(stamp_ns=4 * S))
    with pytest.raises(WorkspaceError, match="no object 'drone' is known"):
        tracked.where("drone", 4 * S)


# refusals


def test_impossible_workspace_is_refused_and_changes_nothing() -> None:
    person = Person()
    with pytest.raises(WorkspaceError, match="no ray has come"):
        person.ask("sphere")

    person.point((0.0, 0.0, 1.0))
    with pytest.raises(WorkspaceError, match="no cursor now"):
        person.ask("sphere")
    with pytest.raises(WorkspaceError, match="no object 'drone' is known"):
        person.ask("sphere", anchor="object", object_id="drone")

    person.tracked.on_objects("sim", robot(10 * S))
    person.point((0.0, 0.0, 1.0), stamp_ns=13 * S)
    with pytest.raises(WorkspaceError, match=r"last seen 3\.0 s ago"):
        person.ask("sphere", anchor="object", object_id="drone")
    with pytest.raises(WorkspaceError, match="give point_m"):
        person.ask("sphere", anchor="point")
    with pytest.raises(WorkspaceError, match="pass within"):
        person.ask("horizontal", anchor="point", point_m=(2.0, 0.0, 1.65))
    with pytest.raises(WorkspaceError, match="pass within"):
        person.ask("cylinder", anchor="point", point_m=(0.0, 0.05, 0.0))
    with pytest.raises(WorkspaceError, match="more than 200 m"):
        person.ask("sphere", anchor="point", point_m=(2000.0, 0.0, 0.0))
    assert person.point((0.0, 0.0, 1.0)).solid == ""

    nobody = PersonCursor(SURFACES)
    with pytest.raises(WorkspaceError, match="no pose is known"):
        nobody.set_workspace(SetWorkspace(kind="sphere"), Tracked(LAB))


def test_tracker_with_clock_ahead_is_no_anchor_and_hides_none() -> None:
    person = Person()
    person.point((0.0, 0.0, 1.0), stamp_ns=10 * S)
    person.tracked.on_objects("ahead", robot(15 * S))
    with pytest.raises(WorkspaceError, match=r"by a clock 5\.0 s ahead of"):
        person.ask("sphere", anchor="object", object_id="drone")
    person.tracked.on_objects("sim", robot(10 * S))
    person.ask("sphere", anchor="object", object_id="drone")


def test_a_workspace_that_the_ray_would_graze_is_refused() -> None:
    person = Person()
    person.point((1.0, 0.0, 0.0))
    person.ask("sphere", anchor="point", point_m=(4.0, 0.0, 1.64))
    person.point(vector.direction(0.0, -math.radians(3)))  # on the sphere, 0.21 m below the eyes
    with pytest.raises(WorkspaceError, match="too near parallel to a horizontal workspace"):
        person.ask("horizontal")
    assert person.point((1.0, 0.0, 0.0)).solid == "sphere"


# the one to begin with


@pytest.mark.parametrize("kind", KINDS)
def test_the_workspace_to_begin_with_is_laid_anew_each_time(kind: WorkspaceKind) -> None:
    person = Person((1.0, 1.0, 0.1), start=WorkspaceStart(kind=kind, height_m=0.2))
    down = vector.direction(0.7, -0.3)
    first = person.point(down)
    assert first.surface_id == f"workspace/{kind}"
    assert first.point_m is not None

    away = vector.subtract(first.point_m, person.feet_m)
    if kind == "horizontal":
        assert away[2] == pytest.approx(0.2)
    elif kind == "sphere":
        assert first.range_m == pytest.approx(2.0)
    else:
        assert math.hypot(away[0], away[1]) == pytest.approx(2.0)

    person.core.set_interaction(Interaction(stamp_ns=1, state="idle"))
    person.core.set_interaction(Interaction(stamp_ns=2, state="pointing"))
    behind = person.point(vector.rotate_z(down, math.pi))
    assert behind.range_m == pytest.approx(first.range_m)  # the plane faces them again

    person.ask("sphere", anchor="point", point_m=vector.add(person.eyes_m, (0.0, 5.0, 0.0)))
    person.core.set_interaction(Interaction(stamp_ns=3, state="idle"))
    person.core.set_interaction(Interaction(stamp_ns=4, state="pointing"))
    assert person.point(down).range_m == pytest.approx(5.0)  # what was asked for stays

    person.core.set_workspace(SetWorkspace(kind="none"), person.tracked)
    assert person.point(down).solid == ""
    person.core.set_interaction(Interaction(stamp_ns=3, state="idle"))
    person.core.set_interaction(Interaction(stamp_ns=4, state="pointing"))
    assert person.point(down).solid == ""  # what was asked for stays


def test_horizontal_plane_at_eye_height_is_not_laid_at_start() -> None:
    start = WorkspaceStart(kind="horizontal", height_m=1.64)
    assert Person(start=start).point(vector.direction(0.0, -0.3)).solid == ""


def test_workspace_is_not_met_more_than_200_m_away() -> None:
    feet = (0.0, 0.0, 18.36)
    eyes = (0.0, 0.0, 20.0)
    workspace = Workspace("horizontal", (10.0, 0.0, 0.0), feet_m=feet, eyes_m=eyes)
    hit = there(workspace.intersect(eyes, vector.direction(0.0, math.radians(-6.0)), feet))
    assert hit.range_m == pytest.approx(20.0 / math.sin(math.radians(6.0)))
    assert workspace.intersect(eyes, vector.direction(0.0, math.radians(-5.5)), feet) is None
