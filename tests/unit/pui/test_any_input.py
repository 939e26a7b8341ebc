"""Whatever valid messages others put on the bus, a cursor is one that can travel: nobody else checks it."""

from hypothesis import example, given
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.schemas import (
    FARTHEST,
    Belt,
    Box,
    Cylinder,
    Environment,
    Lamp,
    Plane,
    PointingRay,
    Sphere,
    Strip,
    UserPose,
)
from pointit.services.pui.cursor import NearbyLamps, PersonCursor
from pointit.services.pui.surfaces import ALL_KINDS, Kind, Surfaces
from tests.unit.schemas.strategies import messages

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
