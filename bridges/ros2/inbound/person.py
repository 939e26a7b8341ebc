"""Input of a person from ROS: arm, button and pose.

Arms (`WristSample`, device `arm`): the rotation turns vectors of the arm's frame, x along the arm to the
finger, z up with the palm down, into {H}, the frame at the person's feet with z up and x forward. The
mounting of the sensor on the arm has to be corrected in ROS. The yaw's origin is arbitrary but must be
constant: localizing by pointing finds it, as does `set_yaw_origin` until samples fail to come for a second.
"""

from collections.abc import Iterator
from typing import Any

from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.rival_publishers import RivalPublishers
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.names import frame_name, holds_frame
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning, Taken
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, ButtonEvent, SetPose, UserPose, WristSample
from pointit.schemas.topics import BUTTON, POSE, SET_POSE, WRIST

SOURCE = "ros2"
"""Source of button presses."""

SOONEST_NS = NS_PER_S // 30
"""Minimum interval of one person's poses from /tf."""

NO_ORIENTATION = "has no orientation: the IMU states that it measures none; add a filter that computes one"
MAX_TF_AGE_NS = 2 * NS_PER_S
"""Time for which a publisher of a person's frame is assumed to continue."""
REPLACED_NS = 10 * NS_PER_S
"""Time without a message after which a sensor in another frame is used."""
FOR_EVER_NS = 2**63 - 1

MAX_TRANSFORMS = 1000
"""Maximum number of stored static transforms."""


class RosWrist:
    """A person's arm from QuaternionStamped or Imu."""

    def __init__(self) -> None:
        self._frames: dict[str, tuple[str, int]] = {}
        """Frame of the sensor in use of each person, and the time of its newest message, ns."""

    def rotation(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a geometry_msgs/QuaternionStamped."""
        orientation = checks.quaternion(value.quaternion, _arm(context))
        return self._sample(value, orientation, context)

    def imu(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a sensor_msgs/Imu; only its orientation is used."""
        if float(value.orientation_covariance[0]) == -1.0:
            return (ConversionWarning(f"{_arm(context)} {NO_ORIENTATION}"),)
        orientation = checks.quaternion(value.orientation, _arm(context))
        return self._sample(value, orientation, context)

    def _sample(self, value: Any, orientation: Quaternion | str, context: ConversionContext) -> Taken:
        """Return the arm's sample from a stamped value and its orientation, or the rejection."""
        if isinstance(orientation, str):
            return (ConversionWarning(orientation),)
        problem = self._rival(frame_name(value.header.frame_id), context)
        if problem:
            return (ConversionWarning(problem),)
        stamp_ns, problem = checks.stamp(value.header.stamp, context, _arm(context))
        sample = WristSample(stamp_ns=stamp_ns, orientation_xyzw=orientation)
        output = BusOutput(WRIST, context.name, sample)
        return (output, ConversionWarning(problem)) if problem else (output,)

    def _rival(self, frame: str, context: ConversionContext) -> str:
        """Return a sentence if a sensor in another frame moves the arm now, else `""`."""
        used, received_ns = self._frames.get(context.name, (frame, 0))
        if frame != used and context.stamp_ns - received_ns < REPLACED_NS:
            frame_in_use = checks.named(used)
            return (
                f"{_arm(context)} has several sensors: that of frame {frame_in_use} is used, not "
                f"that of {checks.named(frame)}; let only one of them publish to this person's topics"
            )
        self._frames[context.name] = (frame, context.stamp_ns)
        return ""


class Button:
    """A person's button from Bool: it is pressed when it becomes true."""

    def __init__(self) -> None:
        self._down: dict[str, bool] = {}

    def __call__(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a std_msgs/Bool."""
        was_down = self._down.get(context.name, False)
        self._down[context.name] = bool(value.data)
        if was_down or not value.data:
            return ()
        press = ButtonEvent(stamp_ns=context.stamp_ns, source=SOURCE)
        return (BusOutput(BUTTON, context.name, press),)

    def forget(self, user: str) -> None:
        """Reset the button of `user`: after leaving with it down they may press when they return."""
        self._down.pop(user, None)


class Poses:
    """Poses of people from motion capture and other ROS nodes: {H} in {W}."""

    def __init__(self) -> None:
        self._sent_ns: dict[str, int] = {}
        self._static: dict[str, Any] = {}
        """Static transforms in {W} by frame, also of people who may come later."""
        self._rivals = RivalPublishers()

    def mocap(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a geometry_msgs/PoseStamped."""
        if frame_name(value.header.frame_id) and not _is_in_room(value, context):
            return (_other_frame(value, context.name, context),)
        pose = value.pose
        return self._pose(pose.position, pose.orientation, value.header.stamp, context)

    def forearm(self, value: Any, context: ConversionContext) -> Taken:
        """Update the yaw of {H} by a geometry_msgs/PoseStamped of the marker body on the forearm."""
        if frame_name(value.header.frame_id) and not _is_in_room(value, context):
            return (_other_frame(value, context.name, context),)
        label = f"the forearm's body of {context.name}"
        orientation = checks.quaternion(value.pose.orientation, label)
        if isinstance(orientation, str):
            return (ConversionWarning(orientation),)
        stamp_ns, problem = checks.stamp(value.header.stamp, context, label)
        person = context.state.person(context.name)
        if person.forearm_yaw is None:
            from pointit.forearm.forearm_yaw import ForearmYaw  # noqa: PLC0415 - SciPy, for few people

            person.forearm_yaw = ForearmYaw()
        person.forearm_yaw.add_body(stamp_ns, orientation)
        return (ConversionWarning(problem),) if problem else ()

    def tf(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a tf2_msgs/TFMessage: transforms of known people."""
        return tuple(self._moving(value, context))

    def tf_static(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a static tf2_msgs/TFMessage: a person's pose, published once."""
        for transform in value.transforms:
            if not _is_in_room(transform, context):
                continue
            if len(self._static) >= MAX_TRANSFORMS:
                oldest = next(iter(self._static))
                del self._static[oldest]
            self._static[frame_name(transform.child_frame_id)] = transform
        return tuple(self._static_poses(value, context))

    def on_presence(self, context: ConversionContext) -> Taken:
        """Return the pose of a person who has just joined, if published before: it is not repeated."""
        frame = frame_name(context.state.frames.person(context.name))
        transform = self._static.get(frame)
        if transform is None:
            return ()
        return self._static_pose(transform, context.name, context)

    def _static_poses(
        self, value: Any, context: ConversionContext
    ) -> Iterator[BusOutput | ConversionWarning]:
        for transform, user in _of_people(value, context):
            if _is_in_room(transform, context):
                yield from self._static_pose(transform, user, context)
            else:
                yield _other_frame(transform, user, context)

    def _static_pose(self, transform: Any, user: str, context: ConversionContext) -> Taken:
        """Return the pose by a transform of /tf_static, or a warning. A ROS-only user has no localizer."""
        translation = transform.transform.translation
        orientation = transform.transform.rotation
        no_stamp = context.state.types.make("builtin_interfaces/msg/Time")  # 0: it counts as now
        if user in context.state.ros_users:
            context.state.person(user).tf_until_ns = FOR_EVER_NS
            return self._pose(translation, orientation, no_stamp, context._replace(name=user))
        placed = _placed(translation, orientation, user)
        if isinstance(placed, str):
            return (ConversionWarning(placed),)
        context.state.person(user).tf_until_ns = FOR_EVER_NS
        position_m, yaw_rad = placed
        request = SetPose(position_m=position_m, yaw_rad=yaw_rad)
        return (BusOutput(SET_POSE, user, request),)

    def _moving(self, value: Any, context: ConversionContext) -> Iterator[BusOutput | ConversionWarning]:
        for transform, user in _of_people(value, context):
            if not _is_in_room(transform, context):
                yield _other_frame(transform, user, context)
                continue
            problem = self._rival(transform)
            if problem:
                yield ConversionWarning(problem)

            # Also one that comes too soon says that its publisher runs
            context.state.person(user).tf_until_ns = context.stamp_ns + MAX_TF_AGE_NS
            since_ns = context.stamp_ns - self._sent_ns.get(user, -SOONEST_NS)
            if 0 <= since_ns < SOONEST_NS:
                continue
            self._sent_ns[user] = context.stamp_ns
            pose = transform.transform
            own_context = context._replace(name=user)
            yield from self._pose(pose.translation, pose.rotation, transform.header.stamp, own_context)

    def _rival(self, transform: Any) -> str:
        """Return a sentence if two nodes publish the frame of a transform, else `""`."""
        frame = frame_name(transform.child_frame_id)
        position_m = checks.place(transform.transform.translation, frame)
        if isinstance(position_m, str):  # the pose is refused
            return ""
        parent = frame_name(transform.header.frame_id)
        return self._rivals.describe(frame, parent, position_m)

    def _pose(self, position: Any, orientation: Any, stamp: Any, context: ConversionContext) -> Taken:
        """Return the person's pose, or a warning; the yaw is that of the forearm's body if they wear one."""
        user = context.name
        person = context.state.people.get(user)
        forearm_yaw = None if person is None else person.forearm_yaw
        stamp_ns, problem = checks.stamp(stamp, context, f"the pose of {user}")
        covariance = UserPose.model_fields["covariance"].default
        if forearm_yaw is None or user in context.state.ros_users:
            placed = _placed(position, orientation, user)
        else:
            # The body at the feet gives the position alone, at any orientation
            estimate = forearm_yaw.stated(context.stamp_ns)
            if estimate is None:
                return (ConversionWarning(forearm_yaw.problem(user, context.stamp_ns)),)
            position_m = checks.place(position, f"the pose of {user}")
            placed = position_m if isinstance(position_m, str) else (position_m, estimate.yaw_rad)
            covariance = (*covariance[:8], estimate.sigma_rad**2)
        if isinstance(placed, str):
            return (ConversionWarning(placed),)

        position_m, yaw_rad = placed
        pose = UserPose(
            stamp_ns=stamp_ns,
            position_m=position_m,
            yaw_rad=yaw_rad,
            covariance=covariance,
            method="external",
        )
        output = BusOutput(POSE, user, pose)
        return (output, ConversionWarning(problem)) if problem else (output,)


def people_in(cdr: bytes, state: ConversionState) -> tuple[str, ...]:
    """Return the known people whose frames are named in `cdr`; decoding takes 200 times as long."""
    return tuple(user for user in state.people if holds_frame(cdr, state.frames.person(user)))


def _of_people(value: Any, context: ConversionContext) -> Iterator[tuple[Any, str]]:
    """Yield the transforms to a known person's {H}, and the person."""
    state = context.state
    frames = {frame_name(state.frames.person(user)): user for user in state.people}
    for transform in value.transforms:
        user = frames.get(frame_name(transform.child_frame_id))
        if user is not None:
            yield transform, user


def _is_in_room(value: Any, context: ConversionContext) -> bool:
    """Return True if a stamped value is in {W}."""
    return frame_name(value.header.frame_id) == frame_name(context.frame)


def _other_frame(value: Any, user: str, context: ConversionContext) -> ConversionWarning:
    frame = checks.named(frame_name(value.header.frame_id))
    sentence = f"the pose of {user} is in the frame {frame}: send it in {context.frame!r}"
    return ConversionWarning(sentence)


def _placed(position: Any, rotation: Any, user: str) -> tuple[tuple[float, float, float], float] | str:
    """Return position, m, and heading, rad, or the rejection."""
    subject = f"the pose of {user}"
    position_m = checks.place(position, subject)
    if isinstance(position_m, str):
        return position_m
    orientation = checks.quaternion(rotation, subject)
    if isinstance(orientation, str):
        return orientation
    yaw_rad = checks.heading(orientation, subject)
    return yaw_rad if isinstance(yaw_rad, str) else (position_m, yaw_rad)


def _arm(context: ConversionContext) -> str:
    return f"the arm of {context.name}"
