"""Output of things of the map: who has pointed at which one."""

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.geometry import rotation
from pointit.schemas import SelectionEvent


def turned_on(event: SelectionEvent, context: ConversionContext) -> Converted:
    """Return a detection if a thing fired or was switched on, else nothing."""
    return _detection(event, context) if event.is_on else ()


def turned_off(event: SelectionEvent, context: ConversionContext) -> Converted:
    """Return a detection if a switch went off, else nothing."""
    return () if event.is_on else _detection(event, context)


def _detection(event: SelectionEvent, context: ConversionContext) -> Converted:
    """Return a detection of the person's target: the thing as its only hypothesis, and the thing's box."""
    state = context.state
    things = () if state.room is None else state.room.things
    if not any(thing.id == event.object_id and event.is_reaction(thing.mode) for thing in things):
        return ()
    make = state.types.make
    found = next((item for item in state.tracked() if item.id == event.object_id), None)
    hypothesis = make(
        "vision_msgs/msg/ObjectHypothesis",
        class_id=values.text(event.object_id),
        score=event.confidence or 0.0,
    )
    result = make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis)
    box = make("vision_msgs/msg/BoundingBox3D")
    if found is not None:
        length_m = found.length_m
        box = make(
            "vision_msgs/msg/BoundingBox3D",
            center=values.pose(state.types, found.position_m, rotation.from_yaw(found.yaw_rad or 0.0)),
            size=values.vector3(state.types, found.size_m or (length_m, length_m, length_m)),
        )
    who = values.text(event.user)
    return values.stamped(context, "vision_msgs/msg/Detection3D", id=who, results=[result], bbox=box)
