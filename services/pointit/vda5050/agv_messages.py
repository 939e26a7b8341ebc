"""Messages of an AGV by VDA 5050, versions 1.1 to 2.1: `connection`, `state` and `visualization`.

Names and units are those of the specification (https://github.com/VDA5050/VDA5050). Fields that are not used
here are ignored, since vendors add some. What is kept is bounded.
"""

import math
from typing import Annotated, Literal, NamedTuple, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError
from pydantic.alias_generators import to_camel

MAX_BYTES = 1 << 20
"""Maximum size of a message."""
HEADER_IDS = 1 << 32
"""Number of different header ids."""
LATE_IDS = 100
"""A header id that is behind the newest by at most this belongs to a message that comes late. One that is
farther behind is that of an AGV that has started to count again."""

SHORTEST_S = 0.02
"""Shortest time from which a velocity is computed, s."""
SAME_M = 0.01
"""Distance below which two places are the same, m."""

Text = Annotated[str, StringConstraints(max_length=500)]
Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Count = Annotated[int, Field(ge=0, lt=HEADER_IDS)]


class _Part(BaseModel):
    """Base of messages and their parts."""

    model_config = ConfigDict(
        frozen=True, extra="ignore", allow_inf_nan=False, alias_generator=to_camel, populate_by_name=True
    )


class _Headed(_Part):
    header_id: Count = 0
    """Rises by 1 with each message of a topic."""
    manufacturer: Text = ""
    serial_number: Text = ""


class Connection(_Headed):
    """Connection of the AGV to its broker. CONNECTIONBROKEN is its last will."""

    connection_state: Literal["ONLINE", "OFFLINE", "CONNECTIONBROKEN"]


class AgvPosition(_Part):
    """Pose on a map."""

    x: Number
    y: Number
    theta: Annotated[float, Field(ge=-7.0, le=7.0)] = 0.0
    map_id: Text = ""
    position_initialized: bool = True
    deviation_range: Annotated[float, Field(ge=0, le=1e6)] | None = None
    """Deviation of the position, m, if the AGV knows it."""


class Velocity(_Part):
    """Velocity in the AGV's own frame, m/s; x is forward."""

    vx: Number = 0.0
    vy: Number = 0.0


class Visualization(_Headed):
    """Pose and velocity, more often than the state."""

    agv_position: AgvPosition | None = None
    velocity: Velocity | None = None


class NodeState(_Part):
    """Node that is still to be reached."""

    node_id: Text
    sequence_id: Count


class ActionState(_Part):
    """Progress of an action."""

    action_id: Text
    action_status: Text


class Reference(_Part):
    """Subject of an error."""

    reference_key: Text = ""
    reference_value: Text = ""


class AgvError(_Part):
    """Active error."""

    error_type: Text
    error_level: Text = "WARNING"
    error_description: Annotated[str, StringConstraints(max_length=10_000)] = ""
    error_references: list[Reference] = []

    def describe(self) -> str:
        """Return type and description, on one short line."""
        told = " ".join(self.error_description.split())[:160]
        return f"{self.error_type}: {told}" if told else self.error_type

    def is_about(self, key: str, value: str, *, default: bool = False) -> bool:
        """Return True if a reference of the error has this key and value; `default` if none has the key."""
        values = [each.reference_value for each in self.error_references if each.reference_key == key]
        return value in values if values else default


class BatteryState(_Part):
    """Battery."""

    battery_charge: Annotated[float, Field(ge=0, le=100)]
    """Percent."""


class SafetyState(_Part):
    """Emergency stop."""

    e_stop: Text = "NONE"


class State(Visualization):
    """State of the AGV: sent when it changes, else every 30 s at the latest."""

    order_id: Text = ""
    order_update_id: Count = 0
    last_node_id: Text = ""
    last_node_sequence_id: Count = 0
    node_states: list[NodeState]
    action_states: list[ActionState] = []
    driving: bool = False
    paused: bool = False
    operating_mode: Text = "AUTOMATIC"
    errors: list[AgvError] = []
    battery_state: BatteryState | None = None
    safety_state: SafetyState = SafetyState()


M = TypeVar("M", bound=_Headed)


def parse(kind: type[M], payload: object) -> M | None:
    """Return the message of `kind` in the payload of an MQTT message, or None if it is none."""
    if not isinstance(payload, bytes | bytearray) or len(payload) > MAX_BYTES:
        return None
    try:
        return kind.model_validate_json(bytes(payload))
    except ValidationError:
        return None


class LastPose(NamedTuple):
    """An AGV as it was seen before."""

    place: tuple[float, float]
    """On its map, m."""
    velocity: tuple[float, float]
    """On its map, m/s."""
    age_s: float


def velocity_on_map(message: Visualization, last: LastPose | None) -> tuple[float, float]:
    """Return the velocity on the map, m/s, towards where the AGV has gone since `last`.

    AGVs state its direction in their own frame, as the standard wants, or in that of the map, and some state
    no velocity at all.
    """
    position, velocity = message.agv_position, message.velocity
    if position is None or (velocity is None and last is None):
        return (0.0, 0.0)
    gone = (position.x - last.place[0], position.y - last.place[1]) if last else (0.0, 0.0)
    gone_m = math.hypot(*gone)
    if velocity is None:
        if last is not None and last.age_s < SHORTEST_S:
            return last.velocity
        speed_mps = gone_m / last.age_s if last else 0.0
    else:
        speed_mps = math.hypot(velocity.vx, velocity.vy)
    if gone_m > SAME_M:
        return (speed_mps * gone[0] / gone_m, speed_mps * gone[1] / gone_m)
    if velocity is None:
        return (0.0, 0.0)
    azimuth_rad = position.theta + math.atan2(velocity.vy, velocity.vx)
    return (speed_mps * math.cos(azimuth_rad), speed_mps * math.sin(azimuth_rad))


class HeaderCheck:
    """Tells messages of one topic that come late, or twice."""

    def __init__(self) -> None:
        self._newest: int | None = None

    def is_new(self, header_id: int) -> bool:
        """Return True if the message is newer than those before, or the AGV has started to count again."""
        if self._newest is not None and (self._newest - header_id) % HEADER_IDS <= LATE_IDS:
            return False
        self._newest = header_id
        return True

    def forget(self) -> None:
        """Accept any header id next: the AGV, or the connection, is a new one."""
        self._newest = None


def blocked_by(state: State) -> str:
    """Return an error message with a remedy if the AGV carries out no order, else `""`."""
    if state.operating_mode not in ("AUTOMATIC", "SEMIAUTOMATIC"):
        return f"the AGV is in mode {state.operating_mode[:30]}: switch it to AUTOMATIC"
    if state.safety_state.e_stop != "NONE":
        return "the emergency stop of the AGV is active: release it at the vehicle"
    fatal = next((error for error in state.errors if error.error_level == "FATAL"), None)
    return f"the AGV needs help ({fatal.describe()}): look after it" if fatal else ""
