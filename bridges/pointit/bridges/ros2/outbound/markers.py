"""Markers of moving things: rays, cursors, people, their uncertainty, objects and their owners, robots."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from pointit.bridges.ros2.outbound.marker_builder import MarkerBuilder, Shape
from pointit.bridges.ros2.routing.conversion_state import ConversionState, Person
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import Message, RobotState, TrackedObject, UserPose
from pointit.schemas.base import Rgb
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR

LIFETIME_S = 2.0
"""Lifetime of a marker, s, for viewers that missed its deletion."""

MAX_OBJECTS = 500
"""Maximum number of drawn objects; a label gives the number of others."""

MAX_PEOPLE = 64

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

PLAN_M, SPOT_M, LABEL_M = 0.03, 0.1, 0.3


class Markers:
    """Draws the whole scene each time, and deletes markers that are gone."""

    def __init__(self) -> None:
        self._drawn: dict[tuple[str, int], None] = {}

    def __call__(self, _message: Message, context: ConversionContext) -> Converted:
        """Return the scene's markers."""
        markers = MarkerBuilder(context, LIFETIME_S)
        state = context.state
        people = sorted(state.people)[:MAX_PEOPLE]
        made = [marker for user in people for marker in _person(markers, state, user)]
        made += _objects(markers, state)
        made += robots(markers, state)
        now = {(marker.ns, marker.id): None for marker in made}
        gone = [markers.gone(*key) for key in self._drawn if key not in now]
        self._drawn = now
        return (markers.array(gone + made),)


def ellipse(pose: UserPose) -> tuple[float, float, float] | None:
    """Return both half-axes, m, and the azimuth of the major one, or None if it is too small to see."""
    spread = np.array(pose.covariance).reshape(3, 3)[:2, :2]
    variances, axes = np.linalg.eigh((spread + spread.T) / 2.0)
    short_m, long_m = (SIGMAS * np.sqrt(np.maximum(variances, 0.0))).tolist()
    if long_m < SMALLEST_M:
        return None
    return long_m, max(short_m, SMALLEST_M), float(np.arctan2(axes[1, 1], axes[0, 1]))


def _person(markers: MarkerBuilder, state: ConversionState, user: str) -> Iterator[Any]:
    person = state.people[user]
    rgb = person.profile.cursor_color
    if person.pose is not None:
        place_m = person.pose.position_m
        yield markers.label(user, f"{user}/name", 0, vector.add(place_m, (0.0, 0.0, NAME_M)))
        rim = ellipse(person.pose)
        if rim is not None:
            yield markers.shape(
                "cylinder",
                f"{user}/place",
                0,
                size_m=(2.0 * rim[0], 2.0 * rim[1], 0.01),
                rgb=rgb,
                at_m=place_m,
                turned=rotation.from_yaw(rim[2]),
                alpha=0.3,
            )
    yield from _pointing(markers, state, user, person, rgb)


def _pointing(
    markers: MarkerBuilder, state: ConversionState, user: str, person: Person, rgb: Rgb
) -> Iterator[Any]:
    cursor = state.pointing(user)
    if cursor is None:
        return
    if cursor.origin_m is not None and cursor.direction is not None:
        length_m = FREE_RAY_M if cursor.point_m is None else max(cursor.range_m, 0.1)
        end_m = vector.add(cursor.origin_m, vector.scale(cursor.direction, length_m))
        alpha = 0.3 if cursor.point_m is None else 0.8
        ends_m = (cursor.origin_m, end_m)
        yield markers.shape("arrow", f"{user}/ray", 0, size_m=RAY_M, rgb=rgb, alpha=alpha, places_m=ends_m)
    if cursor.point_m is not None:
        size_m = (CURSOR_M, CURSOR_M, CURSOR_M)
        yield markers.shape("sphere", f"{user}/cursor", 0, size_m=size_m, rgb=rgb, at_m=cursor.point_m)
        hover = person.hover
        if hover is not None and hover.object_id and hover.progress > 0.0:
            above_m = vector.add(cursor.point_m, (0.0, 0.0, 0.15))
            yield markers.label(f"{hover.progress:.0%} {hover.action}", f"{user}/progress", 0, above_m)


def _objects(markers: MarkerBuilder, state: ConversionState) -> Iterator[Any]:
    selection = state.selection
    owners = {} if selection is None else {item.id: item.user for item in selection.objects}
    left_out = 0
    steered = state.robots  # drawn on their own
    for count, item in enumerate(item for item in state.tracked() if item.id not in steered):
        if count < MAX_OBJECTS:
            yield from _object(markers, state, item, owners.get(item.id))
        else:
            left_out += 1
    if left_out:
        yield markers.label(f"{left_out} more objects are not drawn", "more_objects", 0, (0.0, 0.0, 2.5), 0.3)


def _object(
    markers: MarkerBuilder, state: ConversionState, item: TrackedObject, owner: str | None
) -> Iterator[Any]:
    number = state.uids.number(item.id)
    rgb = KIND_COLORS.get(item.kind, OTHER_COLOR)
    length_m = item.length_m or USUAL_M
    line = state.lines.get((item.surface, item.surface_id))
    at_m, turned, size_m = item.position_m, rotation.IDENTITY, (length_m, length_m, length_m)
    if line is not None:
        ahead = line.tangent_at(item.surface_position_m)
        turned = rotation.from_azimuth_elevation(vector.azimuth(ahead), vector.elevation(ahead))
        size_m = (length_m, *SEGMENT_M)
        if item.surface == "belt":
            # Trackers publish lengths only; the shares are those of the page's packages.
            high_m = min(max(0.6 * length_m, 0.1), 0.26)
            size_m = (length_m, min(max(0.75 * length_m, 0.1), 0.34), high_m)
            at_m = vector.add(at_m, (0.0, 0.0, high_m / 2.0))
    shape: Shape = "sphere" if line is None else "cube"
    yield markers.shape(shape, "objects", number, size_m=size_m, rgb=rgb, at_m=at_m, turned=turned)
    if owner is not None:
        around_m = vector.add(size_m, (GROWN_M, GROWN_M, GROWN_M))
        owner_rgb = state.people[owner].profile.cursor_color if owner in state.people else OTHER_COLOR
        yield markers.shape(
            shape, "selected", number, size_m=around_m, rgb=owner_rgb, at_m=at_m, turned=turned, alpha=0.35
        )


def robots(markers: MarkerBuilder, state: ConversionState) -> Iterator[Any]:
    """Yield the markers of all robots, and of the way-points that people have set."""
    for name, robot_state in sorted(state.robots.items()):
        yield from _robot(markers, state, name, robot_state)
    for user, person in sorted(state.people.items()):
        waypoints_m = () if person.steering is None else person.steering.waypoints_m
        size_m = (SPOT_M, SPOT_M, SPOT_M)
        for number, place_m in enumerate(waypoints_m):
            rgb = person.profile.cursor_color
            yield markers.shape("sphere", f"{user}/waypoints", number, size_m=size_m, rgb=rgb, at_m=place_m)


def _robot(
    markers: MarkerBuilder, state: ConversionState, name: str, robot_state: RobotState
) -> Iterator[Any]:
    owner = state.people.get(robot_state.user)
    rgb = OTHER_COLOR if owner is None else owner.profile.cursor_color
    is_halted = robot_state.phase in {"stopped", "lost"}
    group, at_m, wide_m = f"robot {name}", robot_state.position_m, 2.0 * robot_state.radius_m
    size_m = (wide_m, wide_m, HIGH_M[robot_state.kind])
    body = HALTED if is_halted else rgb
    yield markers.shape("cylinder", group, 0, size_m=size_m, rgb=body, at_m=at_m)
    ahead = vector.scale(vector.direction(robot_state.yaw_rad, 0.0), max(1.5 * robot_state.radius_m, 0.1))
    ends_m = (at_m, vector.add(at_m, ahead))
    yield markers.shape("arrow", f"{group}/front", 0, size_m=FRONT_M, rgb=body, places_m=ends_m)
    words = f"{name}: {robot_state.phase}" + (f", {robot_state.user}" if robot_state.user else "")
    yield markers.label(words, f"{group}/name", 0, vector.add(at_m, (0.0, 0.0, LABEL_M)))
    if robot_state.position_sigma_m:
        spread_m = 2.0 * SIGMAS * robot_state.position_sigma_m
        yield markers.shape(
            *("cylinder", f"{group}/place", 0),
            size_m=(spread_m, spread_m, 0.01),
            rgb=rgb,
            at_m=at_m,
            turned=rotation.IDENTITY,
            alpha=0.3,
        )
    plan = state.plan(name)
    if plan is not None and plan.line_m:
        line_m = (at_m, *plan.line_m)
        yield markers.shape("line", f"{group}/plan", 0, size_m=(PLAN_M, 0.0, 0.0), rgb=rgb, places_m=line_m)
    if robot_state.target_m is not None:
        spot_m = (SPOT_M, SPOT_M, SPOT_M)
        yield markers.shape(
            "sphere", f"{group}/target", 0, size_m=spot_m, rgb=rgb, at_m=robot_state.target_m, alpha=0.6
        )
