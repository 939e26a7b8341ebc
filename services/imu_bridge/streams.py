"""Content of a stream: the quaternion in JSON of apps and sketches, and the choice of one sensor."""

import codecs
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeGuard

from pointit.geometry.rotation import Quaternion
from pointit.runtime.config.parameters import set_option
from pointit.schemas.base import unit_quaternion
from pointit.schemas.printable import is_printable
from pointit.schemas.text import first_of

Order = Literal["wxyz", "xyzw"]
"""Order of a quaternion's numbers in a list."""

MAX_SENSORS = 8
"""Number of sensors of a stream that are remembered."""
MIN_READINGS = 3
"""Number of readings that prove a sensor: a name in a damaged line comes once."""
FORGET_AFTER = 500
"""Number of readings after which a silent sensor is forgotten."""

PROOF = 64
"""Number of rises in succession that prove the number of a message: more than a stream has sensors."""
MAX_DIGITS = 20
"""Number of digits from which a name is no number."""
MAX_KINDS = 16
"""Number of kinds of messages that are counted one by one."""
MAX_SHOWN_KINDS = 4
"""Maximum number of kinds that a warning names."""
MORE_KINDS = "other kinds"
"""Kind of the messages beyond `MAX_KINDS`."""

QUOTED_BYTES = 40
"""Number of bytes of a line that a message shows."""
MIN_READABLE = 0.8
"""Smallest share of readable characters in text."""
_UNREADABLE = "\ufffd"
ID_FIELDS = ("sensor", "id", "name", "device")
"""Names of fields that name the sensor."""
MAX_NAME = 64
"""Largest number of characters of a sensor's name."""
_LISTS = frozenset({"quaternion", "quat", "q"})
"""Names of fields with a list of four numbers, or an object with w, x, y and z."""
_COMPONENT = re.compile(r"(|q|quat|quat_)([wxyz])", re.IGNORECASE)


class PassedOver:
    """Numbers of valid messages that no reader needs, by their kind."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        """At most `MAX_KINDS`. Messages of later kinds are counted as `MORE_KINDS`."""

    def add(self, kind: str) -> None:
        """Count a message of `kind`, such as the letter or the address with which it begins."""
        kind = kind[:MAX_NAME]
        if kind not in self.counts and len(self.counts) >= MAX_KINDS:
            kind = MORE_KINDS
        self.counts[kind] += 1

    @property
    def count(self) -> int:
        """Return the number of all messages."""
        return self.counts.total()

    @property
    def text(self) -> str:
        """Return the numbers by kind for a sentence, such as `120 of L, 3 of N`, or `""`."""
        numbers = [f"{count} of {kind}" for kind, count in self.counts.items()]
        return first_of(numbers, MAX_SHOWN_KINDS)


class MessageNumbers:
    """Tells the names of sensors from numbers of messages, which some apps send in a field `id`.

    A number that rises with each of `PROOF` messages is the number of the message. Sensors side by side take
    turns, so theirs falls.
    """

    def __init__(self) -> None:
        self._last: dict[int, int] = {}
        """Last number by position in the names."""
        self._rises: dict[int, int] = {}
        """Number of rises in succession by position in the names."""
        self.is_undecided = False
        """True if a name may be the number of the message, and is not proven yet."""

    def names_of_sensor(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return `names` of a message without those that are its number."""
        sensor_names: list[str] = []
        self.is_undecided = False
        for position, name in enumerate(names[:MAX_SENSORS]):
            rises = self._count_rises(position, name)
            if rises >= PROOF:
                continue
            self.is_undecided = self.is_undecided or rises > 1
            sensor_names.append(name)
        return tuple(sensor_names)

    def _count_rises(self, position: int, name: str) -> int:
        if not name.isdecimal() or len(name) >= MAX_DIGITS:
            self._last.pop(position, None)
            self._rises[position] = 0
            return 0
        number = int(name)
        last = self._last.get(position)
        self._last[position] = number
        rises = self._rises.get(position, 0)
        if last is None:
            rises = 0
        elif number > last or (rises >= PROOF and number < last):  # a proven counter of one byte starts again
            rises += 1
        else:
            rises = 0
        self._rises[position] = rises
        return rises


class SensorChoice:
    """Uses the configured sensor, or the only one. Of several, none is used until one is configured."""

    def __init__(self, parameter: str, wanted: str = "") -> None:
        """Use the sensor of which one name is `wanted`, which `parameter` sets; `""`: the only one."""
        self._parameter = parameter
        self._wanted = wanted.strip().casefold()
        self._numbers = MessageNumbers()
        self._count = 0
        self._sensors: dict[str, tuple[int, int]] = {}
        """Names of sensors, `""` for one without; number of readings of each, and that of its last."""
        self.used: str | None = None
        """Name of the sensor in use."""

    def accepts(self, *names: str) -> bool:
        """Return True if a reading of the sensor with `names`, such as an address and a number, is used."""
        if not self._wanted:  # what the user has named is a sensor
            sensor_names = self._numbers.names_of_sensor(names)
            if len(sensor_names) < len(names) and len(self._sensors) > 1:
                self._sensors.clear()  # they were numbers of messages
            names = sensor_names
        name = " ".join(filter(None, names))

        # Count the reading. Its sensor moves to the end, so the first one has been silent for longest.
        self._count += 1
        readings = self._sensors.pop(name, (0, 0))[0] + 1
        oldest = self._count - FORGET_AFTER
        self._sensors = {sensor: last for sensor, last in self._sensors.items() if last[1] > oldest}
        if len(self._sensors) >= MAX_SENSORS:
            del self._sensors[next(iter(self._sensors))]
        self._sensors[name] = readings, self._count

        if self._wanted:
            is_used = self._is_wanted(name, *names)
        else:
            is_used = self.several == [name] or [*self._sensors] == [name]
        if is_used:
            self.used = name
        return is_used

    def is_other(self, name: str = "") -> bool:
        """Return True if an event of the sensor with `name` is not of the one in use."""
        if not name:
            return False
        used = self.used or ""
        sensor = self._wanted or used.casefold()
        return name.casefold() != sensor

    def _is_wanted(self, *names: str) -> bool:
        return self._wanted in map(str.casefold, names)

    @property
    def several(self) -> list[str]:
        """Return the names of the sensors that are proven."""
        return [name for name, (readings, _) in self._sensors.items() if readings >= MIN_READINGS]

    @property
    def others(self) -> tuple[str, ...]:
        """Return the names of other sensors than the one in use."""
        return tuple(name for name in self._sensors if name != self.used)

    @property
    def warning(self) -> str:
        """Return the warning that several sensors are heard, or not the configured one, or `""`."""
        sensors = self.several
        has_many = len(self._sensors) >= MAX_SENSORS and not self._numbers.is_undecided
        if not sensors and has_many:
            sensors = [*self._sensors]
        labels = [name or "one without a name" for name in sensors]
        names = ", ".join(sorted(labels))
        if self._wanted:
            if not sensors or self.used in self._sensors:
                return ""
            option = set_option("imu-bridge", self._parameter, min(sensors))
            return f"no sensor {self._wanted!r} is heard, but {names}: use one of them, as by {option}"
        if len(sensors) < 2:
            return ""
        option = set_option("imu-bridge", self._parameter, "NAME")
        return f"several sensors send in one stream ({names}), and none is used: name the wrist's by {option}"


def is_text(data: bytes) -> bool:
    """Return True if most characters are such that people read."""
    letters = _decoded(data, "replace")
    readable = sum(map(_is_readable, letters))
    return readable >= MIN_READABLE * len(letters)


def quoted(data: bytes, max_bytes: int = QUOTED_BYTES) -> str:
    """Return the first `max_bytes` bytes: quoted text with escaped control characters, else hexadecimal."""
    shown = data[:max_bytes]
    if not is_text(shown):
        return shown.hex(" ")
    text = _decoded(shown, "backslashreplace")
    escaped = [letter if is_printable(letter) else repr(letter)[1:-1] for letter in text]
    return "'" + "".join(escaped) + "'"


def _is_readable(letter: str) -> bool:
    if letter == _UNREADABLE:
        return False
    return is_printable(letter) or letter in "\t\r\n"


def _decoded(data: bytes, errors: str) -> str:
    """Return UTF-8 `data` as text, without a character that is cut off at its end."""
    return codecs.getincrementaldecoder("utf-8")(errors).decode(data)


class ContentError(ValueError):
    """A line, message or datagram cannot be used; the text is a clause whose subject is the content."""


def component(key: str) -> tuple[str, str]:
    """Return prefix and component w, x, y or z of a name such as `qw` or `quat_w`, or two empty strings."""
    match = _COMPONENT.fullmatch(key)
    if match is None:
        return "", ""
    return match[1].casefold(), match[2].casefold()


def named_components(fields: Mapping[str, Any]) -> list[Any] | None:
    """Return the fields x, y, z and w with one prefix, or None if there are none or several."""
    groups: dict[str, dict[str, Any]] = {}
    for key, value in fields.items():
        prefix, axis = component(key)
        if axis:
            groups.setdefault(prefix, {})[axis] = value
    complete_groups = [axes for axes in groups.values() if len(axes) == 4]
    if len(complete_groups) != 1:
        return None
    axes = complete_groups[0]
    return [axes[axis] for axis in "xyzw"]


def quaternion_in(content: Mapping[str, Any], order: Order) -> Quaternion:
    """Return the quaternion of an object of JSON: fields w, x, y and z, or a list in `order` or its own one.

    Raises:
        ContentError: If it has none or several, or its norm is wrong.
    """
    # It has one quaternion: by components, or in one field of its own
    components = named_components(content)
    list_fields = [key for key in content if key.casefold() in _LISTS]
    count = len(list_fields)
    if components is not None:
        count += 1
    if count != 1:
        raise ContentError("has several quaternions" if list_fields else "has no quaternion")
    if components is not None:
        return unit_rotation(components, "xyzw")

    # The field holds an object of components, or a list in the stated order
    name = list_fields[0]
    value = content[name]
    if is_object(value):
        components = named_components(value)
        if components is None:
            raise ContentError(f"has no w, x, y and z in {name!r}")
        return unit_rotation(components, "xyzw")
    stated_order = content.get("order", order)
    if stated_order not in ("wxyz", "xyzw"):
        raise ContentError(f"has the order {stated_order!r}, wxyz or xyzw was expected"[:MAX_NAME])
    return unit_rotation(value, stated_order)


def names_in(content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the values of those fields of `content` that name the sensor."""
    names: list[str] = []
    for key in ID_FIELDS:
        value = content.get(key)
        if isinstance(value, str | int | float):
            names.append(f"{value}"[:MAX_NAME])
    return tuple(names)


def unit_rotation(values: Sequence[Any], order: Order) -> Quaternion:
    """Return four numbers in `order` as a rotation x, y, z, w with norm 1.

    Raises:
        ContentError: If they are not four numbers, or their norm is not 1.
    """
    try:
        a, b, c, d = map(float, values)
    except (ValueError, TypeError, OverflowError) as error:
        raise ContentError(f"has {values!r:.40} where four numbers were expected") from error
    try:
        return unit_quaternion((b, c, d, a) if order == "wxyz" else (a, b, c, d))
    except ValueError as error:
        raise ContentError(f"has {error}") from error


def is_object(value: Any) -> TypeGuard[dict[str, Any]]:
    """Return True if parsed JSON is an object."""
    return isinstance(value, dict)
