"""What ROS says of a person: how their arm is turned, that they pressed, where they stand.

Arms (`WristSample`, device `arm`): the rotation turns vectors of the arm's frame, x along the arm to the
finger, z up with the palm down, into {H}, the frame at the person's feet with z up and x forward. How the
sensor sits on the arm has to be taken out in ROS. The yaw's origin may be anywhere, as long as it stays:
localizing by pointing finds it, as does `set_yaw_origin` until samples fail to come for a second.
"""

from collections.abc import Iterator
from typing import Any, Literal

from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning, Taken
from pointit.bridges.ros2.routing.scene import Scene
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, ButtonEvent, SetPose, UserPose, WristSample
from pointit.schemas.topics import BUTTON, POSE, SET_POSE, WRIST

SOURCE = "ros2"
"""Of button presses."""

SOONEST_NS = NS_PER_S // 30
"""From one pose that /tf gives of a person to the next."""

HEARD_NS = 2 * NS_PER_S
"""Who has published a person's frame goes on for so long, as far as we know."""
FOR_EVER_NS = 2**63 - 1

MOST_TRANSFORMS = 1000
"""Looked at in one message."""


class Wrist:
    """A person's arm from QuaternionStamped or Imu."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def rotation(self, value: Any, about: ConversionContext) -> Taken:
        """Take a geometry_msgs/QuaternionStamped."""
        return self._turned(value, checks.quaternion(value.quaternion, _arm(about)), about)

    def imu(self, value: Any, about: ConversionContext) -> Taken:
        """Take a sensor_msgs/Imu; of it only the orientation."""
        if float(value.orientation_covariance[0]) == -1.0:
            why = (
                f"{_arm(about)} has no orientation: the IMU says that it measures none; let a filter make one"
            )
            return (ConversionWarning(why),)
        return self._turned(value, checks.quaternion(value.orientation, _arm(about)), about)

    def _turned(self, value: Any, turned: Quaternion | str, about: ConversionContext) -> Taken:
        if isinstance(turned, str):
            return (ConversionWarning(turned),)
        stamp_ns, trouble = checks.stamp(value.header.stamp, about, _arm(about))
        count = self._counts[about.name] = self._counts.get(about.name, 0) + 1
        sample = WristSample(stamp_ns=stamp_ns, seq=count, orientation_xyzw=turned)
        said = BusOutput(WRIST, about.name, sample)
        return (said, ConversionWarning(trouble)) if trouble else (said,)


class Button:
    """A person's button from Bool: a press is when it becomes true."""

    def __init__(self) -> None:
        self._down: dict[str, bool] = {}
        self._counts: dict[str, int] = {}

    def __call__(self, value: Any, about: ConversionContext) -> Taken:
        """Take a std_msgs/Bool."""
        was_down = self._down.get(about.name, False)
        self._down[about.name] = bool(value.data)
        if was_down or not value.data:
            return ()
        count = self._counts[about.name] = self._counts.get(about.name, 0) + 1
        return (
            BusOutput(BUTTON, about.name, ButtonEvent(stamp_ns=about.stamp_ns, seq=count, source=SOURCE)),
        )

    def forget(self, user: str) -> None:
        """Take the button of `user` for one that is up: who left with it down may press when they return."""
        self._down.pop(user, None)


class Poses:
    """Where people stand, as motion capture and others in ROS know it: {H} in {W}."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._sent_ns: dict[str, int] = {}
        self._static: dict[str, Any] = {}
        """What does not move in {W}, by its frame: of people who may come later, too."""

    def mocap(self, value: Any, about: ConversionContext) -> Taken:
        """Take a geometry_msgs/PoseStamped."""
        frame = value.header.frame_id
        if frame not in ("", about.frame):
            here = f"the pose of {about.name} is in the frame {checks.named(frame)}"
            return (ConversionWarning(f"{here}: send it in {about.frame!r}"),)
        return self._pose(value.pose.position, value.pose.orientation, value.header.stamp, about)

    def tf(self, value: Any, about: ConversionContext) -> Taken:
        """Take a tf2_msgs/TFMessage: of all that moves, the people we know."""
        return tuple(self._moving(value, about))

    def tf_static(self, value: Any, about: ConversionContext) -> Taken:
        """Take a tf2_msgs/TFMessage of what does not move: a person's place, told once."""
        for each in value.transforms[:MOST_TRANSFORMS]:
            if each.header.frame_id == about.frame:
                if len(self._static) >= MOST_TRANSFORMS:
                    del self._static[next(iter(self._static))]
                self._static[each.child_frame_id] = each
        return tuple(
            said for each, user in _of_people(value, about) for said in self._stands(each, user, about)
        )

    def meet(self, about: ConversionContext) -> Taken:
        """Return where somebody stands who comes now, if that was told before: nobody tells it again."""
        each = self._static.get(about.scene.frames.person(about.name))
        return () if each is None else self._stands(each, about.name, about)

    def _stands(self, each: Any, user: str, about: ConversionContext) -> Taken:
        """Return where a transform of /tf_static puts somebody; a guest has no localizer to be asked."""
        if user not in about.scene.guests:
            return (_stands(each, user, about),)
        about.scene.person(user).tf_until_ns = FOR_EVER_NS
        moved, now = each.transform, about.scene.types.make("builtin_interfaces/msg/Time")
        return self._pose(moved.translation, moved.rotation, now, about._replace(name=user))

    def _moving(self, value: Any, about: ConversionContext) -> Iterator[BusOutput | ConversionWarning]:
        for each, user in _of_people(value, about):
            about.scene.person(user).tf_until_ns = about.stamp_ns + HEARD_NS
            since_ns = about.stamp_ns - self._sent_ns.get(user, -SOONEST_NS)
            if 0 <= since_ns < SOONEST_NS:
                continue
            self._sent_ns[user] = about.stamp_ns
            one = about._replace(name=user)
            yield from self._pose(each.transform.translation, each.transform.rotation, each.header.stamp, one)

    def _pose(self, at: Any, turned: Any, stamp: Any, about: ConversionContext) -> Taken:
        user = about.name
        found = _placed(at, turned, user)
        if isinstance(found, str):
            return (ConversionWarning(found),)
        position_m, yaw_rad = found
        stamp_ns, trouble = checks.stamp(stamp, about, f"the pose of {user}")
        count = self._counts[user] = self._counts.get(user, 0) + 1
        pose = UserPose(
            stamp_ns=stamp_ns, seq=count, position_m=position_m, yaw_rad=yaw_rad, method="external"
        )
        said = BusOutput(POSE, user, pose)
        return (said, ConversionWarning(trouble)) if trouble else (said,)


def people_in(cdr: bytes, scene: Scene) -> tuple[str, ...]:
    """Return the known people whose frame is named in a message; to read it takes 200 times as long."""
    order: Literal["little", "big"] = "little" if cdr[1:2] == b"\1" else "big"
    return tuple(user for user in scene.people if _text(scene.frames.person(user), order) in cdr)


def _text(text: str, order: Literal["little", "big"]) -> bytes:
    """Return how `text` begins in CDR: its length tells it from one that only ends the same, as `joanna`."""
    letters = text.encode()
    return (len(letters) + 1).to_bytes(4, order) + letters


def _of_people(value: Any, about: ConversionContext) -> Iterator[tuple[Any, str]]:
    """Yield the transforms from {W} to a known person's {H}, with who they are."""
    scene = about.scene
    frames = {scene.frames.person(user): user for user in scene.people}
    for each in value.transforms[:MOST_TRANSFORMS]:
        user = frames.get(each.child_frame_id)
        if user is not None and each.header.frame_id == about.frame:
            yield each, user


def _stands(each: Any, user: str, about: ConversionContext) -> BusOutput | ConversionWarning:
    """Return where a transform of /tf_static puts somebody, or what is wrong with it."""
    found = _placed(each.transform.translation, each.transform.rotation, user)
    if isinstance(found, str):
        return ConversionWarning(found)
    position_m, yaw_rad = found
    about.scene.person(user).tf_until_ns = FOR_EVER_NS
    return BusOutput(SET_POSE, user, SetPose(position_m=position_m, yaw_rad=yaw_rad))


def _placed(at: Any, turned: Any, user: str) -> tuple[tuple[float, float, float], float] | str:
    """Return place, m, and heading, rad, or what is wrong with them."""
    what = f"the pose of {user}"
    position_m = checks.place(at, what)
    if isinstance(position_m, str):
        return position_m
    orientation = checks.quaternion(turned, what)
    if isinstance(orientation, str):
        return orientation
    yaw_rad = checks.heading(orientation, what)
    return yaw_rad if isinstance(yaw_rad, str) else (position_m, yaw_rad)


def _arm(about: ConversionContext) -> str:
    return f"the arm of {about.name}"
