"""Messages of an AGV by VDA 5050, versions 1.1 to 3.0: `connection`, `state` and `visualization`.

Names and units are those of the specification (https://github.com/VDA5050/VDA5050). Where version 3.0 has
another name, both are read. Fields that are not used here are ignored, since vendors add some.
"""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import AfterValidator, AliasChoices, Field, StringConstraints, model_validator
from pydantic_core import from_json

from pointit.vda5050.tolerant_model import (
    Count,
    Items,
    Json,
    Number,
    Seconds,
    Text,
    TolerantModel,
    Word,
    read_tolerantly,
)

MAX_BYTES = 1 << 20
"""Maximum size of a message."""
MAX_CHARGE = 110.0
"""Maximum percentage that is read, as full. Chargers overshoot, but 255 means something else."""

ACTIVE_STOPS = frozenset({"AUTOACK", "MANUAL", "REMOTE"})
MODES = frozenset({"AUTOMATIC", "SEMIAUTOMATIC", "MANUAL", "SERVICE", "TEACHIN", "STARTUP", "INTERVENED"})
HARMLESS_LEVELS = frozenset({"WARNING", "URGENT", "CRITICAL"})
"""Levels of errors with which an AGV accepts new orders."""
IF_UNREADABLE = {
    **dict.fromkeys(("positionInitialized", "position_initialized", "localized"), False),
    **dict.fromkeys(("errorLevel", "error_level"), "FATAL"),
}
"""Values of fields that state something unreadable, where the default would be harmless."""
LOST_CONNECTIONS = frozenset({"OFFLINE", "CONNECTIONBROKEN", "HIBERNATING"})


class _MessageWithHeader(TolerantModel):
    header_id: Annotated[int, Field(ge=0)] | None = None
    """Rises by 1 with each message of a topic, by the standard."""
    timestamp: Seconds = None
    """Unix s. Only differences count: some AGVs state their local time."""
    manufacturer: Text = ""
    serial_number: Text = ""


class AgvConnection(_MessageWithHeader):
    """Connection of the AGV to its broker. CONNECTIONBROKEN is its last will."""

    NEEDED: ClassVar[tuple[str, ...]] = ("connection_state",)
    KNOWN_WORDS: ClassVar[Mapping[str, frozenset[str]]] = {"connection_state": LOST_CONNECTIONS | {"ONLINE"}}

    connection_state: Word = ""


class AgvPosition(TolerantModel):
    """Pose on a map."""

    NEEDED: ClassVar[tuple[str, ...]] = ("theta", "position_initialized")

    x: Number
    y: Number
    theta: Annotated[float, Field(ge=-7.0, le=7.0)] | None = None
    map_id: Text = ""
    position_initialized: bool | None = Field(
        default=None, validation_alias=AliasChoices("positionInitialized", "localized")
    )
    """False if the message states something unreadable, None if it states nothing."""
    deviation_range: Annotated[float, Field(ge=0, le=1e6)] | None = None
    """Deviation of the position, m, if the AGV knows it."""

    @model_validator(mode="before")
    @classmethod
    def _with_coordinates(cls, data: Json) -> Json:
        """Add unused coordinates if the AGV does not know where it is, and states none.

        It knows only if neither the field of version 2 nor that of version 3 denies it.
        """
        if not isinstance(data, dict):
            return data
        flags = {f"{data.get(name)}".strip().lower() for name in ("positionInitialized", "localized")}
        if flags.isdisjoint(("false", "0", "no")):
            return data
        unused = {name: 0.0 for name in ("x", "y", "theta") if data.get(name) is None}
        return data | unused | {"positionInitialized": False}


class Velocity(TolerantModel):
    """Velocity in the AGV's own frame, m/s; x is forward."""

    vx: Number | None = None
    vy: Number = 0.0


class Visualization(_MessageWithHeader):
    """Pose and velocity, more often than the state."""

    agv_position: AgvPosition | None = Field(
        default=None, validation_alias=AliasChoices("agvPosition", "mobileRobotPosition")
    )
    velocity: Velocity | None = None


class ActionState(TolerantModel):
    """Progress of an action."""

    action_id: Text
    action_status: Word


class Reference(TolerantModel):
    """Subject of an error."""

    reference_key: Text = ""
    reference_value: Text = ""


class AgvError(TolerantModel):
    """Active error."""

    NEEDED: ClassVar[tuple[str, ...]] = ("error_level",)
    KNOWN_WORDS: ClassVar[Mapping[str, frozenset[str]]] = {"error_level": HARMLESS_LEVELS | {"FATAL"}}

    error_type: Text = "error"
    error_level: Word = ""
    """Required in versions 1.1 to 3.0. An error without it may be FATAL: then the AGV needs help."""
    error_description: Annotated[str, StringConstraints(max_length=10_000)] = ""
    error_references: Annotated[list[Reference], Items] = Field(default_factory=list[Reference])

    def describe(self) -> str:
        """Return type and description, on one short line."""
        description = " ".join(self.error_description.split())[:160]
        return f"{self.error_type}: {description}" if description else self.error_type

    def is_about(self, key: str, value: str, *, default: bool = False) -> bool:
        """Return True if a reference of the error has this key and value; `default` if none has the key."""
        values = [each.reference_value for each in self.error_references if each.reference_key == key]
        return value in values if values else default


def _percent(charge: float) -> float:
    """Return a charge in percent.

    Raises:
        ValueError: If it may be a share.
    """
    if 0.0 < charge < 1.0:
        raise ValueError("may be a share")
    return charge


class BatteryState(TolerantModel):
    """Battery."""

    battery_charge: Annotated[float, Field(ge=0, le=MAX_CHARGE), AfterValidator(_percent)] | None = Field(
        default=None, validation_alias=AliasChoices("batteryCharge", "stateOfCharge")
    )
    """Percent."""


class SafetyState(TolerantModel):
    """Emergency stop."""

    NEEDED: ClassVar[tuple[str, ...]] = ("e_stop",)
    KNOWN_WORDS: ClassVar[Mapping[str, frozenset[str]]] = {"e_stop": ACTIVE_STOPS | {"NONE"}}

    e_stop: Word = Field(default="", validation_alias=AliasChoices("eStop", "activeEmergencyStop"))


class AgvState(Visualization):
    """State of the AGV: sent when it changes, else every 30 s at the latest."""

    NEEDED: ClassVar[tuple[str, ...]] = ("driving", "operating_mode", "safety_state")
    KNOWN_WORDS: ClassVar[Mapping[str, frozenset[str]]] = {"operating_mode": MODES}

    order_id: Text = ""
    order_update_id: Count = 0
    last_node_id: Text = ""
    last_node_sequence_id: Count = 0
    node_states: Annotated[list[Any] | None, Items] = None
    """Nodes that are still to be reached. Their number counts, not their content."""
    action_states: Annotated[list[ActionState], Items] = Field(default_factory=list[ActionState])
    driving: bool | None = None
    paused: bool = False
    operating_mode: Word = ""
    errors: Annotated[list[AgvError], Items] = Field(default_factory=list[AgvError])
    battery_state: BatteryState | None = Field(
        default=None, validation_alias=AliasChoices("batteryState", "powerSupply")
    )
    safety_state: SafetyState | None = None

    @property
    def charge(self) -> float | None:
        """Return the charge of the battery, percent, or None if it is unknown."""
        charge = self.battery_state.battery_charge if self.battery_state else None
        return charge if charge is None else min(charge, 100.0)

    @property
    def is_executing(self) -> bool:
        """Return True if the AGV carries out an order, also if it does not say that it is idle."""
        return self.driving is not False if self.node_states is None else bool(self.node_states)


M = TypeVar("M", bound=_MessageWithHeader)


def parse(kind: type[M], payload: object) -> M | None:
    """Return the message of `kind` in the payload of an MQTT message, or None if it is none."""
    if not isinstance(payload, bytes | bytearray) or len(payload) > MAX_BYTES:
        return None
    text = bytes(payload).decode("utf-8-sig", "replace").rstrip("\0")
    try:
        message = read_tolerantly(kind, from_json(text), IF_UNREADABLE)
    except ValueError:  # no JSON
        return None
    return message if message and message.model_fields_set else None


def blocked_by(state: AgvState) -> str:
    """Return an error message with a remedy if the AGV carries out no order, or may not, else `""`."""
    if not state.operating_mode:
        return "the AGV does not state its operatingMode: update its software"
    if state.operating_mode not in ("AUTOMATIC", "SEMIAUTOMATIC"):
        return f"the AGV is in mode {state.operating_mode[:30]}: switch it to AUTOMATIC"
    e_stop = state.safety_state.e_stop if state.safety_state else ""
    if e_stop in ACTIVE_STOPS:
        return "the emergency stop of the AGV is active: release it at the vehicle"
    if e_stop != "NONE":
        return (
            f"safetyState.eStop is {e_stop[:30] or 'not stated'}, so the emergency stop of the AGV may be "
            "active: update its software, which has to state NONE, AUTOACK, MANUAL or REMOTE"
        )
    if "errors" in state.unreadable:
        return f"errors {state.unreadable['errors']}: look after the AGV, and update its software"
    fatal = next((error for error in state.errors if error.error_level not in HARMLESS_LEVELS), None)
    if fatal is None:
        return ""
    if not fatal.error_level:
        return (
            f"the AGV states an error without errorLevel, which may be FATAL ({fatal.describe()}): look "
            "after it, and update its software"
        )
    return f"the AGV needs help ({fatal.describe()}): look after it"
