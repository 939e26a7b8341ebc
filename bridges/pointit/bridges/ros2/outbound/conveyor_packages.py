"""Objects, selections and cursors in the ROS toolkit's own messages."""

from typing import Any

import numpy as np

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.routing.conversion_state import ConversionState, lane_name
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.schemas import ConveyorState, Message, Selection, TrackedObject
from pointit.schemas.pointing import SurfaceKind

MAX_PACKAGES = 2000
"""Maximum number of objects in one list, as in our messages."""

_NONE = np.empty(0, dtype=np.uint32)


def packages(_message: Message, context: ConversionContext) -> Converted:
    """Return the objects of all trackers on belts and strips, without things of the map.

    The message has no place for others.
    """
    state = context.state
    made: list[Any] = []
    things = set[str]() if state.room is None else {thing.id for thing in state.room.fixed_things}
    for item in state.tracked():
        if item.id in things:
            continue
        place = _along(state, item.surface, item.surface_id, item.surface_position_m)
        if place is not None and len(made) < MAX_PACKAGES:
            made.append(_package(state, item, place))
    return values.stamped(context, "conveyor_msgs/msg/PackageList", packages=made)


def selected(selection: Selection, context: ConversionContext) -> Converted:
    """Return all selected objects, of every owner."""
    uids = [context.state.uids.number(item.id) for item in selection.objects]
    return (
        context.state.types.make("conveyor_msgs/msg/PackageUIDList", uids=np.array(uids, dtype=np.uint32)),
    )


def pointers(_message: Message, context: ConversionContext) -> Converted:
    """Return every person's cursor, with an empty strip name if it is on no line, as in the ROS toolkit."""
    state = context.state
    made = [_pointer(state, user) for user in sorted(state.people)]
    return (state.types.make("conveyor_msgs/msg/PointerList", pointers=made),)


def step_number(state: ConveyorState, context: ConversionContext) -> Converted:
    """Return the number of the feeding schedule's step, or nothing without a step."""
    try:
        number = int(state.step)
    except ValueError:
        return ()
    if not -(2**31) <= number < 2**31:
        return ()
    return (context.state.types.make("std_msgs/msg/Int32", data=number),)


def _package(state: ConversionState, item: TrackedObject, place: Any) -> Any:
    return state.types.make(
        "conveyor_msgs/msg/Package",
        uid=state.uids.number(item.id),
        position=place,
        type=state.kinds.number(item.kind),
        length=item.length_m,
    )


def _pointer(state: ConversionState, user: str) -> Any:
    types = state.types
    person = state.people[user]
    profile = person.profile
    name = state.names.of(user)
    cursor = state.pointing(user)
    place = cursor and _along(state, cursor.surface, cursor.surface_id, cursor.position_m)
    if cursor is None or place is None:
        return types.make("conveyor_msgs/msg/Pointer", user_name=name)
    hovered = "" if person.hover is None else person.hover.object_id
    over = np.array([state.uids.number(hovered)], dtype=np.uint32) if hovered else _NONE
    return types.make(
        "conveyor_msgs/msg/Pointer",
        position=place,
        size=profile.cursor_width_m,
        distance=cursor.miss_m,
        overlay=types.make("conveyor_msgs/msg/PackageUIDList", uids=over),
        user_name=name,
        color=values.color(types, profile.cursor_color),
        cmap=values.text(profile.cursor_colormap),
    )


def _along(state: ConversionState, surface: SurfaceKind, surface_id: str, position_m: float) -> Any | None:
    """Return the position as a share of the line's length, or None if the line is not on the map."""
    line = state.lines.get((surface, surface_id))
    if line is None:
        return None
    share = min(max(position_m / line.length_m, 0.0), 1.0)
    return state.types.make(
        "conveyor_msgs/msg/PositionOnStrip", name=values.text(lane_name(surface, surface_id)), position=share
    )
