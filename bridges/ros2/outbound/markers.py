"""Markers for RViz and Foxglove: the static room once per map, and everything that moves."""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.routing.conversion_state import ConversionState, RosPerson
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation, vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import plane_axes
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Message, RobotState, TrackedObject, UserPose
from pointit.schemas.base import Rgb
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR

Shape = Literal["arrow", "cube", "sphere", "cylinder", "line", "text", "triangles"]
Place = Iterable[float]

MARKER = "visualization_msgs/msg/Marker"
SHAPES: dict[Shape, int] = {
    "arrow": 0,
    "cube": 1,
    "sphere": 2,
    "cylinder": 3,
    "line": 4,
    "text": 9,
    "triangles": 11,
}
"""Constants of the message; a line is a LINE_STRIP, triangles are a TRIANGLE_LIST."""

ADD = 0
DELETE = 2
DELETE_ALL = 3

WHITE: Rgb = (255, 255, 255)
ENDLESS_M = 20.0
"""Drawn size of an infinite plane."""
STRIP_M = 0.02
LAMP_M = 0.1
THIN_M = 0.005

BELT: Rgb = (70, 74, 84)
STRIP: Rgb = (150, 155, 165)
LAMP: Rgb = (255, 240, 200)
SOLID: Rgb = (140, 150, 170)
KEEP_IN: Rgb = (60, 180, 75)
KEEP_OUT: Rgb = (230, 60, 50)
GLASS = 0.35
"""Opacity of solids, so that objects behind them are visible."""

LIFETIME_S = 2.0
"""Lifetime of a marker, s, for viewers that missed its deletion."""

MAX_OBJECTS = 500
"""Maximum number of drawn objects; a label gives the number of others."""

FREE_RAY_M = 4.0
"""Drawn length of a ray that meets nothing."""

RAY_M: Vec3 = (0.012, 0.03, 0.06)
"""Width of the ray's shaft and head, length of the head."""

CURSOR_M = 0.08

NAME_M = 1.95
"""Height of a person's name above their feet."""

SIGMAS = 2.0
"""Size of the position's ellipse, in standard deviations."""

SMALLEST_M = 5e-3
"""An ellipse with a shorter major half-axis is not drawn: the position is known."""

USUAL_M = 0.12
"""Length of an object without one."""

SEGMENT_M = (0.07, 0.06)
"""Width and height of a segment of a strip."""

GROWN_M = 0.05
"""Growth of the box that shows an object's owner."""

HALTED: Rgb = (230, 60, 50)
"""Colour of a robot that a stop condition holds, or that is lost."""

HIGH_M = {"quadrotor": 0.08, "ground": 0.25}
"""Drawn height of a robot by its kind."""

FRONT_M: Vec3 = (0.02, 0.05, 0.06)
"""Width of the shaft and head of the arrow to its front, length of the head."""

PLAN_M = 0.03
SPOT_M = 0.1
LABEL_M = 0.3


class MarkerBuilder:
    """Builds markers with one stamp, in one frame."""

    def __init__(self, context: ConversionContext, lifetime_s: float = 0.0) -> None:
        """Build for the route of `context`; lifetime 0 is for ever."""
        self._types: Types = context.state.types
        self._header = values.header(self._types, context.stamp_ns, context.frame)
        seconds, rest_ns = divmod(round(lifetime_s * NS_PER_S), NS_PER_S)
        self._lifetime = self._types.make("builtin_interfaces/msg/Duration", sec=seconds, nanosec=rest_ns)

    def shape(
        self,
        shape: Shape,
        group: str,
        number: int,
        *,
        size_m: Vec3,
        rgb: Rgb,
        at_m: Vec3 = (0.0, 0.0, 0.0),
        orientation: rotation.Quaternion = rotation.IDENTITY,
        alpha: float = 1.0,
        places_m: Iterable[Vec3] = (),
        words: str = "",
    ) -> Any:
        """Return a marker with namespace `group` and id `number`."""
        types = self._types
        points = [values.point(types, place_m) for place_m in places_m]
        return types.make(
            MARKER,
            header=self._header,
            ns=values.text(group),
            id=number,
            type=SHAPES[shape],
            action=ADD,
            pose=values.pose(types, at_m, orientation),
            scale=values.vector3(types, size_m),
            color=values.color(types, rgb, alpha),
            lifetime=self._lifetime,
            points=points,
            text=values.text(words),
        )

    def label(self, words: str, group: str, number: int, at_m: Vec3, high_m: float = 0.14) -> Any:
        """Return a label that always faces the viewer."""
        size_m = (0.0, 0.0, high_m)
        return self.shape("text", group, number, size_m=size_m, rgb=WHITE, at_m=at_m, words=words)

    def gone(self, group: str, number: int) -> Any:
        """Return a marker that deletes another."""
        return self._types.make(MARKER, header=self._header, ns=group, id=number, action=DELETE)

    def blank(self) -> Any:
        """Return a marker that deletes all markers of the topic."""
        return self._types.make(MARKER, header=self._header, action=DELETE_ALL)

    def array(self, markers: list[Any]) -> Any:
        """Return the message."""
        return self._types.make("visualization_msgs/msg/MarkerArray", markers=markers)


def map_markers(room: Environment, context: ConversionContext) -> Converted:
    """Return the map's markers, after one that deletes the previous map's."""
    markers = MarkerBuilder(context)
    drawn = [markers.blank(), *_room(markers, context.state, room)]
    return (markers.array(drawn),)


def _room(markers: MarkerBuilder, state: ConversionState, room: Environment) -> Iterator[Any]:
    widths_m = {belt.id: belt.width_m for belt in room.belts}
    for number, ((kind, name), line) in enumerate(state.lines.items()):
        if kind == "belt":
            corners_m = ribbon(line, widths_m[name])
            one_m = (1.0, 1.0, 1.0)
            yield markers.shape("triangles", "belts", number, size_m=one_m, rgb=BELT, places_m=corners_m)
        else:
            size_m = (STRIP_M, 0.0, 0.0)
            yield markers.shape("line", "strips", number, size_m=size_m, rgb=STRIP, places_m=_vertices(line))
    for number, lamp in enumerate(room.lamps):
        size_m = (LAMP_M, LAMP_M, LAMP_M)
        yield markers.shape("sphere", "lamps", number, size_m=size_m, rgb=LAMP, at_m=lamp.position_m)
        above_m = vector.add(lamp.position_m, (0.0, 0.0, LAMP_M))
        yield markers.label(lamp.id, "lamps/names", number, above_m, 0.1)
    yield from _fences(markers, room)
    yield from _solids(markers, room)


def _fences(markers: MarkerBuilder, room: Environment) -> Iterator[Any]:
    """Yield the outlines of fences at their lowest and highest place; one without end at the floor only."""
    for number, fence in enumerate(room.fences):
        rgb = KEEP_IN if fence.kind == "keep_in" else KEEP_OUT
        low_m = fence.low_m or 0.0
        high_m = fence.high_m or low_m
        outline_m = (*fence.outline_m, fence.outline_m[0])
        size_m = (STRIP_M, 0.0, 0.0)
        for level, height_m in enumerate(dict.fromkeys((low_m, high_m))):
            corners_m = [(x, y, height_m) for x, y in outline_m]
            group = f"fences/{fence.kind}/{level}"
            yield markers.shape("line", group, number, size_m=size_m, rgb=rgb, places_m=corners_m)
        x, y = fence.outline_m[0]
        above_m = (x, y, max(low_m, high_m) + LAMP_M)
        yield markers.label(fence.id, "fences/names", number, above_m, LAMP_M)


def _solids(markers: MarkerBuilder, room: Environment) -> Iterator[Any]:
    # Boxes, and things of the map, which are boxes with a name
    for number, box in enumerate((*room.boxes, *room.fixed_things)):
        yield markers.shape(
            shape="cube",
            group="boxes",
            number=number,
            size_m=box.size_m,
            rgb=SOLID,
            alpha=GLASS,
            at_m=box.center_m,
            orientation=rotation.from_yaw(box.yaw_rad),
        )
    for number, thing in enumerate(room.fixed_things):
        height_m = thing.size_m[2] / 2.0 + LAMP_M
        above_m = vector.add(thing.center_m, (0.0, 0.0, height_m))
        name = thing.label or thing.id
        yield markers.label(name, "things/names", number, above_m, LAMP_M)

    # Planes, as thin boxes
    for number, plane in enumerate(room.planes):
        u, v = plane_axes(plane.normal)
        wide_m, high_m = plane.size_m or (ENDLESS_M, ENDLESS_M)
        yield markers.shape(
            shape="cube",
            group="planes",
            number=number,
            size_m=(wide_m, high_m, THIN_M),
            rgb=SOLID,
            alpha=GLASS,
            at_m=plane.center_m,
            orientation=_of_axes(u, v),
        )

    # Round solids: the centre of a cylinder is that of its base
    for number, cylinder in enumerate(room.cylinders):
        wide_m = 2.0 * cylinder.radius_m
        size_m = (wide_m, wide_m, cylinder.height_m)
        middle_m = vector.add(cylinder.center_m, (0.0, 0.0, cylinder.height_m / 2.0))
        yield markers.shape(
            "cylinder", "cylinders", number, size_m=size_m, rgb=SOLID, alpha=GLASS, at_m=middle_m
        )
    for number, ball in enumerate(room.spheres):
        wide_m = 2.0 * ball.radius_m
        size_m = (wide_m, wide_m, wide_m)
        yield markers.shape(
            "sphere", "spheres", number, size_m=size_m, rgb=SOLID, alpha=GLASS, at_m=ball.center_m
        )

    # Clouds of points have no shape: their bounding boxes
    for number, cloud in enumerate(room.clouds):
        size_m = vector.subtract(cloud.high_m, cloud.low_m)
        middle_m = vector.scale(vector.add(cloud.low_m, cloud.high_m), 0.5)
        yield markers.shape("cube", "clouds", number, size_m=size_m, rgb=SOLID, alpha=0.1, at_m=middle_m)


def ribbon(line: Polyline, width_m: float) -> list[Vec3]:
    """Return triangles, three corners each, of a level ribbon along `line`, visible from above and below."""
    vertices_m = _vertices(line)
    corners_m: list[Vec3] = []
    for start_m, end_m in pairwise(vertices_m):
        x, y, _ = vector.subtract(end_m, start_m)
        level_m = float(np.hypot(x, y))
        if level_m == 0.0:
            continue
        half = width_m / 2.0 / level_m
        across_m = (-y * half, x * half, 0.0)
        a = vector.add(start_m, across_m)
        b = vector.subtract(start_m, across_m)
        c = vector.add(end_m, across_m)
        d = vector.subtract(end_m, across_m)
        corners_m += [a, b, c, c, b, d]
        corners_m += [a, c, b, c, d, b]  # the other way round: viewers cull the backs of triangles
    return corners_m


def _vertices(line: Polyline) -> list[Vec3]:
    vertices_m = line.vertices_m.tolist()
    return [(x, y, z) for x, y, z in vertices_m]


def _of_axes(u: Vec3, v: Vec3) -> rotation.Quaternion:
    """Return the rotation whose x and y axes are `u` and `v`, orthonormal."""
    azimuth = vector.azimuth(u)
    elevation = vector.elevation(u)
    level = rotation.from_azimuth_elevation(azimuth, elevation)
    across = rotation.rotate(level, (0.0, 1.0, 0.0))
    up = rotation.rotate(level, (0.0, 0.0, 1.0))
    sine = vector.dot(v, up)
    cosine = vector.dot(v, across)
    return rotation.from_azimuth_elevation(azimuth, elevation, float(np.arctan2(sine, cosine)))


class Markers:
    """Draws the whole scene each time, and deletes markers that are gone."""

    def __init__(self) -> None:
        self._drawn: dict[tuple[str, int], None] = {}

    def __call__(self, _message: Message, context: ConversionContext) -> Converted:
        """Return the scene's markers."""
        markers = MarkerBuilder(context, LIFETIME_S)
        state = context.state
        drawn: list[Any] = []
        for user in sorted(state.people):
            drawn += _person(markers, state, user)
        drawn += _objects(markers, state)
        drawn += robots(markers, state)

        # Deletions first: viewers keep a marker for its lifetime
        keys = {(marker.ns, marker.id): None for marker in drawn}
        deleted = [markers.gone(*key) for key in self._drawn if key not in keys]
        self._drawn = keys
        return (markers.array(deleted + drawn),)


def ellipse(pose: UserPose) -> tuple[float, float, float] | None:
    """Return both half-axes, m, and the azimuth of the major one, or None if it is too small to see."""
    covariance = np.array(pose.covariance).reshape(3, 3)
    horizontal = covariance[:2, :2]
    variances, axes = np.linalg.eigh((horizontal + horizontal.T) / 2.0)
    half_axes_m = SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    short_m, long_m = half_axes_m.tolist()
    if long_m < SMALLEST_M:
        return None
    azimuth_rad = float(np.arctan2(axes[1, 1], axes[0, 1]))
    return long_m, max(short_m, SMALLEST_M), azimuth_rad


def _person(markers: MarkerBuilder, state: ConversionState, user: str) -> Iterator[Any]:
    person = state.people[user]
    rgb = person.profile.cursor_color
    if person.pose is not None:
        position_m = person.pose.position_m
        above_m = vector.add(position_m, (0.0, 0.0, NAME_M))
        yield markers.label(user, f"{user}/name", 0, above_m)
        rim = ellipse(person.pose)
        if rim is not None:
            long_m, short_m, azimuth_rad = rim
            yield markers.shape(
                "cylinder",
                f"{user}/place",
                0,
                size_m=(2.0 * long_m, 2.0 * short_m, 0.01),
                rgb=rgb,
                at_m=position_m,
                orientation=rotation.from_yaw(azimuth_rad),
                alpha=0.3,
            )
    yield from _pointing(markers, state, user, person, rgb)


def _pointing(
    markers: MarkerBuilder, state: ConversionState, user: str, person: RosPerson, rgb: Rgb
) -> Iterator[Any]:
    cursor = state.pointing(user)
    if cursor is None:
        return

    # The ray, fainter if it meets nothing
    if cursor.origin_m is not None and cursor.direction is not None:
        length_m = FREE_RAY_M
        alpha = 0.3
        if cursor.point_m is not None:
            length_m = max(cursor.range_m, 0.1)
            alpha = 0.8
        end_m = vector.add(cursor.origin_m, vector.scale(cursor.direction, length_m))
        ends_m = (cursor.origin_m, end_m)
        group = f"{user}/ray"
        yield markers.shape("arrow", group, 0, size_m=RAY_M, rgb=rgb, alpha=alpha, places_m=ends_m)

    # The cursor, with the progress of what it is about to do
    if cursor.point_m is None:
        return
    size_m = (CURSOR_M, CURSOR_M, CURSOR_M)
    yield markers.shape("sphere", f"{user}/cursor", 0, size_m=size_m, rgb=rgb, at_m=cursor.point_m)
    hover = person.hover
    if hover is None or not hover.object_id:
        return
    if hover.progress > 0.0:
        above_m = vector.add(cursor.point_m, (0.0, 0.0, 0.15))
        words = f"{hover.progress:.0%} {hover.action}"
        yield markers.label(words, f"{user}/progress", 0, above_m)


def _objects(markers: MarkerBuilder, state: ConversionState) -> Iterator[Any]:
    owners: dict[str, str] = {}
    if state.selection is not None:
        owners = {item.id: item.user for item in state.selection.settled}
    steered = state.robots  # drawn on their own
    count = 0
    for item in state.tracked():
        if item.id in steered:
            continue
        count += 1
        if count <= MAX_OBJECTS:
            yield from _object(markers, state, item, owners.get(item.id))
    if count > MAX_OBJECTS:
        words = f"{count - MAX_OBJECTS} more objects are not drawn"
        yield markers.label(words, "more_objects", 0, (0.0, 0.0, 2.5), 0.3)


def _object(
    markers: MarkerBuilder, state: ConversionState, item: TrackedObject, owner: str | None
) -> Iterator[Any]:
    number = state.uids.number(item.id)
    rgb = KIND_COLORS.get(item.kind, OTHER_COLOR)

    # Shape and size: a ball, or a box along its belt or strip
    shape: Shape = "sphere"
    length_m = item.length_m or USUAL_M
    at_m = item.position_m
    orientation = rotation.IDENTITY
    size_m = (length_m, length_m, length_m)
    line = state.lines.get((item.surface, item.surface_id))
    if line is not None:
        shape = "cube"
        tangent = line.tangent_at(item.surface_position_m)
        orientation = rotation.from_azimuth_elevation(vector.azimuth(tangent), vector.elevation(tangent))
        size_m = (length_m, *SEGMENT_M)
        if item.surface == "belt":
            # Trackers publish lengths only; the shares are those of the page's packages.
            wide_m = min(max(0.75 * length_m, 0.1), 0.34)
            high_m = min(max(0.6 * length_m, 0.1), 0.26)
            size_m = (length_m, wide_m, high_m)
            at_m = vector.add(at_m, (0.0, 0.0, high_m / 2.0))
    yield markers.shape(shape, "objects", number, size_m=size_m, rgb=rgb, at_m=at_m, orientation=orientation)

    # Its owner, as a larger shell in their colour
    if owner is None:
        return
    owner_rgb = OTHER_COLOR
    if owner in state.people:
        owner_rgb = state.people[owner].profile.cursor_color
    yield markers.shape(
        shape=shape,
        group="selected",
        number=number,
        size_m=vector.add(size_m, (GROWN_M, GROWN_M, GROWN_M)),
        rgb=owner_rgb,
        at_m=at_m,
        orientation=orientation,
        alpha=0.35,
    )


def robots(markers: MarkerBuilder, state: ConversionState) -> Iterator[Any]:
    """Yield the markers of all robots, and of the way-points that people have set."""
    for name, robot_state in sorted(state.robots.items()):
        yield from _robot(markers, state, name, robot_state)
    for user, person in sorted(state.people.items()):
        waypoints_m = () if person.steering is None else person.steering.waypoints_m
        rgb = person.profile.cursor_color
        size_m = (SPOT_M, SPOT_M, SPOT_M)
        group = f"{user}/waypoints"
        for number, place_m in enumerate(waypoints_m):
            yield markers.shape("sphere", group, number, size_m=size_m, rgb=rgb, at_m=place_m)


def _robot(
    markers: MarkerBuilder, state: ConversionState, name: str, robot_state: RobotState
) -> Iterator[Any]:
    owner = state.people.get(robot_state.user)
    rgb = OTHER_COLOR if owner is None else owner.profile.cursor_color
    body_rgb = HALTED if robot_state.phase in {"stopped", "lost"} else rgb
    group = f"robot {name}"
    at_m = robot_state.position_m

    # Body, and an arrow to its front
    wide_m = 2.0 * robot_state.radius_m
    size_m = (wide_m, wide_m, HIGH_M[robot_state.kind])
    yield markers.shape("cylinder", group, 0, size_m=size_m, rgb=body_rgb, at_m=at_m)
    heading = vector.direction(robot_state.yaw_rad, 0.0)
    front_m = vector.scale(heading, max(1.5 * robot_state.radius_m, 0.1))
    ends_m = (at_m, vector.add(at_m, front_m))
    yield markers.shape("arrow", f"{group}/front", 0, size_m=FRONT_M, rgb=body_rgb, places_m=ends_m)

    # Name, phase and who steers it
    words = f"{name}: {robot_state.phase}"
    if robot_state.user:
        words += f", {robot_state.user}"
    above_m = vector.add(at_m, (0.0, 0.0, LABEL_M))
    yield markers.label(words, f"{group}/name", 0, above_m)

    # Uncertainty of its position
    if robot_state.position_sigma_m:
        spread_m = 2.0 * SIGMAS * robot_state.position_sigma_m
        yield markers.shape(
            shape="cylinder",
            group=f"{group}/place",
            number=0,
            size_m=(spread_m, spread_m, 0.01),
            rgb=rgb,
            at_m=at_m,
            orientation=rotation.IDENTITY,
            alpha=0.3,
        )

    # Its way to the target
    plan = state.plan(name)
    if plan is not None and plan.line_m:
        line_m = (at_m, *plan.line_m)
        width_m = (PLAN_M, 0.0, 0.0)
        yield markers.shape("line", f"{group}/plan", 0, size_m=width_m, rgb=rgb, places_m=line_m)
    target_m = robot_state.target_m
    if target_m is not None:
        spot_m = (SPOT_M, SPOT_M, SPOT_M)
        yield markers.shape("sphere", f"{group}/target", 0, size_m=spot_m, rgb=rgb, at_m=target_m, alpha=0.6)
