"""Output of a person and of the objects they point at, in the ROS toolkit's messages."""

import math
from typing import Any

import numpy as np

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.routing.conversion_state import ConversionState, lane_name
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    ButtonEvent,
    ConveyorState,
    Cursor,
    Goal,
    ImuSample,
    Interaction,
    Message,
    PointingRay,
    Selection,
    TrackedObject,
    UserPose,
)
from pointit.schemas.pointing import SurfaceKind

SUPERVISOR = "supervisor"
"""The ROS toolkit's node that controls the interaction, which ours replaces."""

STATES = {"idle": "ready", "localizing": "waiting_relloc", "pointing": "pointing"}
"""Our states in that node's terms."""

BUTTON_DOWN_S = 0.1
"""A press is true, then false after this time, so that late joiners get no old press."""

_UNKNOWN = np.array([-1.0, *[0.0] * 8])
"""Covariance of a missing measurement (sensor_msgs/Imu)."""
_ZEROS = np.zeros(9)

MIN_SIGMA_M = 0.01
"""Standard deviation of a position measured by hand; ROS's filters cannot use 0."""
MIN_SIGMA_RAD = math.radians(1.0)
"""Standard deviation of a known angle, and of roll and pitch, which are 0 by definition of {H}."""
_MIN_VARIANCES = np.array([MIN_SIGMA_M**2] * 3 + [MIN_SIGMA_RAD**2] * 3)

_NONE = np.empty(0, dtype=np.uint32)


def pointing_ray(ray: PointingRay, context: ConversionContext) -> Converted:
    """Return the ray as a pose whose x axis is its direction."""
    direction = ray.direction
    azimuth = vector.azimuth(direction)
    orientation = rotation.from_azimuth_elevation(azimuth, vector.elevation(direction))
    return _stamped_pose(context, ray.origin_m, orientation)


def rotation_of_arm(sample: ImuSample, context: ConversionContext) -> Converted:
    """Return the arm's orientation in {H}."""
    orientation = values.quaternion(context.state.types, sample.orientation_xyzw)
    return values.stamped(context, "geometry_msgs/msg/QuaternionStamped", quaternion=orientation)


def imu(sample: ImuSample, context: ConversionContext) -> Converted:
    """Return the sample with all vectors in {H}, since the arm has no published frame."""
    types = context.state.types
    orientation = sample.orientation_xyzw
    turn_radps = sample.angular_velocity_radps or (0.0, 0.0, 0.0)
    turn_covariance = _UNKNOWN if sample.angular_velocity_radps is None else _ZEROS
    acceleration_mps2 = sample.acceleration_mps2 or (0.0, 0.0, 0.0)
    acceleration_covariance = _UNKNOWN if sample.acceleration_mps2 is None else _ZEROS
    return values.stamped(
        context,
        "sensor_msgs/msg/Imu",
        orientation=values.quaternion(types, orientation),
        orientation_covariance=_ZEROS,
        angular_velocity=values.vector3(types, rotation.rotate(orientation, turn_radps)),
        angular_velocity_covariance=turn_covariance,
        linear_acceleration=values.vector3(types, rotation.rotate(orientation, acceleration_mps2)),
        linear_acceleration_covariance=acceleration_covariance,
    )


def pose(user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return {H} in {W}."""
    return _stamped_pose(context, user_pose.position_m, rotation.from_yaw(user_pose.yaw_rad))


def pose_with_covariance(user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return {H} in {W} and its covariance: rows and columns x, y, z, roll, pitch, yaw; no variance is 0."""
    types = context.state.types
    covariance = np.zeros((6, 6))
    x_y_yaw = np.ix_((0, 1, 5), (0, 1, 5))
    covariance[x_y_yaw] = np.array(user_pose.covariance).reshape(3, 3)
    covariance[2, 2] = user_pose.z_sigma_m**2
    variances = np.maximum(covariance.diagonal(), _MIN_VARIANCES)
    np.fill_diagonal(covariance, variances)
    pose = values.pose(types, user_pose.position_m, rotation.from_yaw(user_pose.yaw_rad))
    with_covariance = types.make(
        "geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance.ravel()
    )
    return values.stamped(context, "geometry_msgs/msg/PoseWithCovarianceStamped", pose=with_covariance)


def transform(user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return {H} in {W} for /tf; nothing while another ROS node publishes that frame."""
    state = context.state
    now_ns = context.stamp_ns if context.is_again else state.now_ns
    if now_ns < state.person(context.name).tf_until_ns:
        return ()
    child = state.frames.person(context.name)
    orientation = rotation.from_yaw(user_pose.yaw_rad)
    return (transforms(context, [(child, user_pose.position_m, orientation)]),)


def transforms(context: ConversionContext, children: list[tuple[str, Vec3, rotation.Quaternion]]) -> Any:
    """Return one message with the frames `children`, in the frame of the route."""
    types = context.state.types
    header = values.header(types, context.stamp_ns, context.frame)
    stamped: list[Any] = []
    for child, position_m, orientation in children:
        transform = types.make(
            "geometry_msgs/msg/Transform",
            translation=values.vector3(types, position_m),
            rotation=values.quaternion(types, orientation),
        )
        message = types.make(
            "geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=transform
        )
        stamped.append(message)
    return types.make("tf2_msgs/msg/TFMessage", transforms=stamped)


def cursor(cursor: Cursor, context: ConversionContext) -> Converted:
    """Return the point where the ray meets the room; nothing if it does not."""
    if cursor.point_m is None:
        return ()
    point = values.point(context.state.types, cursor.point_m)
    return values.stamped(context, "geometry_msgs/msg/PointStamped", point=point)


def goal(request: Goal, context: ConversionContext) -> Converted:
    """Return a robot's goal, and its heading there; nothing if it is for a robot that we steer."""
    if request.robot:
        return ()
    return _stamped_pose(context, request.position_m, rotation.from_yaw(request.yaw_rad))


def button(event: ButtonEvent, context: ConversionContext) -> Converted:
    """Return the button down and up, twice for a double press."""
    make = context.state.types.make
    press = (make("std_msgs/msg/Bool", data=True), make("std_msgs/msg/Bool", data=False))
    return press * 2 if event.gesture == "double" else press


def state(interaction: Interaction, context: ConversionContext) -> Converted:
    """Return the state of the interaction, as a transition of the ROS toolkit's supervisor."""
    make = context.state.types.make
    value = STATES[interaction.state]
    return (make("conveyor_msgs/msg/State", node_name=SUPERVISOR, state=value),)


def is_pointing(interaction: Interaction, context: ConversionContext) -> Converted:
    """Return a ROS Bool, true while the person points."""
    return (context.state.types.make("std_msgs/msg/Bool", data=interaction.state == "pointing"),)


def subscription(interaction: Interaction, context: ConversionContext) -> Converted:
    """Return a cursor subscription, or its end, for the ROS toolkit's `pui_node`."""
    types = context.state.types
    profile = context.state.person(context.name).profile
    message = types.make(
        "conveyor_msgs/msg/PUISubscription",
        user_name=context.state.names.of(context.name),
        subscribe=interaction.state == "pointing",
        pointer_color=values.color(types, profile.cursor_color),
        pointer_cmap=values.text(profile.cursor_colormap),
        pointer_size=profile.cursor_width_m,
    )
    return (message,)


def _stamped_pose(context: ConversionContext, at_m: Vec3, orientation: rotation.Quaternion) -> Converted:
    pose = values.pose(context.state.types, at_m, orientation)
    return values.stamped(context, "geometry_msgs/msg/PoseStamped", pose=pose)


def packages(_message: Message, context: ConversionContext) -> Converted:
    """Return the objects of all trackers on belts and strips, without things of the map.

    The message has no place for others.
    """
    state = context.state
    things: set[str] = set()
    if state.room is not None:
        things = {thing.id for thing in state.room.fixed_things}
    packages: list[Any] = []
    for item in state.tracked():
        if item.id in things:
            continue
        place = _along(state, item.surface, item.surface_id, item.surface_position_m)
        if place is not None:
            packages.append(_package(state, item, place))
    return values.stamped(context, "conveyor_msgs/msg/PackageList", packages=packages)


def selected(selection: Selection, context: ConversionContext) -> Converted:
    """Return all selected objects, of every owner."""
    number = context.state.uids.number
    uids = np.array([number(item.id) for item in selection.settled], dtype=np.uint32)
    return (context.state.types.make("conveyor_msgs/msg/PackageUIDList", uids=uids),)


def pointers(_message: Message, context: ConversionContext) -> Converted:
    """Return every person's cursor, with an empty strip name if it is on no line, as in the ROS toolkit."""
    state = context.state
    pointers = [_pointer(state, user) for user in sorted(state.people)]
    return (state.types.make("conveyor_msgs/msg/PointerList", pointers=pointers),)


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
    number = state.uids.number(item.id)
    kind = state.kinds.number(item.kind)
    return state.types.make(
        "conveyor_msgs/msg/Package", uid=number, position=place, type=kind, length=item.length_m
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

    # The object under it, if any
    uids = _NONE
    if person.hover is not None and person.hover.object_id:
        number = state.uids.number(person.hover.object_id)
        uids = np.array([number], dtype=np.uint32)
    overlay = types.make("conveyor_msgs/msg/PackageUIDList", uids=uids)
    return types.make(
        "conveyor_msgs/msg/Pointer",
        position=place,
        size=profile.cursor_width_m,
        distance=cursor.miss_m,
        overlay=overlay,
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
    name = values.text(lane_name(surface, surface_id))
    return state.types.make("conveyor_msgs/msg/PositionOnStrip", name=name, position=share)
