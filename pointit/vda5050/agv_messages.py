"""Messages of an AGV by VDA 5050, versions 1.1 to 3.0: topics, fields read one by one, and order.

Names and units are those of the specification (https://github.com/VDA5050/VDA5050). Where version 3.0 has
another name, both are read. Fields that are not used here are ignored, since vendors add some.
"""

import datetime as dt
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

KINDS = ("connection", "state", "visualization")
MAX_PREFIX_LEVELS = 4
"""Maximum number of levels before the manufacturer. The standard has two; some sites have others."""

_VERSION = re.compile(r"v?(\d)(\.\d+)*\Z", re.IGNORECASE)


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

    @property
    def major(self) -> str:
        """Return the major version of VDA 5050 that the prefix ends with (`v2`, `2.0`), or `""`."""
        match = _VERSION.match(self.prefix.rpartition("/")[2])
        return match[1] if match else ""


def agv_of_topic(topic: str) -> AgvTopic | None:
    """Return the AGV of a topic, or None if it belongs to no AGV."""
    prefix, *last = topic.rsplit("/", 3)
    if len(last) < 3 or prefix.count("/") >= MAX_PREFIX_LEVELS:
        return None
    manufacturer, serial_number, kind = last
    is_of_agv = manufacturer and serial_number and kind in KINDS
    return AgvTopic(prefix, manufacturer, serial_number, kind) if is_of_agv else None


def agv_topics() -> tuple[str, ...]:
    """Return the patterns that match the topics of every AGV."""
    return tuple(
        f"{'+/' * (levels + 2)}{kind}" for kind in KINDS for levels in range(1, MAX_PREFIX_LEVELS + 1)
    )


COUNTS = 1 << 32
"""Number of different values of a counter."""
MAX_ERRORS = 1000
"""Maximum number of errors of a message of which the rest is used."""
MAX_ROUNDS = 8
"""Maximum number of times that a message is read: parts are nested less deeply."""
MAX_SHOWN = 40
"""Maximum number of characters of a value in a sentence."""
MAX_NAMES = 4
"""Maximum number of fields in a sentence."""

Json = dict[str, Any] | list[Any] | str | float | None
"""Decoded JSON."""


def _word(value: object) -> str:
    """Return a value of an enumeration in the spelling of version 2: `Auto_Ack` is AUTOACK."""
    if not isinstance(value, str | int | float):
        raise ValueError("is no word")  # noqa: TRY004 - pydantic takes ValueError
    return "".join(each for each in str(value).upper() if each.isalnum())[:MAX_SHOWN]


def _time(value: object) -> object:
    """Return the time of an ISO 8601 timestamp, Unix s, and numbers as they are."""
    if not isinstance(value, str):
        return value
    text = value.strip()
    try:
        return float(text) if text else None
    except ValueError:
        time = dt.datetime.fromisoformat(text)
        return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()


def _seconds(value: float) -> float:
    """Return the s of a time in s, ms, µs or ns."""
    for _ in range(3):
        value = value / 1000.0 if value > 1e11 else value
    return value


def _items(value: object) -> object:
    """Return a list. Lua writes an empty one as an empty object."""
    return [] if value == {} else value


Text = Annotated[str, StringConstraints(max_length=500)]
Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Count = Annotated[int, Field(ge=0, lt=COUNTS)]
Seconds = Annotated[Annotated[float, AfterValidator(_seconds)] | None, BeforeValidator(_time)]
Word = Annotated[str, BeforeValidator(_word)]
"""Value of an enumeration. Unknown ones are kept, for the caller to decide about."""
Items = BeforeValidator(_items)


class TolerantModel(BaseModel):
    """A message, or a part of one, that `read_tolerantly` makes."""

    model_config = ConfigDict(
        frozen=True,
        extra="ignore",
        allow_inf_nan=False,
        alias_generator=to_camel,
        populate_by_name=True,
        coerce_numbers_to_str=True,
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
        return {name: each for name, each in data.items() if each is not None}

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


T = TypeVar("T", bound=TolerantModel)


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

    def describe(self, topic: str, message: TolerantModel) -> str:
        """Return a sentence with a remedy if fields of the newest `message` are unreadable, else `""`."""
        self._first = {name: self._first.get(name, what) for name, what in message.unreadable.items()}
        if not self._first:
            return ""
        listed = ", ".join(f"{name} {what}" for name, what in list(self._first.items())[:MAX_NAMES])
        others = len(self._first) - MAX_NAMES
        more = f" and {others} more" if others > 0 else ""
        return (
            f"{topic[:200]}: {listed}{more}; correct it at the AGV, or update its software to keep VDA 5050"
        )


def _remove(
    data: Any, error: ValidationError, problems: dict[str, str], if_unreadable: Mapping[str, object]
) -> bool:
    """Remove from `data` what is in `error`, and add it to `problems`. Return False if nothing is left."""
    paths: set[tuple[str | int, ...]] = set()
    for each in error.errors(include_url=False):
        path, value = each["loc"], each["input"]
        name = next((step for step in reversed(path) if isinstance(step, str)), "")
        if each["type"] == "missing":
            path, value = path[:-1], "missing"
            problems.setdefault(name, "is missing")
        elif value is not None:
            problems.setdefault(name, f"is {_shorten(repr(value))}")
        if not path:
            return False
        paths.add(path)
    for path in sorted(paths, reverse=True):  # the last items of lists first, which keeps the other indices
        part = data
        for step in path[:-1]:
            part = part[step]
        if path[-1] in if_unreadable:
            part[path[-1]] = if_unreadable[path[-1]]
        else:
            del part[path[-1]]
    return True


def _shorten(text: str) -> str:
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


LATE_IDS = 100
"""A header id that is behind the newest by at most this belongs to a message that comes late. One that is
farther behind is that of an AGV that has started to count again."""
LATE_S = 10.0
"""A message is not later than this, s. A timestamp that is farther back is that of a clock that was set."""
MAX_LATE = 2
"""Maximum number of messages in a row that are late by their header ids only. With the next one, the AGV has
started to count again."""


class HeaderCheck:
    """Recognizes messages of one topic that come late, or twice, as far as header id and timestamp tell."""

    def __init__(self) -> None:
        self._header_id: int | None = None
        """That of the newest message, or None if it states none."""
        self._stamp_s: float | None = None
        self._has_varied = False
        """True if the header id tells the newest message from the one before. A time may be in whole s."""
        self._late_count = 0

    def is_new(self, header_id: int | None, stamp_s: float | None = None) -> bool:
        """Return True unless the message is certainly late or a repetition.

        A counter that starts again, is constant or is missing never suppresses messages for long.

        Args:
            header_id: None if the message states none.
            stamp_s: its timestamp, Unix s, or None if it states none.
        """
        step, later_s = self._step(header_id), self._later_s(stamp_s)
        if self._is_late(step, later_s):
            self._late_count += 1
            if -LATE_S <= later_s < 0.0 or self._late_count <= MAX_LATE:
                return False
        self._has_varied = step != 0
        self._late_count = 0
        self._header_id, self._stamp_s = header_id, stamp_s
        return True

    def forget(self) -> None:
        """Accept any message next: the AGV, or the connection, is a new one."""
        self._header_id = self._stamp_s = None
        self._has_varied = False

    def _step(self, header_id: int | None) -> int:
        """Return the header id relative to that of the newest message, 0 if it does not tell."""
        if self._header_id is None or header_id is None:
            return 0
        return (header_id - self._header_id + COUNTS // 2) % COUNTS - COUNTS // 2

    def _later_s(self, stamp_s: float | None) -> float:
        return 0.0 if self._stamp_s is None or stamp_s is None else stamp_s - self._stamp_s

    def _is_late(self, step: int, later_s: float) -> bool:
        if step > 0 or step < -LATE_IDS or later_s > 0.0:
            return False
        return step < 0 or -LATE_S <= later_s < 0.0 or (later_s == 0.0 and self._has_varied)


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
