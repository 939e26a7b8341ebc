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

OK, WARN = 0, 1
"""Levels of diagnostic_msgs/DiagnosticStatus."""


def led_strips(frame: StripsFrame, context: ConversionContext) -> Converted:
    """Return all pixels, red green blue; a strip's id is the number at the end of ours."""
    types = context.state.types
    strips = [
        types.make(
            "led_strip_msgs/msg/LedStrip",
            id=context.state.channels.number(strip.id),
            data=np.frombuffer(strip.rgb, dtype=np.uint8),
        )
        for strip in frame.strips
    ]
    return (types.make("led_strip_msgs/msg/LedStrips", strips=strips),)


def lamp_color(lamp: LampColor, context: ConversionContext) -> Converted:
    """Return the colour of a lamp; black is off."""
    return (values.color(context.state.types, lamp.color),)


def static_frames(room: Environment, context: ConversionContext) -> Converted:
    """Return lamps and the starts of belts and strips, x along them, all in one message."""
    children: list[tuple[str, Vec3, rotation.Quaternion]] = [
        (f"lamp/{lamp.id}", lamp.position_m, rotation.IDENTITY) for lamp in room.lamps
    ]
    for (kind, name), line in context.state.lines.items():
        way = line.tangent_at(0.0)
        turned = rotation.from_azimuth_elevation(vector.azimuth(way), vector.elevation(way))
        children.append((values.text(f"{kind}/{name}"), line.point_at(0.0), turned))
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

    pairs = [value(key, text) for key, text in _figures(health)[:MAX_VALUES]]
    is_well = health.status == "ok" and not health.warnings
    status = types.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=OK if is_well else WARN,
        name=values.text(f"pointit: {health.instance}"),
        message=values.text("; ".join(health.warnings) or health.status),
        hardware_id=values.text(health.host),
        values=pairs,
    )
    made = types.make(
        "diagnostic_msgs/msg/DiagnosticArray",
        header=values.header(types, context.stamp_ns, ""),
        status=[status],
    )
    return (made,)


def _figures(health: Health) -> list[tuple[str, str]]:
    pairs = [("errors", str(health.errors)), ("uptime, s", f"{health.uptime_s:.0f}")]
    for name, spread in (("latency", health.latency), ("step", health.step)):
        if spread is not None:
            pairs.append((f"{name} p50, ms", f"{spread.p50_s * 1e3:.3f}"))
            pairs.append((f"{name} p99, ms", f"{spread.p99_s * 1e3:.3f}"))
    pairs += [(f"{figure.name} {figure.unit}".strip(), f"{figure.value:g}") for figure in health.figures]
    pairs += [(f"{key.key} {key.direction}, Hz", f"{key.rate_hz:.1f}") for key in health.keys]
    return pairs


def detection(event: SelectionEvent, context: ConversionContext, *, is_on: bool) -> Converted:
    """Return a detection of the person's target: the thing as its only hypothesis, and the thing's box.

    Nothing unless a thing fired or was switched on, or went off if not `is_on`.
    """
    state = context.state
    things = () if state.room is None else state.room.things
    is_reaction = any(thing.id == event.object_id and event.is_reaction(thing.mode) for thing in things)
    if event.is_on != is_on or not is_reaction:
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


def outward() -> tuple[OutboundRoute, ...]:
    """Return the routes, with new converters."""
    return (*_standard(), *_toolkit())


def _standard() -> tuple[OutboundRoute, ...]:
    rosout = Rosout()
    return (
        OutboundRoute(
            *("pose", "/{user}/pose", "geometry_msgs/msg/PoseStamped"),
            *(LATCHED, (topics.POSE,), person.pose),
            rate_hz=POINTING_HZ,
            context="where a person stands, and where x of their IMU points",
        ),
        OutboundRoute(
            *(
                "pose_with_covariance",
                "/{user}/pose_with_covariance",
                "geometry_msgs/msg/PoseWithCovarianceStamped",
            ),
            *(LATCHED, (topics.POSE,), person.pose_with_covariance),
            rate_hz=POINTING_HZ,
            context="the same, and how sure that is",
        ),
        OutboundRoute(
            *("tf", "/tf", "tf2_msgs/msg/TFMessage"),
            *(_MANY, (topics.POSE,), person.transform),
            is_each=True,
            repeat_hz=TF_HZ,
            context="a person's frame in the world; not of people whose frame somebody else gives",
        ),
        OutboundRoute(
            *("tf_static", "/tf_static", "tf2_msgs/msg/TFMessage"),
            *(LATCHED, (topics.MAP,), static_frames),
            context="lamps, starts of belts and strips, all in one message",
        ),
        OutboundRoute(
            *("imu", "/{user}/imu", "sensor_msgs/msg/Imu"),
            *(_STREAM, (topics.IMU,), person.imu),
            rate_hz=POINTING_HZ,
            frame=PERSON,
            context="the arm's orientation, turning and acceleration, all in the person's frame",
        ),
        OutboundRoute(
            *("cursor", "/{user}/cursor", "geometry_msgs/msg/PointStamped"),
            *(_STREAM, (topics.CURSOR,), person.cursor),
            rate_hz=POINTING_HZ,
            context="where a person's ray meets the room",
        ),
        OutboundRoute(
            *("goal_pose", "/{user}/goal_pose", "geometry_msgs/msg/PoseStamped"),
            *(_STREAM, (topics.GOAL,), person.goal),
            context="where a person sends a robot, confirmed",
        ),
        OutboundRoute(
            *("thing_on", "/pointit/thing_on", "vision_msgs/msg/Detection3D"),
            *(_STREAM, (topics.SELECTION_EVENTS,), functools.partial(detection, is_on=True)),
            context="a thing of the map fired, or was switched on: thing, user and probability",
        ),
        OutboundRoute(
            *("thing_off", "/pointit/thing_off", "vision_msgs/msg/Detection3D"),
            *(_STREAM, (topics.SELECTION_EVENTS,), functools.partial(detection, is_on=False)),
            context="a thing of the map was switched off",
        ),
        OutboundRoute(
            *("is_pointing", "/{user}/is_pointing", "std_msgs/msg/Bool"),
            *(LATCHED, (topics.INTERACTION,), person.is_pointing),
            on_change=True,
            context="whether a person points",
        ),
        OutboundRoute(
            *("clock", "/clock", "rosgraph_msgs/msg/Clock"),
            *(_NEWEST, (topics.CLOCK,), clock),
            repeat_hz=CLOCK_HZ,
            repeat_for_s=CLOCK_S,
            yields=True,
            context="the site's time, while it is simulated",
        ),
        OutboundRoute(
            *("diagnostics", "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
            *(_STREAM, (topics.HEALTH,), diagnostics),
            is_each=True,
            context="health of every service",
        ),
        OutboundRoute(
            *("rosout", "/rosout", "rcl_interfaces/msg/Log"),
            *(ROSOUT, (topics.HEALTH,), rosout),
            is_each=True,
            rate_hz=LOG_HZ,
            begins=rosout.begin,
            forgets=rosout.forget,
            context="what goes wrong with a service, once, and when it is over",
        ),
        OutboundRoute(
            *("markers", "/pointit/markers", "visualization_msgs/msg/MarkerArray"),
            *(
                _NEWEST,
                (
                    *(topics.CURSOR, topics.OBJECTS, topics.POSE, topics.SELECTION, topics.INTERACTION),
                    *(topics.ROBOT_STATE, topics.ROBOT_PLAN, topics.STEERING),
                ),
                Markers(),
            ),
            rate_hz=DRAWN_HZ,
            context="rays, cursors, people, objects, robots and their owners, for RViz and Foxglove",
        ),
        OutboundRoute(
            *("map_markers", "/pointit/map_markers", "visualization_msgs/msg/MarkerArray"),
            *(LATCHED, (topics.MAP,), map_markers),
            context="the map: belts, strips, lamps, solids, fences",
        ),
    )


def _toolkit() -> tuple[OutboundRoute, ...]:
    return (
        OutboundRoute(
            *("pointing_ray", "/{user}/pointing_ray", "geometry_msgs/msg/PoseStamped"),
            *(_MANY, (topics.RAY,), person.pointing_ray),
            rate_hz=POINTING_HZ,
            frame=PERSON,
            has_user_publisher=True,
            context="a person's ray: from the eyes along x",
        ),
        OutboundRoute(
            *("rotation", "/{user}/metawear_ros/rotation", "geometry_msgs/msg/QuaternionStamped"),
            *(_STREAM, (topics.IMU,), person.rotation_of_arm),
            rate_hz=POINTING_HZ,
            yields=True,
            frame=PERSON,
            has_user_publisher=True,
            context="how a person's arm is turned",
        ),
        OutboundRoute(
            *("button", "/{user}/metawear_ros/button", "std_msgs/msg/Bool"),
            *(LATCHED, (topics.BUTTON,), person.button),
            yields=True,
            apart_s=person.BUTTON_DOWN_S,
            has_user_publisher=True,
            context="a person's button: true, then false",
        ),
        OutboundRoute(
            *("state_transition", "/{user}/state_transition", "conveyor_msgs/msg/State"),
            *(LATCHED, (topics.INTERACTION,), person.state),
            on_change=True,
            has_user_publisher=True,
            context="where a person is in the interaction",
        ),
        OutboundRoute(
            *("subscription", "/PUI_subscription", "conveyor_msgs/msg/PUISubscription"),
            *(_STREAM, (topics.INTERACTION,), person.subscription),
            is_each=True,
            on_change=True,
            has_user_publisher=True,
            context="request for a cursor of a pointing person, for a pui_node of the ROS toolkit",
        ),
        OutboundRoute(
            *("packages", "/packages", "conveyor_msgs/msg/PackageList"),
            *(_NEWEST, (topics.OBJECTS,), person.packages),
            rate_hz=POINTING_HZ,
            yields=True,
            context="what moves on belts and strips",
        ),
        OutboundRoute(
            *("selected_packages", "/selected_packages", "conveyor_msgs/msg/PackageUIDList"),
            *(LATCHED, (topics.SELECTION,), person.selected),
            on_change=True,
            context="what is selected",
        ),
        OutboundRoute(
            *("pointers", "/pointers", "conveyor_msgs/msg/PointerList"),
            *(_NEWEST, (topics.CURSOR, topics.HOVER, topics.INTERACTION), person.pointers),
            rate_hz=POINTING_HZ,
            context="pointing people, with line, position on it and target",
        ),
        OutboundRoute(
            *("led_strips", "/led_strips", "led_strip_msgs/msg/LedStrips"),
            *(_NEWEST, (topics.STRIPS_FRAME,), led_strips),
            rate_hz=60.0,
            context="pixels of every strip",
        ),
        OutboundRoute(
            *("lamp_color", "/{led}/color", "std_msgs/msg/ColorRGBA"),
            *(_NEWEST, (topics.LAMP_COLOR,), lamp_color),
            context="what a lamp shows",
        ),
        OutboundRoute(
            *("step_number", "/step_number", "std_msgs/msg/Int32"),
            *(LATCHED, (topics.CONVEYOR_STATE,), person.step_number),
            on_change=True,
            context="step of the feeding schedule",
        ),
    )
