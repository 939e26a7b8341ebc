"""Messages of an AGV by VDA 5050, versions 1.1 to 3.0: topics, models, and order.

Names, words and units are those of the specification (https://github.com/VDA5050/VDA5050). Where version 3.0
has another name or word, both are read. Fields that are not used here are ignored, since vendors add some.
"""

import datetime as dt
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

from pydantic import (
    AfterValidator,
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    StringConstraints,
    ValidationError,
    model_validator,
)
from pydantic.alias_generators import to_camel
from pydantic_core import from_json

from pointit.schemas import NS_PER_S
from pointit.schemas.text import first_of, one_line

T = TypeVar("T", bound="TolerantModel")
Json = dict[str, Any] | list[Any] | str | float | None
"""Decoded JSON."""

Text = Annotated[str, StringConstraints(max_length=500)]
Number = Annotated[float, Field(ge=-1e6, le=1e6)]

KINDS = ("connection", "state", "visualization")
STANDARD_PREFIX = re.compile(r"[^/]+/v\d")
"""Levels before the manufacturer by the standard: interface and major version."""

COUNTS = 1 << 32
"""Number of different values of a counter."""
MAX_ERRORS = 1000
"""Maximum number of errors of a message of which the rest is used."""
MAX_ROUNDS = 8
"""Maximum number of times that a message is read: parts are nested less deeply."""
MAX_SHOWN = 40
"""Maximum number of characters of a value in a sentence."""

Word = Annotated[str, StringConstraints(max_length=MAX_SHOWN)]
"""Value of an enumeration. Unknown ones are kept, for the caller to decide about."""

MAX_NAMES = 4
"""Maximum number of fields in a sentence."""
LATE_S = 10.0
"""A message is not later than this, s. A timestamp that is farther back is that of a clock that was set."""

MAX_BYTES = 1 << 20
"""Maximum size of a message."""

ACTIVE_STOPS = frozenset({"AUTOACK", "MANUAL", "REMOTE"})
MODES = frozenset({"AUTOMATIC", "SEMIAUTOMATIC", "MANUAL", "SERVICE", "TEACHIN", "TEACH_IN"})

HARMLESS_LEVELS = frozenset({"WARNING", "URGENT", "CRITICAL"})
"""Levels of errors with which an AGV accepts new orders."""
IF_UNREADABLE = {**dict.fromkeys(("positionInitialized", "localized"), False), "errorLevel": "FATAL"}
"""Values of fields that state something unreadable, where the default would be harmless."""
LOST_CONNECTIONS = frozenset({"OFFLINE", "CONNECTIONBROKEN", "CONNECTION_BROKEN", "HIBERNATING"})


class AgvTopic(NamedTuple):
    """Topic of an AGV."""

    prefix: str
    """Levels before the manufacturer."""
    manufacturer: str
    serial_number: str
    kind: str
    """One of `KINDS`."""

    @property
    def name(self) -> str:
        """Return the name of the AGV, `MANUFACTURER/SERIAL_NUMBER`."""
        return f"{self.manufacturer}/{self.serial_number}"


def agv_of_topic(topic: str, prefix: str = "") -> AgvTopic | None:
    """Return the AGV of a topic below `prefix`, by default as in the standard, or None if it has none."""
    first, *last = topic.rsplit("/", 3)
    is_below = first == prefix if prefix else STANDARD_PREFIX.fullmatch(first)
    if len(last) < 3 or not is_below:
        return None
    manufacturer, serial_number, kind = last
    if not manufacturer or not serial_number:
        return None
    if kind not in KINDS:
        return None
    return AgvTopic(first, manufacturer, serial_number, kind)


def agv_topics(prefix: str = "") -> tuple[str, ...]:
    """Return the patterns of the topics of every AGV below `prefix`, by default as in the standard."""
    root = prefix or "+/+"
    return tuple(f"{root}/+/+/{kind}" for kind in KINDS)


def _time(text: object) -> float:
    """Return the time of an ISO 8601 timestamp, Unix s. Raises ValueError if it is none."""
    if not isinstance(text, str):
        raise ValueError("is no text")  # noqa: TRY004 - pydantic takes ValueError
    time = dt.datetime.fromisoformat(text)
    return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()


def _whole(value: object) -> object:
    """Return 5 for 5.0, which is an integer in JSON too."""
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


Count = Annotated[int, BeforeValidator(_whole), Field(ge=0, lt=COUNTS)]
Seconds = Annotated[float, BeforeValidator(_time)]


class TolerantModel(BaseModel):
    """A message, or a part of one, that `read_tolerantly` makes."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="ignore", allow_inf_nan=False, alias_generator=to_camel
    )

    NEEDED: ClassVar[tuple[str, ...]] = ()
    """Fields that are reported if they are missing, since there is no value to assume."""
    KNOWN_WORDS: ClassVar[Mapping[str, frozenset[str]]] = {}
    """Fields of type `Word` of which other values are reported."""

    _unreadable: dict[str, str] = PrivateAttr(default_factory=dict[str, str])

    @model_validator(mode="before")
    @classmethod
    def _without_nulls(cls, data: Json) -> Json:
        if not isinstance(data, dict):
            return data
        return {name: value for name, value in data.items() if value is not None}

    @property
    def unreadable(self) -> Mapping[str, str]:
        """Return the problem of each field of the message that cannot be read, by its name."""
        return self._unreadable

    def model_post_init(self, context: Any, /) -> None:
        """Report missing and unknown values in `context`, the problems of the message by field."""
        if context is None:
            return
        self._unreadable = context
        for name in self.NEEDED:
            if getattr(self, name) in (None, ""):
                context.setdefault(self._label(name), "is missing")
        for name, words in self.KNOWN_WORDS.items():
            word = getattr(self, name)
            if word and word not in words:
                context.setdefault(self._label(name), f"is {word!r}")

    @classmethod
    def _label(cls, name: str) -> str:
        """Return the name of a field in version 2 of the standard."""
        field = cls.model_fields[name]
        if isinstance(field.validation_alias, AliasChoices):
            return str(field.validation_alias.choices[0])
        return field.alias or name


def read_tolerantly(kind: type[T], data: Any, if_unreadable: Mapping[str, object]) -> T | None:
    """Return the message in decoded JSON, or None if it is none.

    Null counts as missing. Unreadable values are removed from `data`, so that their fields have the defaults,
    and unreadable items are removed from lists. A part of which a required field is unreadable is so itself.

    Args:
        kind: the class of the message.
        data: changed.
        if_unreadable: values instead of unreadable ones, by field, where the default must not be assumed.
    """
    problems: dict[str, str] = {}
    for _ in range(MAX_ROUNDS):
        try:
            return kind.model_validate(data, context=problems)
        except ValidationError as error:
            if error.error_count() > MAX_ERRORS or not _remove(data, error, problems, if_unreadable):
                return None
    return None


class UnreadableFields:
    """Unreadable fields of the messages of one topic, each with the value that was seen first."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}

    def describe(self, topic: str, model: TolerantModel) -> str:
        """Return a sentence with a remedy if fields of the newest `model` are unreadable, else `""`."""
        # a field keeps its first description: one that changes with each message would be logged each time
        unreadable = model.unreadable
        self._first = {name: self._first.get(name, problem) for name, problem in unreadable.items()}
        if not self._first:
            return ""
        problems = [f"{name} {problem}" for name, problem in self._first.items()]
        listed = first_of(problems, MAX_NAMES)
        return f"{topic[:200]}: {listed}; correct it at the AGV, or update its software to keep VDA 5050"


def _remove(
    data: Any, error: ValidationError, problems: dict[str, str], if_unreadable: Mapping[str, object]
) -> bool:
    """Remove from `data` what is in `error`, and add it to `problems`. Return False if nothing is left."""
    # What is to be removed: of a missing field, the object that lacks it
    paths: set[tuple[str | int, ...]] = set()
    for detail in error.errors(include_url=False):
        path = detail["loc"]
        value = detail["input"]
        names = (step for step in reversed(path) if isinstance(step, str))
        name = next(names, "")
        if detail["type"] == "missing":
            path = path[:-1]
            value = "missing"
            problems.setdefault(name, "is missing")
        elif value is not None:
            problems.setdefault(name, f"is {one_line(repr(value), MAX_SHOWN)}")
        if not path:
            return False
        paths.add(path)

    # The last items of lists first, which keeps the other indices
    for path in sorted(paths, reverse=True):
        part = data
        for step in path[:-1]:
            part = part[step]
        if path[-1] in if_unreadable:
            part[path[-1]] = if_unreadable[path[-1]]
        else:
            del part[path[-1]]
    return True


class TimestampCheck:
    """Recognizes messages of one topic that come late, by their timestamps."""

    def __init__(self) -> None:
        self._stamp_s: float | None = None
        """That of the newest message, or None if it states none."""

    def is_new(self, stamp_s: float | None) -> bool:
        """Return True unless the message is late.

        Args:
            stamp_s: its timestamp, Unix s, or None if it states none.
        """
        if self._stamp_s is not None and stamp_s is not None:
            passed_s = stamp_s - self._stamp_s
            if -LATE_S <= passed_s < 0.0:
                return False
        self._stamp_s = stamp_s
        return True

    def forget(self) -> None:
        """Accept any message next: the AGV, or the connection, is a new one."""
        self._stamp_s = None


MODES |= {"STARTUP", "INTERVENED"}


class _MessageWithHeader(TolerantModel):
    timestamp: Seconds | None = None
    """Unix s."""
    manufacturer: Text = ""
    serial_number: Text = ""

    @property
    def stamp_ns(self) -> int | None:
        """Return the timestamp, Unix ns, or None if the message states none."""
        return None if self.timestamp is None else round(self.timestamp * NS_PER_S)


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
        if False not in (data.get("positionInitialized"), data.get("localized")):
            return data
        names = ("x", "y", "theta")
        unused = {name: 0.0 for name in names if data.get(name) is None}
        return data | unused | {"positionInitialized": False}


class AgvVelocity(TolerantModel):
    """Velocity in the AGV's own frame, m/s; x is forward."""

    vx: Number = 0.0
    vy: Number = 0.0


class Visualization(_MessageWithHeader):
    """Pose and velocity, more often than the state."""

    agv_position: AgvPosition | None = Field(
        default=None, validation_alias=AliasChoices("agvPosition", "mobileRobotPosition")
    )
    velocity: AgvVelocity | None = None

    @property
    def velocity_mps(self) -> tuple[float, float]:
        """Return the velocity on the map, m/s, 0 if the message states none."""
        theta_rad = self.agv_position.theta if self.agv_position else None
        if self.velocity is None or theta_rad is None:
            return (0.0, 0.0)
        cos = math.cos(theta_rad)
        sin = math.sin(theta_rad)
        vx = self.velocity.vx
        vy = self.velocity.vy
        return (cos * vx - sin * vy, sin * vx + cos * vy)


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
    error_references: list[Reference] = Field(default_factory=list[Reference])

    def describe(self) -> str:
        """Return type and description, on one short line."""
        description = " ".join(self.error_description.split())[:160]
        return f"{self.error_type}: {description}" if description else self.error_type

    def is_about(self, key: str, value: str, *, default: bool = False) -> bool:
        """Return True if a reference of the error has this key and value; `default` if none has the key."""
        values: list[str] = []
        for reference in self.error_references:
            if reference.reference_key == key:
                values.append(reference.reference_value)
        return value in values if values else default


def _percent(charge: float) -> float:
    """Return a plausible charge, percent: no AGV drives with less than 1. Raises ValueError if it is none."""
    if 0.0 < charge < 1.0:
        raise ValueError("is below 1 %")
    return charge


class BatteryState(TolerantModel):
    """Battery."""

    battery_charge: Annotated[float, Field(ge=0, le=100), AfterValidator(_percent)] | None = Field(
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
    node_states: list[Any] | None = None
    """Nodes that are still to be reached. Their number counts, not their content."""
    action_states: list[ActionState] = Field(default_factory=list[ActionState])
    driving: bool | None = None
    paused: bool = False
    operating_mode: Word = ""
    errors: list[AgvError] = Field(default_factory=list[AgvError])
    battery_state: BatteryState | None = Field(
        default=None, validation_alias=AliasChoices("batteryState", "powerSupply")
    )
    safety_state: SafetyState | None = None

    @property
    def charge(self) -> float | None:
        """Return the charge of the battery, percent, or None if it is unknown."""
        return self.battery_state.battery_charge if self.battery_state else None

    @property
    def is_executing(self) -> bool:
        """Return True if the AGV carries out an order, also if it does not say that it is idle."""
        return self.driving is not False if self.node_states is None else bool(self.node_states)


M = TypeVar("M", bound=_MessageWithHeader)


def parse(kind: type[M], payload: object) -> M | None:
    """Return the message of `kind` in the payload of an MQTT message, or None if it is none."""
    if not isinstance(payload, bytes | bytearray) or len(payload) > MAX_BYTES:
        return None
    try:
        message = read_tolerantly(kind, from_json(bytes(payload)), IF_UNREADABLE)
    except ValueError:  # no JSON
        return None
    if not message or not message.model_fields_set:
        return None
    return message


def blocked_by(state: AgvState) -> str:
    """Return an error message with a remedy if the AGV carries out no order, or may not, else `""`."""
    if not state.operating_mode:
        return "the AGV does not state its operatingMode: update its software"
    if state.operating_mode not in ("AUTOMATIC", "SEMIAUTOMATIC"):
        return f"the AGV is in mode {state.operating_mode[:30]}: switch it to AUTOMATIC"

    # Only a stated NONE shows that the AGV may drive
    e_stop = state.safety_state.e_stop if state.safety_state else ""
    if e_stop in ACTIVE_STOPS:
        return "the emergency stop of the AGV is active: release it at the vehicle"
    if e_stop != "NONE":
        return (
            f"safetyState.eStop is {e_stop[:30] or 'not stated'}, so the emergency stop of the AGV may be "
            "active: update its software, which has to state NONE, AUTOACK, MANUAL or REMOTE"
        )

    # An error that cannot be read, or has an unknown level, may be fatal
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
