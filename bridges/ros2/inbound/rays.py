"""Rays and cursor subscriptions of guests, whose pointing comes from ROS alone.

A ray (geometry_msgs/PoseStamped) starts at the eyes and has the direction of the pose's x axis, in the
person's frame {H}. A subscription (conveyor_msgs/PUISubscription) switches the person's cursor on or off, and
sets its appearance.
"""

import math
from typing import Any, NamedTuple

from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.names import frame_name
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning, Taken
from pointit.geometry import rotation, vector
from pointit.schemas import Interaction, PointingRay, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.topics import INTERACTION, PROFILE, RAY

AHEAD = (1.0, 0.0, 0.0)

WIDEST_M = 1.0
"""Maximum width of a cursor, as in `UserProfile`."""
MAX_COLORMAP = 32
"""Maximum characters of a colormap's name, as in `UserProfile`."""


class _Look(NamedTuple):
    color: Rgb
    colormap: str
    width_m: float


def ray(value: Any, context: ConversionContext) -> Taken:
    """Convert a geometry_msgs/PoseStamped of a guest. The first ones only make the person present.

    A ray published before the subscription is known would give them a cursor.
    """
    ros_user = context.state.ros_users.get(context.name)
    if ros_user is None:
        return ()
    subject = f"the ray of {context.name}"
    frame = frame_name(value.header.frame_id)
    if frame not in ("", frame_name(context.frame)):
        sentence = f"{subject} is in the frame {checks.named(frame)}: send it in {context.frame!r}"
        return (ConversionWarning(sentence),)
    origin_m = checks.place(value.pose.position, subject)
    if isinstance(origin_m, str):
        return (ConversionWarning(origin_m),)
    orientation = checks.quaternion(value.pose.orientation, subject)
    if isinstance(orientation, str):
        return (ConversionWarning(orientation),)

    # Any ray makes them present. Rays count from the next check of presence on
    ros_user.has_new_input = True
    if not ros_user.is_here:
        return ()
    stamp_ns, problem = checks.stamp(value.header.stamp, context, subject)
    direction = vector.normalized(rotation.rotate(orientation, AHEAD))
    message = PointingRay(stamp_ns=stamp_ns, origin_m=origin_m, direction=direction)
    output = BusOutput(RAY, context.name, message)
    return (output, ConversionWarning(problem)) if problem else (output,)


class Subscriptions:
    """Guests' cursor subscriptions."""

    def __init__(self) -> None:
        self._looks: dict[str, _Look] = {}

    def __call__(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a conveyor_msgs/PUISubscription; repetitions are dropped."""
        state = context.state
        name = value.user_name
        user = next((user for user in state.ros_users if state.names.of(user) == name), None)
        if user is None:
            return _answer_to_others(name, state, wants_cursor=bool(value.subscribe))

        # Whether they want one
        ros_user = state.ros_users[user]
        was_subscribed = ros_user.is_subscribed
        ros_user.is_subscribed = bool(value.subscribe)
        if not ros_user.is_subscribed:
            if not was_subscribed:
                return ()
            return (interaction(state, user, context.stamp_ns, "they want no cursor any more"),)
        ros_user.has_new_input = True

        # How it looks, before it appears
        look = _look(value, user)
        outputs: list[BusOutput | ConversionWarning] = []
        if isinstance(look, str):
            outputs.append(ConversionWarning(look))
        elif not was_subscribed or look != self._looks.get(user):
            self._looks[user] = look
            profile = UserProfile(
                stamp_ns=context.stamp_ns,
                cursor_color=look.color,
                cursor_colormap=look.colormap,
                cursor_width_m=look.width_m,
            )
            outputs.append(BusOutput(PROFILE, user, profile))
        if not was_subscribed:
            outputs.append(interaction(state, user, context.stamp_ns, "they want a cursor"))
        return tuple(outputs)


def _answer_to_others(name: str, state: ConversionState, *, wants_cursor: bool) -> Taken:
    """Return a warning if nobody here has the ROS name `name`. A person with PointIt services needs none."""
    is_ours = any(state.names.of(user) == name for user in state.people)
    if is_ours or not wants_cursor:
        return ()
    return (_unknown_user(name),)


def interaction(state: ConversionState, user: str, stamp_ns: int, reason: str) -> BusOutput:
    """Return the state of the interaction of the ROS-only user `user`, as far as known."""
    is_subscribed = state.ros_users[user].is_subscribed
    message = Interaction(
        stamp_ns=stamp_ns,
        state="pointing" if is_subscribed else "idle",
        reason=f"in ROS: {reason}",
    )
    return BusOutput(INTERACTION, user, message)


def _unknown_user(name: str) -> ConversionWarning:
    return ConversionWarning(
        f"{checks.named(name)} wants a cursor, but is unknown here: list people with ROS nodes only in the "
        "bridge's parameter `people`"
    )


def _look(value: Any, user: str) -> _Look | str:
    color = value.pointer_color
    channels = [float(color.r), float(color.g), float(color.b)]
    width_m = float(value.pointer_size)
    colormap = value.pointer_cmap
    if not all(map(math.isfinite, channels)):
        return f"the cursor's colour of {user} is none: send r, g and b from 0 to 1; it stays as it was"
    if not 0.0 < width_m <= WIDEST_M:
        limit = f"{WIDEST_M:g}"
        return f"the cursor of {user} is to be {width_m:g} m wide: send up to {limit}; it stays as it was"
    if len(colormap) > MAX_COLORMAP:
        return f"there is no colormap {checks.named(colormap)} for the cursor of {user}; it stays as it was"
    within = [min(max(channel, 0.0), 1.0) for channel in channels]
    red, green, blue = (round(255.0 * channel) for channel in within)
    return _Look((red, green, blue), colormap, width_m)
