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
    what = f"the ray of {context.name}"
    frame = frame_name(value.header.frame_id)
    if frame not in ("", frame_name(context.frame)):
        return (
            ConversionWarning(f"{what} is in the frame {checks.named(frame)}: send it in {context.frame!r}"),
        )
    origin_m = checks.place(value.pose.position, what)
    if isinstance(origin_m, str):
        return (ConversionWarning(origin_m),)
    turned = checks.quaternion(value.pose.orientation, what)
    if isinstance(turned, str):
        return (ConversionWarning(turned),)
    ros_user.has_new_input = True
    if not ros_user.is_here:
        return ()
    stamp_ns, problem = checks.stamp(value.header.stamp, context, what)
    way = vector.normalized(rotation.rotate(turned, AHEAD))
    output = BusOutput(RAY, context.name, PointingRay(stamp_ns=stamp_ns, origin_m=origin_m, direction=way))
    return (output, ConversionWarning(problem)) if problem else (output,)


class Subscriptions:
    """Guests' cursor subscriptions."""

    def __init__(self) -> None:
        self._looks: dict[str, _Look] = {}

    def __call__(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a conveyor_msgs/PUISubscription; repetitions are dropped."""
        state = context.state
        name = value.user_name
        user = next((each for each in state.ros_users if state.names.of(each) == name), None)
        if user is None:
            is_ours = any(state.names.of(each) == name for each in state.people)
            return () if is_ours or not value.subscribe else (_unknown_user(name),)
        ros_user = state.ros_users[user]
        was = ros_user.is_subscribed
        ros_user.is_subscribed = bool(value.subscribe)
        if not ros_user.is_subscribed:
            why = "they want no cursor any more"
            return (interaction(state, user, context.stamp_ns, why),) if was else ()
        ros_user.has_new_input = True
        look = _look(value, user)
        taken: list[BusOutput | ConversionWarning] = []
        if isinstance(look, str):
            taken.append(ConversionWarning(look))
        elif not was or look != self._looks.get(user):
            self._looks[user] = look
            profile = UserProfile(
                stamp_ns=context.stamp_ns,
                cursor_color=look.color,
                cursor_colormap=look.colormap,
                cursor_width_m=look.width_m,
            )
            taken.append(BusOutput(PROFILE, user, profile))
        if not was:
            taken.append(interaction(state, user, context.stamp_ns, "they want a cursor"))
        return tuple(taken)


def interaction(state: ConversionState, user: str, stamp_ns: int, reason: str) -> BusOutput:
    """Return the state of the interaction of the ROS-only user `user`, as far as known."""
    message = Interaction(
        stamp_ns=stamp_ns,
        state="pointing" if state.ros_users[user].is_subscribed else "idle",
        reason=f"in ROS: {reason}",
    )
    return BusOutput(INTERACTION, user, message)


def _unknown_user(name: str) -> ConversionWarning:
    return ConversionWarning(
        f"{checks.named(name)} wants a cursor, but is unknown here: list people with ROS nodes only in the "
        "bridge's parameter `people`"
    )


def _look(value: Any, user: str) -> _Look | str:
    channels = [float(each) for each in (value.pointer_color.r, value.pointer_color.g, value.pointer_color.b)]
    width_m = float(value.pointer_size)
    colormap = value.pointer_cmap
    if not all(map(math.isfinite, channels)):
        return f"the cursor's colour of {user} is none: send r, g and b from 0 to 1; it stays as it was"
    if not 0.0 < width_m <= WIDEST_M:
        return (
            f"the cursor of {user} is to be {width_m:g} m wide: send up to {WIDEST_M:g}; it stays as it was"
        )
    if len(colormap) > MAX_COLORMAP:
        return f"there is no colormap {checks.named(colormap)} for the cursor of {user}; it stays as it was"
    red, green, blue = (round(255.0 * min(max(each, 0.0), 1.0)) for each in channels)
    return _Look((red, green, blue), colormap, width_m)
