"""Commands of ROS toolkit nodes to the conveyor and the lights."""

import math
from typing import Any

from pointit.bridges.ros2.inbound import checks
from pointit.bridges.ros2.routing.conversion_state import lane_of
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning, Taken
from pointit.bridges.ros2.routing.uids import MAX_NUMBER
from pointit.schemas import (
    AddPackage,
    AddPackageReply,
    Reply,
    ResetConveyor,
    SetBrightness,
    SetFeeding,
    SetSpeed,
    SetYawOrigin,
    topics,
)
from pointit.schemas.text import first_of

ALL = "*"
"""Stands for every belt in a command."""
MAX_BELTS = 256
"""Maximum number of belts in one command."""
FASTEST_MPS = 5.0
"""Maximum speed of a belt, as in `SetSpeed`."""
AT_START = 1e-3
"""Share of a belt's length that counts as its start."""
EVERY_STRIP = 0xFF
"""Mask of LED channels."""


def belt_command(value: Any, context: ConversionContext) -> Taken:
    """Convert a conveyor_msgs/BeltCommand: a speed for every belt, or for some."""
    names = list(value.name)
    speeds = [float(each) for each in value.velocity]
    if not names or len(names) != len(speeds) or len(names) > MAX_BELTS:
        return (
            ConversionWarning(
                f"/belt_cmd has {len(names)} names and {len(speeds)} velocities: send one velocity for each, "
                f"at most {MAX_BELTS}"
            ),
        )
    taken: list[BusOutput | ConversionWarning] = []
    belts: dict[float, list[str]] = {}
    for name, speed_mps in zip(names, speeds, strict=True):
        lane = None if name == ALL else lane_of(name, context.state.lanes)
        if problem := _too_fast("/belt_cmd", speed_mps):
            taken.append(ConversionWarning(problem))
        elif name == ALL:
            taken.append(_at_speed(speed_mps))
        elif lane is None:
            there_are = first_of(context.state.lanes, 20) or "none"
            taken.append(
                ConversionWarning(f"/belt_cmd: there is no belt {checks.named(name)}; there are {there_are}")
            )
        else:
            belts.setdefault(speed_mps, []).append(lane)
    taken += [_at_speed(speed_mps, tuple(lanes)) for speed_mps, lanes in belts.items()]
    return tuple(taken)


def feed(value: Any, _context: ConversionContext) -> Taken:
    """Convert a std_msgs/Bool: start or stop the feeders."""
    return (BusOutput(topics.SET_FEEDING, "", SetFeeding(feeding=bool(value.data))),)


def add_package(value: Any, context: ConversionContext) -> Taken:
    """Convert a std_msgs/UInt8: add an object of that kind to the first lane."""
    kind = context.state.kinds.kind(int(value.data))
    if kind is None:
        return (ConversionWarning(_no_kind("/add_package", int(value.data), context)),)
    return (BusOutput(topics.ADD_PACKAGE, "", AddPackage(kind=kind)),)


class AddPack:
    """Service `add_pack`: the caller chooses the number of the object."""

    def __init__(self) -> None:
        self._open: dict[int, Any] = {}
        """Open requests to our conveyor by requested number."""

    def asks(self, request: Any, context: ConversionContext) -> BusOutput | ConversionWarning:
        """Convert a request."""
        uid = int(request.uid)
        belt = int(request.belt)
        position = float(request.position)
        state = context.state
        taken = {state.uids.number(item.id) for item in state.tracked()}
        kind = state.kinds.kind(int(request.kind))
        lanes = state.lanes
        if kind is None:
            return ConversionWarning(_no_kind("add_pack", int(request.kind), context))
        if belt >= len(lanes):
            return ConversionWarning(
                f"add_pack: there is no belt {belt}: there are {len(lanes)}, counted from 0"
            )
        is_at_start = abs(position) <= AT_START
        if not (is_at_start or 0.0 <= position <= 1.0):
            return ConversionWarning(
                f"add_pack: position {position:g} was asked for: send 0 (start) to 1 (end)"
            )
        if uid > MAX_NUMBER or uid in self._open or uid in taken:
            return ConversionWarning(f"add_pack: uid {uid} is taken or beyond {MAX_NUMBER}: ask for another")
        self._open[uid] = request
        state.uids.reserve(uid)
        return BusOutput(
            topics.ADD_PACKAGE,
            "",
            AddPackage(kind=kind, lane=lanes[belt], position=None if is_at_start else position),
        )

    def answers(self, request: Any, reply: Reply | None, context: ConversionContext) -> Any:
        """Return the response, and bind the caller's number to the new object."""
        uids = context.state.uids
        uid = int(request.uid)
        if self._open.get(uid) is request:
            del self._open[uid]
            uids.end_reservation(uid)
            if isinstance(reply, AddPackageReply):
                uids.bind(uid, reply.object_id)
        is_added = isinstance(reply, AddPackageReply)
        return context.state.types.make("conveyor_msgs/srv/AddPack_Response", result=is_added)


def set_belt_speed(request: Any, _context: ConversionContext) -> BusOutput | ConversionWarning:
    """Convert a request to `set_belt_speed`: a speed for every belt."""
    speed_mps = float(request.speed)
    problem = _too_fast("set_belt_speed", speed_mps)
    return ConversionWarning(problem) if problem else _at_speed(speed_mps)


def reset(_request: Any, _context: ConversionContext) -> BusOutput | ConversionWarning:
    """Convert a request to empty the conveyor."""
    return BusOutput(topics.RESET_CONVEYOR, "", ResetConveyor())


def set_brightness(request: Any, context: ConversionContext) -> BusOutput | ConversionWarning:
    """Convert a request to dim all strips, or those with channels (`id` in `/led_strips`) in the mask."""
    brightness = float(request.brightness)
    mask = int(request.channel_index_mask)
    if not math.isfinite(brightness):
        return ConversionWarning(f"set_brightness: brightness {brightness} was asked for: send 0 to 1")
    strips: tuple[str, ...] = ()
    if mask != EVERY_STRIP:
        room = context.state.room
        channels = (
            {strip.id: context.state.channels.number(strip.id) for strip in room.strips} if room else {}
        )
        strips = tuple(name for name, number in channels.items() if mask >> number & 1)
        if not strips:
            there_are = ", ".join(f"{number} {name}" for name, number in channels.items()) or "none"
            return ConversionWarning(
                f"set_brightness: channel_index_mask {mask} means no strip: there are {there_are}; "
                f"{EVERY_STRIP} means all"
            )
    return BusOutput(
        topics.SET_BRIGHTNESS, "", SetBrightness(brightness=min(max(brightness, 0.0), 1.0), strips=strips)
    )


def set_yaw_origin(_request: Any, context: ConversionContext) -> BusOutput | ConversionWarning:
    """Convert a request to make the arm's current direction x of {H}."""
    return BusOutput(topics.SET_YAW_ORIGIN, context.name, SetYawOrigin())


def _at_speed(speed_mps: float, belts: tuple[str, ...] = ()) -> BusOutput:
    return BusOutput(topics.SET_SPEED, "", SetSpeed(speed_mps=speed_mps, belts=belts))


def _too_fast(who: str, speed_mps: float) -> str:
    if abs(speed_mps) <= FASTEST_MPS:
        return ""
    return f"{who}: a speed of {speed_mps:g} m/s was asked for: send one within ±{FASTEST_MPS:g} m/s"


def _no_kind(who: str, number: int, context: ConversionContext) -> str:
    return f"{who}: kind {number} means nothing here: there are {context.state.kinds}"
