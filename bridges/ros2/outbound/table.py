"""Routes to ROS: standard types first, then the ROS toolkit's messages under its names."""

import functools
from typing import Any

import numpy as np

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, Qos
from pointit.bridges.ros2.outbound import person, values
from pointit.bridges.ros2.outbound.markers import Markers, map_markers
from pointit.bridges.ros2.outbound.person import transforms
from pointit.bridges.ros2.outbound.rosout import Rosout
from pointit.bridges.ros2.routing.names import PERSON
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted, OutboundRoute
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import ClockTick, Environment, Health, LampColor, SelectionEvent, StripsFrame, topics

MAX_FRAMES = 1000
"""Maximum number of static frames of a map; a larger tf tree is useless."""
MAX_VALUES = 64
"""Maximum number of values in one service's diagnostics."""

OK = 0
"""Level of diagnostic_msgs/DiagnosticStatus."""
WARN = 1
"""The same."""

POINTING_HZ = 50.0
"""Maximum rate of topics that follow an arm, Hz."""
DRAWN_HZ = 20.0
"""Maximum rate of topics for viewers, Hz."""
TF_HZ = 10.0
"""Rate of repeated transforms: listeners forget old ones, and need one not older than their data."""
LOG_HZ = 2.0
"""Rate at which one service's reports, one a second, are read: no service can flood ROS's log."""
CLOCK_HZ = 50.0
CLOCK_S = 10.0
"""Silence after which a clock has ended, for the site itself too (`runtime.bus.site_clock.SILENT_NS`), s."""

# A reliable publisher reaches both kinds of subscribers, also over DDS.
_NEWEST = Qos(depth=1)
_STREAM = Qos(depth=10)
_MANY = Qos(depth=100)


def led_strips(frame: StripsFrame, context: ConversionContext) -> Converted:
    """Return all pixels, red green blue; a strip's id is the number at the end of ours."""
    types = context.state.types
    strips: list[Any] = []
    for strip in frame.strips:
        number = context.state.channels.number(strip.id)
        pixels = np.frombuffer(strip.rgb, dtype=np.uint8)
        strips.append(types.make("led_strip_msgs/msg/LedStrip", id=number, data=pixels))
    return (types.make("led_strip_msgs/msg/LedStrips", strips=strips),)


def lamp_color(lamp: LampColor, context: ConversionContext) -> Converted:
    """Return the colour of a lamp; black is off."""
    return (values.color(context.state.types, lamp.color),)


def static_frames(room: Environment, context: ConversionContext) -> Converted:
    """Return lamps and the starts of belts and strips, x along them, all in one message."""
    children: list[tuple[str, Vec3, rotation.Quaternion]] = []
    for lamp in room.lamps:
        children.append((f"lamp/{lamp.id}", lamp.position_m, rotation.IDENTITY))
    for (kind, name), line in context.state.lines.items():
        tangent = line.tangent_at(0.0)
        orientation = rotation.from_azimuth_elevation(vector.azimuth(tangent), vector.elevation(tangent))
        frame = values.text(f"{kind}/{name}")
        children.append((frame, line.point_at(0.0), orientation))
    return (transforms(context, children[:MAX_FRAMES]),)


def clock(tick: ClockTick, context: ConversionContext) -> Converted:
    """Return the site's time while it is simulated; nothing for wall time."""
    if tick.sim_ns == tick.stamp_ns and tick.speed == 1.0:
        return ()
    types = context.state.types
    now_ns = context.stamp_ns if context.is_again else tick.sim_ns
    return (types.make("rosgraph_msgs/msg/Clock", clock=values.time(types, now_ns)),)


def diagnostics(health: Health, context: ConversionContext) -> Converted:
    """Return one service's health."""
    types = context.state.types

    def value(key: str, text: str) -> Any:
        return types.make("diagnostic_msgs/msg/KeyValue", key=values.text(key), value=values.text(text))

    # A service with warnings is not well, whatever its status says
    level = OK
    message = health.status
    if health.warnings:
        message = "; ".join(health.warnings)
    if health.warnings or health.status != "ok":
        level = WARN

    figures = [value(key, text) for key, text in _figures(health)[:MAX_VALUES]]
    status = types.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=values.text(f"pointit: {health.instance}"),
        message=values.text(message),
        hardware_id=values.text(health.host),
        values=figures,
    )
    header = values.header(types, context.stamp_ns, "")
    array = types.make("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status])
    return (array,)


def _figures(health: Health) -> list[tuple[str, str]]:
    """Return names and values of all that one service reports."""
    pairs = [("errors", str(health.errors))]
    pairs.append(("uptime, s", f"{health.uptime_s:.0f}"))
    for name, spread in (("latency", health.latency), ("step", health.step)):
        if spread is not None:
            p50_ms = spread.p50_s * 1e3
            p99_ms = spread.p99_s * 1e3
            pairs.append((f"{name} p50, ms", f"{p50_ms:.3f}"))
            pairs.append((f"{name} p99, ms", f"{p99_ms:.3f}"))
    for figure in health.figures:
        title = f"{figure.name} {figure.unit}".strip()
        pairs.append((title, f"{figure.value:g}"))
    for key in health.keys:
        title = f"{key.key} {key.direction}, Hz"
        pairs.append((title, f"{key.rate_hz:.1f}"))
    return pairs


def detection(event: SelectionEvent, context: ConversionContext, *, is_on: bool) -> Converted:
    """Return a detection of the person's target: the thing as its only hypothesis, and the thing's box.

    Nothing unless a thing fired or was switched on, or went off if not `is_on`.
    """
    state = context.state
    if event.is_on != is_on or not _is_reaction(event, state.room):
        return ()
    make = state.types.make

    # The thing, and how sure the selection is
    object_id = values.text(event.object_id)
    score = event.confidence or 0.0
    hypothesis = make("vision_msgs/msg/ObjectHypothesis", class_id=object_id, score=score)
    result = make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis)

    # Its box, empty if no tracker sees the thing
    box = make("vision_msgs/msg/BoundingBox3D")
    tracked_object = next((item for item in state.tracked() if item.id == event.object_id), None)
    if tracked_object is not None:
        length_m = tracked_object.length_m
        orientation = rotation.from_yaw(tracked_object.yaw_rad or 0.0)
        size_m = tracked_object.size_m or (length_m, length_m, length_m)
        center = values.pose(state.types, tracked_object.position_m, orientation)
        size = values.vector3(state.types, size_m)
        box = make("vision_msgs/msg/BoundingBox3D", center=center, size=size)
    user = values.text(event.user)
    return values.stamped(context, "vision_msgs/msg/Detection3D", id=user, results=[result], bbox=box)


def _is_reaction(event: SelectionEvent, room: Environment | None) -> bool:
    """Return True if `event` is what the mode of its thing in `room` makes of a selection."""
    if room is None:
        return False
    for thing in room.things:
        if thing.id == event.object_id and event.is_reaction(thing.mode):
            return True
    return False


def outward() -> tuple[OutboundRoute, ...]:
    """Return the routes, with new converters."""
    return (*_standard(), *_toolkit())


def _standard() -> tuple[OutboundRoute, ...]:
    rosout = Rosout()
    return (
        # People and their frames
        OutboundRoute(
            name="pose",
            ros="/{user}/pose",
            type="geometry_msgs/msg/PoseStamped",
            qos=LATCHED,
            reads=(topics.POSE,),
            by=person.pose,
            rate_hz=POINTING_HZ,
            context="where a person stands, and where x of their IMU points",
        ),
        OutboundRoute(
            name="pose_with_covariance",
            ros="/{user}/pose_with_covariance",
            type="geometry_msgs/msg/PoseWithCovarianceStamped",
            qos=LATCHED,
            reads=(topics.POSE,),
            by=person.pose_with_covariance,
            rate_hz=POINTING_HZ,
            context="the same, and how sure that is",
        ),
        OutboundRoute(
            name="tf",
            ros="/tf",
            type="tf2_msgs/msg/TFMessage",
            qos=_MANY,
            reads=(topics.POSE,),
            by=person.transform,
            is_each=True,
            repeat_hz=TF_HZ,
            context="a person's frame in the world; not of people whose frame somebody else gives",
        ),
        OutboundRoute(
            name="tf_static",
            ros="/tf_static",
            type="tf2_msgs/msg/TFMessage",
            qos=LATCHED,
            reads=(topics.MAP,),
            by=static_frames,
            context="lamps, starts of belts and strips, all in one message",
        ),
        # Arms, cursors and what people select
        OutboundRoute(
            name="imu",
            ros="/{user}/imu",
            type="sensor_msgs/msg/Imu",
            qos=_STREAM,
            reads=(topics.IMU,),
            by=person.imu,
            rate_hz=POINTING_HZ,
            frame=PERSON,
            context="the arm's orientation, turning and acceleration, all in the person's frame",
        ),
        OutboundRoute(
            name="cursor",
            ros="/{user}/cursor",
            type="geometry_msgs/msg/PointStamped",
            qos=_STREAM,
            reads=(topics.CURSOR,),
            by=person.cursor,
            rate_hz=POINTING_HZ,
            context="where a person's ray meets the room",
        ),
        OutboundRoute(
            name="goal_pose",
            ros="/{user}/goal_pose",
            type="geometry_msgs/msg/PoseStamped",
            qos=_STREAM,
            reads=(topics.GOAL,),
            by=person.goal,
            context="where a person sends a robot, confirmed",
        ),
        OutboundRoute(
            name="thing_on",
            ros="/pointit/thing_on",
            type="vision_msgs/msg/Detection3D",
            qos=_STREAM,
            reads=(topics.SELECTION_EVENTS,),
            by=functools.partial(detection, is_on=True),
            context="a thing of the map fired, or was switched on: thing, user and probability",
        ),
        OutboundRoute(
            name="thing_off",
            ros="/pointit/thing_off",
            type="vision_msgs/msg/Detection3D",
            qos=_STREAM,
            reads=(topics.SELECTION_EVENTS,),
            by=functools.partial(detection, is_on=False),
            context="a thing of the map was switched off",
        ),
        OutboundRoute(
            name="is_pointing",
            ros="/{user}/is_pointing",
            type="std_msgs/msg/Bool",
            qos=LATCHED,
            reads=(topics.INTERACTION,),
            by=person.is_pointing,
            on_change=True,
            context="whether a person points",
        ),
        # Time and state of the site
        OutboundRoute(
            name="clock",
            ros="/clock",
            type="rosgraph_msgs/msg/Clock",
            qos=_NEWEST,
            reads=(topics.CLOCK,),
            by=clock,
            repeat_hz=CLOCK_HZ,
            repeat_for_s=CLOCK_S,
            yields=True,
            context="the site's time, while it is simulated",
        ),
        OutboundRoute(
            name="diagnostics",
            ros="/diagnostics",
            type="diagnostic_msgs/msg/DiagnosticArray",
            qos=_STREAM,
            reads=(topics.HEALTH,),
            by=diagnostics,
            is_each=True,
            context="health of every service",
        ),
        OutboundRoute(
            name="rosout",
            ros="/rosout",
            type="rcl_interfaces/msg/Log",
            qos=ROSOUT,
            reads=(topics.HEALTH,),
            by=rosout,
            is_each=True,
            rate_hz=LOG_HZ,
            begins=rosout.begin,
            forgets=rosout.forget,
            context="what goes wrong with a service, once, and when it is over",
        ),
        # The scene, for viewers
        OutboundRoute(
            name="markers",
            ros="/pointit/markers",
            type="visualization_msgs/msg/MarkerArray",
            qos=_NEWEST,
            reads=(
                topics.CURSOR,
                topics.OBJECTS,
                topics.POSE,
                topics.SELECTION,
                topics.INTERACTION,
                topics.ROBOT_STATE,
                topics.ROBOT_PLAN,
                topics.STEERING,
            ),
            by=Markers(),
            rate_hz=DRAWN_HZ,
            context="rays, cursors, people, objects, robots and their owners, for RViz and Foxglove",
        ),
        OutboundRoute(
            name="map_markers",
            ros="/pointit/map_markers",
            type="visualization_msgs/msg/MarkerArray",
            qos=LATCHED,
            reads=(topics.MAP,),
            by=map_markers,
            context="the map: belts, strips, lamps, solids, fences",
        ),
    )


def _toolkit() -> tuple[OutboundRoute, ...]:
    return (
        # People, as the nodes of the ROS toolkit publish them
        OutboundRoute(
            name="pointing_ray",
            ros="/{user}/pointing_ray",
            type="geometry_msgs/msg/PoseStamped",
            qos=_MANY,
            reads=(topics.RAY,),
            by=person.pointing_ray,
            rate_hz=POINTING_HZ,
            frame=PERSON,
            has_user_publisher=True,
            context="a person's ray: from the eyes along x",
        ),
        OutboundRoute(
            name="rotation",
            ros="/{user}/metawear_ros/rotation",
            type="geometry_msgs/msg/QuaternionStamped",
            qos=_STREAM,
            reads=(topics.IMU,),
            by=person.rotation_of_arm,
            rate_hz=POINTING_HZ,
            yields=True,
            frame=PERSON,
            has_user_publisher=True,
            context="how a person's arm is turned",
        ),
        OutboundRoute(
            name="button",
            ros="/{user}/metawear_ros/button",
            type="std_msgs/msg/Bool",
            qos=LATCHED,
            reads=(topics.BUTTON,),
            by=person.button,
            yields=True,
            apart_s=person.BUTTON_DOWN_S,
            has_user_publisher=True,
            context="a person's button: true, then false",
        ),
        OutboundRoute(
            name="state_transition",
            ros="/{user}/state_transition",
            type="conveyor_msgs/msg/State",
            qos=LATCHED,
            reads=(topics.INTERACTION,),
            by=person.state,
            on_change=True,
            has_user_publisher=True,
            context="where a person is in the interaction",
        ),
        OutboundRoute(
            name="subscription",
            ros="/PUI_subscription",
            type="conveyor_msgs/msg/PUISubscription",
            qos=_STREAM,
            reads=(topics.INTERACTION,),
            by=person.subscription,
            is_each=True,
            on_change=True,
            has_user_publisher=True,
            context="request for a cursor of a pointing person, for a pui_node of the ROS toolkit",
        ),
        # Objects on conveyors
        OutboundRoute(
            name="packages",
            ros="/packages",
            type="conveyor_msgs/msg/PackageList",
            qos=_NEWEST,
            reads=(topics.OBJECTS,),
            by=person.packages,
            rate_hz=POINTING_HZ,
            yields=True,
            context="what moves on belts and strips",
        ),
        OutboundRoute(
            name="selected_packages",
            ros="/selected_packages",
            type="conveyor_msgs/msg/PackageUIDList",
            qos=LATCHED,
            reads=(topics.SELECTION,),
            by=person.selected,
            on_change=True,
            context="what is selected",
        ),
        OutboundRoute(
            name="pointers",
            ros="/pointers",
            type="conveyor_msgs/msg/PointerList",
            qos=_NEWEST,
            reads=(topics.CURSOR, topics.HOVER, topics.INTERACTION),
            by=person.pointers,
            rate_hz=POINTING_HZ,
            context="pointing people, with line, position on it and target",
        ),
        # Lights, and the schedule of feeders
        OutboundRoute(
            name="led_strips",
            ros="/led_strips",
            type="led_strip_msgs/msg/LedStrips",
            qos=_NEWEST,
            reads=(topics.STRIPS_FRAME,),
            by=led_strips,
            rate_hz=60.0,
            context="pixels of every strip",
        ),
        OutboundRoute(
            name="lamp_color",
            ros="/{led}/color",
            type="std_msgs/msg/ColorRGBA",
            qos=_NEWEST,
            reads=(topics.LAMP_COLOR,),
            by=lamp_color,
            context="what a lamp shows",
        ),
        OutboundRoute(
            name="step_number",
            ros="/step_number",
            type="std_msgs/msg/Int32",
            qos=LATCHED,
            reads=(topics.CONVEYOR_STATE,),
            by=person.step_number,
            on_change=True,
            context="step of the feeding schedule",
        ),
    )
