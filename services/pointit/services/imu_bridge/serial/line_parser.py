r"""Lines of text that boards send over a serial port or in datagrams: their content (hardware.md A.3b).

    line       = [name [":"]] number{4,6} | [name] component{4} | [name ":"] button | JSON
    number     = decimal, separated by commas, semicolons, bars or white space; one may trail
    component  = ["q" | "quat"] ("w" | "x" | "y" | "z" | ...) [":" | "="] number
    button     = ("button" | "b") ["press" | "double" | "hold"]

Four numbers are a quaternion in the configured order; for a fifth see `FifthNumber`. Names other than `quat`
and its like are those of sensors. Lines that boards mix in between (`Orientation:`, `Calibration:`, comments)
are passed over.
"""

import json
import math
import re
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Literal, cast

from pointit.geometry.rotation import Quaternion
from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.serial.fifth_number import Fifth, FifthNumber, LeadingNumber, is_unit
from pointit.services.imu_bridge.streams.json_content import (
    ContentError,
    Order,
    component,
    is_id,
    quaternions,
)

LONGEST_LINE = 256
"""Longest line, bytes; longer ones are discarded on arrival."""
MAX_TIME_US = 2**53
"""Largest time in µs that is exact as a float; 285 years."""
_REAL = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_COLUMNS = re.compile(
    rf"(.*?)[\s:=,;|]*(?<![\w.+\-])(?<!:[\da-fA-F]{{2}}:){_REAL}(?:[,;|\s]+{_REAL})*[,;|\s]*\Z", re.DOTALL
)
_PAIR = re.compile(rf"([^\W\d_][\w.\-]*)\s*[:=,\s]\s*({_REAL})(?![\w.:])")
_BUTTON = re.compile(r"(?:([^:]+):\s*)?(?:button|b)(?:[:,;\s]+(press|double|hold))?\Z", re.IGNORECASE)
_SEPARATOR = re.compile(r"[,;|\s]+")
_WORD = re.compile(r"[0-9a-fA-F]{1,4}(?:::?[0-9a-fA-F]{1,4}){3,}|[^\W_](?:[\w.\-]*\w)?")
"""A word, or an address of Bluetooth or IPv6, which has colons."""
_COLOR = re.compile(r"\x1b\[[\d;]*m")
_LOG = re.compile(
    r"[EWIDV] \([\d:. ]+\) |\[[\d:., ]+\](?: <\w+> |\[[EWIDV]\]\[[^\]]*\] )|\d\d:\d\d:\d\d\.\d{3} -?> "
    r"|\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?(?:Z|[+-]\d\d:?\d\d)?[,;\s]+"
)
"""Level and time of ESP-IDF, Zephyr, the ESP32's Arduino core, serial monitors and loggers before a line."""
_COMMA_NUMBER = re.compile(r"((?:[^\W\d]\w*[:=])?[+-]?\d+),(\d+)")
_PLAIN_NUMBER = re.compile(r"(?:[^\W\d]\w*[:=])?[+-]?\d+")
_BRACKETS = str.maketrans("[](){}<>\"'", " " * 10)
_NO_NUMBER = re.compile(r"(?<![^\W_])[+-]?(?:nan|inf|infinity|ovf|null|none)(?![^\W_])", re.IGNORECASE)
_KINDS = frozenset({"quaternion", "quaternions", "quat", "quats", "q", "game", "rotation", "vector"})
"""Words for the quaternion, which do not tell sensors apart."""
_GENERIC = frozenset({"sensor", "imu", "id", "device"})
"""Words that tell sensors apart only with another word or number."""
_ANGLES = frozenset({"ypr", "rpy", "yaw", "pitch", "roll", "angle", "angles"})
_OTHER_NAMES = frozenset({
    "orientation", "calibration", "calib", "cal", "status", "euler", "heading", "raw", "uncal", "unical",
    "accel", "gyro", "mag", "temp", "areal", "aworld", "gravity", "linear",
})  # fmt: skip
"""Names of lines with other numbers that may look like a quaternion."""
_TIME_NS = {
    "us": 1e3,
    "tus": 1e3,
    "timeus": 1e3,
    "micros": 1e3,
    "millis": 1e6,
    "ms": 1e6,
    "tms": 1e6,
    "timems": 1e6,
}
"""Fields with the device's time whose names state the unit, ns."""
_QUATERNIONS = "let it send quaternions (MPU6050_DMP6: define OUTPUT_READABLE_QUATERNION)"
Gesture = Literal["press", "double", "hold"]


class LineError(ValueError):
    """A line is neither a quaternion nor a button; the message says why."""


class AnglesError(LineError):
    """A line has angles, which are of no use. Boards also send them beside quaternions."""


@dataclass(frozen=True, slots=True)
class QuaternionLine:
    """world_from_sensor, scalar last and with norm 1, and what else the line says."""

    orientation_xyzw: Quaternion
    device_time_ns: int | None = None
    names: tuple[str, ...] = ()
    """Words and numbers that name the sensor."""


@dataclass(frozen=True, slots=True)
class ButtonLine:
    """A gesture on the device's button."""

    gesture: Gesture = "press"
    names: tuple[str, ...] = ()
    """Words that name the sensor."""


class LineParser:
    """Parses the lines of one stream with one order of the quaternion's numbers."""

    def __init__(self, order: Order = "wxyz", fifth: Fifth = "auto") -> None:
        """Set the `order` and the meaning of a `fifth` number, see `FifthNumber`."""
        self._order: Order = order
        self._fifth = FifthNumber(fifth)
        self._leading = (LeadingNumber(), LeadingNumber())
        """Two numbers in front, such as a sensor's and a time."""

    def parse(self, line: bytes) -> QuaternionLine | ButtonLine | None:
        """Return the content of `line`, or None for an empty line, a comment, or another kind of reading.

        Raises:
            LineError: If it cannot be parsed.
        """
        if len(line) > LONGEST_LINE:
            raise LineError(f"has {len(line)} bytes, limit {LONGEST_LINE}")
        try:
            text = _COLOR.sub("", line.decode()).strip(" \t\r\n\0\ufeff")
        except UnicodeDecodeError as error:
            raise LineError("is not text") from error
        if log := _LOG.match(text):
            text = text[log.end() :].lstrip()
        if not text or text.startswith("#"):
            return None
        if button := _BUTTON.match(text):
            return ButtonLine(cast("Gesture", (button[2] or "press").lower()), _names(button[1] or ""))
        if wrong := _NO_NUMBER.search(text):
            raise LineError(f"has {wrong[0]!r} where a number was expected")
        text = _with_points(text.translate(_BRACKETS).strip())
        named = self._components(text)
        return named if named is not None else self._columns(text)

    def parse_all(self, line: bytes) -> list[QuaternionLine | ButtonLine]:
        """Return the content of `line`, which may be JSON with several quaternions.

        Raises:
            LineError: If it cannot be parsed.
        """
        if line.lstrip().startswith((b"{", b"[{")):
            try:
                content = json.loads(line)
            except (ValueError, RecursionError):
                pass  # perhaps {w:1,x:0,y:0,z:0}, which is not JSON
            else:
                try:
                    return [
                        QuaternionLine(each.orientation_xyzw, None, each.names)
                        for each in quaternions(content, self._order)
                    ]
                except ContentError as error:
                    raise LineError(str(error)) from error
        parsed = self.parse(line)
        return [] if parsed is None else [parsed]

    def _components(self, text: str) -> QuaternionLine | None:
        """Return a quaternion whose numbers have names, such as `qW: 1.0 qX: 0.0`, or None."""
        fields = [(pair[1], pair[2], pair.start()) for pair in _PAIR.finditer(text)]
        values: dict[tuple[str, bool], float] = {}
        for key, number, _ in fields:
            name = component(key)
            if name[0] and name in values:
                raise LineError(f"has {key} twice: send the quaternion of each sensor in its own line")
            values[name] = float(number)
        for says_quaternion in (True, False):
            four = [values.get((each, says_quaternion)) for each in "xyzw"]
            if None in four[:3]:
                continue
            x, y, z = (each or 0.0 for each in four[:3])
            w = four[3] if four[3] is not None else _left_out({key.lower() for key, _, _ in fields}, x, y, z)
            start = min(at for key, _, at in fields if component(key)[0])
            if not says_quaternion and _is_other_reading(_PAIR.sub(" ", text[:start])):
                return None
            ids = [number for key, number, _ in fields if is_id(key)]
            return QuaternionLine(
                _unit((x, y, z, w)), _time_field(fields), (*_names(_PAIR.sub(" ", text[:start])), *ids)
            )
        return None

    def _columns(self, text: str) -> QuaternionLine | None:
        found = _COLUMNS.match(text)
        label = text if found is None else found[1]
        if _is_other_reading(label):
            return None
        if {word.lower() for word in _WORD.findall(label)} & _ANGLES:
            raise AnglesError(f"has angles: {_QUATERNIONS}")
        is_name = any(map(str.isalpha, label)) or ":" in text or label.count(".") == 3
        if found is None or (label and not is_name):
            word = next((each for each in _SEPARATOR.split(text) if not re.fullmatch(_REAL, each)), text)
            raise LineError(f"has {word[:20]!r} where a number was expected")
        numbers = [float(word) for word in _SEPARATOR.split(text[found.end(1) :].lstrip(" :=,;|\t")) if word]
        if not all(map(math.isfinite, numbers)):
            raise LineError(f"has {max(numbers, key=abs)}, a number that is not finite")
        if len(numbers) >= 4 and len(re.findall(rf"(?<![\w.]){_REAL}(?![\w.:])", label)) > 2:
            raise LineError("has several quaternions: send that of each sensor in its own line")
        return self._quaternion(numbers, label)

    def _quaternion(self, numbers: list[float], label: str) -> QuaternionLine | None:
        names, time_ns = [*_names(label)], None
        four: Sequence[float] = numbers
        if len(numbers) == 5:
            try:
                split = self._fifth.split(numbers)
            except ValueError as error:
                raise LineError(str(error)) from error
            if split is None:
                return None
            four, sensor, time_us = split
            names.append(sensor)
            time_ns = None if time_us is None else _time_ns(time_us * 1e3)
        elif len(numbers) == 6 and is_unit(numbers[2:]):
            four = numbers[2:]
            are_sensors = [of.is_sensor(each) for of, each in zip(self._leading, numbers, strict=False)]
            if None in are_sensors:
                return None
            for number, is_sensor in zip(numbers, are_sensors, strict=False):
                if is_sensor:
                    names.append(f"{number:.9g}")
                else:
                    time_ns = _time_ns(number * 1e3)
        elif len(numbers) != 4:
            after = f" after {label.strip()[:20]!r}" if label.strip() else ""
            hint = f"; if they are angles, {_QUATERNIONS}" if len(numbers) == 3 else ""
            hint = ", those of each sensor in its own line" if len(numbers) >= 8 else hint
            raise LineError(f"has {len(numbers)} numbers{after}, 4 or 5 were expected{hint}")
        a, b, c, d = four
        turned = _unit((b, c, d, a) if self._order == "wxyz" else (a, b, c, d))
        return QuaternionLine(turned, time_ns, tuple(filter(None, names)))


def _with_points(text: str) -> str:
    """Return `text` with points in its numbers if they have decimal commas, as in `0,6; 0,8; 0; 0`."""
    words = re.split(r"([;|\s]+)", text)
    numbers = [word for word in words if _COMMA_NUMBER.fullmatch(word)]
    others = [word for word in words if _PLAIN_NUMBER.fullmatch(word)]
    if not numbers or len(numbers) + len(others) < 4 or "." in text:
        return text
    return "".join(_COMMA_NUMBER.sub(r"\1.\2", word) if word in numbers else word for word in words)


def _is_other_reading(label: str) -> bool:
    """Return True if a label is of numbers that are no quaternion, such as accelerations."""
    words = {word.lower() for word in _WORD.findall(label)}
    return bool(words & _OTHER_NAMES) and not words & _KINDS


def _names(label: str) -> tuple[str, ...]:
    """Return the words of a label that tell sensors apart."""
    words = [word for word in _WORD.findall(label) if word.lower() not in _KINDS]
    return tuple(word for word in words if word.lower() not in _GENERIC or len(words) == 1)


def _unit(four: Quaternion) -> Quaternion:
    try:
        return unit_quaternion(four)
    except ValueError as error:
        raise LineError(f"has {error}") from error


def _left_out(keys: AbstractSet[str], x: float, y: float, z: float) -> float:
    """Return w of Q1, Q2 and Q3 of InvenSense's DMP, which is at least 0.

    Raises:
        LineError: If it is not such a line.
    """
    if not {"q1", "q2", "q3"} <= keys:
        raise AnglesError(f"has x, y and z without w: {_QUATERNIONS}")
    if "q4" in keys:
        raise LineError("has q1 to q4, of which q1 or q4 may be w: name them w, x, y and z")
    return math.sqrt(max(0.0, 1.0 - x * x - y * y - z * z))


def _time_field(fields: Sequence[tuple[str, str, int]]) -> int | None:
    """Return the time of a field whose name states the unit, ns, or None."""
    for key, number, _ in fields:
        unit_ns = _TIME_NS.get(re.sub(r"\W|_", "", key.lower()))
        if unit_ns is not None:
            return _time_ns(float(number) * unit_ns)
    return None


def _time_ns(time_ns: float) -> int:
    if not 0 <= time_ns <= MAX_TIME_US * 1e3:
        raise LineError(f"has the time {time_ns / 1e3:g} µs")
    return round(time_ns)
