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
    speeds = [float(speed_mps) for speed_mps in value.velocity]
    count = len(names)
    if not 0 < count <= MAX_BELTS or count != len(speeds):
        sentence = (
            f"/belt_cmd has {count} names and {len(speeds)} velocities: send one velocity for each, "
            f"at most {MAX_BELTS}"
        )
        return (ConversionWarning(sentence),)

    # Belts of equal speed become one command, after those for all belts
    outputs: list[BusOutput | ConversionWarning] = []
    belts: dict[float, list[str]] = {}
    for name, speed_mps in zip(names, speeds, strict=True):
        lane = None if name == ALL else lane_of(name, context.state.lanes)
        problem = _too_fast("/belt_cmd", speed_mps)
        if problem:
            outputs.append(ConversionWarning(problem))
        elif name == ALL:
            outputs.append(_at_speed(speed_mps))
        elif lane is None:
            lanes = first_of(context.state.lanes, 20) or "none"
            sentence = f"/belt_cmd: there is no belt {checks.named(name)}; there are {lanes}"
            outputs.append(ConversionWarning(sentence))
        else:
            belts.setdefault(speed_mps, []).append(lane)
    for speed_mps, lanes_of_speed in belts.items():
        outputs.append(_at_speed(speed_mps, tuple(lanes_of_speed)))
    return tuple(outputs)


def feed(value: Any, _context: ConversionContext) -> Taken:
    """Convert a std_msgs/Bool: start or stop the feeders."""
    command = SetFeeding(feeding=bool(value.data))
    return (BusOutput(topics.SET_FEEDING, "", command),)


def add_package(value: Any, context: ConversionContext) -> Taken:
    """Convert a std_msgs/UInt8: add an object of that kind to the first lane."""
    number = int(value.data)
    kind = context.state.kinds.kind(number)
    if kind is None:
        return (ConversionWarning(_no_kind("/add_package", number, context)),)
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
        used_uids = {state.uids.number(item.id) for item in state.tracked()}
        kind = state.kinds.kind(int(request.kind))
        lanes = state.lanes

        # Requests that the conveyor cannot carry out are refused with the permitted range
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
        is_used = uid in self._open or uid in used_uids
        if uid > MAX_NUMBER or is_used:
            return ConversionWarning(f"add_pack: uid {uid} is taken or beyond {MAX_NUMBER}: ask for another")

        # Until the answer no other object gets the number, and none is published without a settled one
        self._open[uid] = request
        state.uids.reserve(uid)
        command = AddPackage(kind=kind, lane=lanes[belt], position=None if is_at_start else position)
        return BusOutput(topics.ADD_PACKAGE, "", command)

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
        numbers = _channel_numbers(context)
        strips = tuple(name for name, number in numbers.items() if mask >> number & 1)
        if not strips:
            pairs = [f"{number} {name}" for name, number in numbers.items()]
            channels = ", ".join(pairs) or "none"
            return ConversionWarning(
                f"set_brightness: channel_index_mask {mask} means no strip: there are {channels}; "
                f"{EVERY_STRIP} means all"
            )
    command = SetBrightness(brightness=min(max(brightness, 0.0), 1.0), strips=strips)
    return BusOutput(topics.SET_BRIGHTNESS, "", command)


def _channel_numbers(context: ConversionContext) -> dict[str, int]:
    """Return the numbers of all strips of the map, by id."""
    room = context.state.room
    if room is None:
        return {}
    return {strip.id: context.state.channels.number(strip.id) for strip in room.strips}


def set_yaw_origin(_request: Any, context: ConversionContext) -> BusOutput | ConversionWarning:
    """Convert a request to make the arm's current direction x of {H}."""
    return BusOutput(topics.SET_YAW_ORIGIN, context.name, SetYawOrigin())


def _at_speed(speed_mps: float, belts: tuple[str, ...] = ()) -> BusOutput:
    return BusOutput(topics.SET_SPEED, "", SetSpeed(speed_mps=speed_mps, belts=belts))


def _too_fast(command: str, speed_mps: float) -> str:
    if abs(speed_mps) <= FASTEST_MPS:
        return ""
    limit = f"±{FASTEST_MPS:g} m/s"
    return f"{command}: a speed of {speed_mps:g} m/s was asked for: send one within {limit}"


def _no_kind(command: str, number: int, context: ConversionContext) -> str:
    return f"{command}: kind {number} means nothing here: there are {context.state.kinds}"
