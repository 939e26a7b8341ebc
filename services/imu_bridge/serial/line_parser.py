"""Lines of text that boards send, as quaternions and buttons (hardware.md A.2).

    line       = {label} number{4,6} {label} | {label} component{4} {label} | [name ":"] button | JSON
    number     = decimal, separated by commas, semicolons, bars or white space; one may trail
    component  = ["q" | "quat"] ("w" | "x" | "y" | "z" | ...) [":" | "="] number
    button     = ("button" | "b") ["press" | "double" | "hold"]

Four numbers are a quaternion in the order that the line states, else in the configured one; for a fifth see
`FifthNumber`. Lines that boards mix in between (`Orientation:`, `Calibration:`, comments) are passed over.
"""

import json
import math
import re
from collections import deque
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, cast

from pointit.geometry.rotation import Quaternion
from pointit.schemas.base import NORM_TOLERANCE, unit_quaternion
from pointit.services.imu_bridge.streams import ContentError, Order, component, is_id, quaternions

Fifth = Literal["auto", "time", "accuracy", "sensor"]
"""Meaning of a fifth number in a line."""
ROUNDING_TOLERANCE = 0.011
"""Largest deviation of the norm of a unit quaternion whose numbers have two decimals, with a margin."""
MAX_SENSOR = 255
"""Largest number in front of a quaternion that may be that of a sensor although it never was read before."""
MEMORY = 64
"""Number of lines over which numbers in front are compared."""
MAX_RISES = 16
"""Number of lines over which numbers of sensors rise by one each before they return, or one is repeated."""
MAX_JUMPS = 4
"""The same if they rise by more than one each."""
MAX_OPEN = 16
"""Number of lines that are passed over while both halves may be the quaternion: a clock starts at 0."""
MEMORY_BEHIND = 16
"""Number of lines in which numbers behind the quaternion come round and round if they are of sensors."""


class LeadingNumber:
    """Tells whether the number in front of the quaternions of one stream is that of a sensor or a time."""

    def __init__(self) -> None:
        self._newest: deque[float] = deque(maxlen=MEMORY)
        self._returns = self._rises = self._jumps = 0
        self._is_sensor: bool | None = None

    def is_sensor(self, number: float) -> bool | None:
        """Return True for the number of a sensor, False for a time, None while it may be either.

        Whole numbers that return to earlier ones are those of sensors, also if they were taken for a time;
        others that rise, are not whole or exceed `MAX_SENSOR` are times.
        """
        before = self._newest[-1] if self._newest else number
        count, is_whole = self._newest.count(number), math.isfinite(number) and number == round(number)
        self._newest.append(number)
        if self._is_sensor and is_whole:
            return True
        self._returns += is_whole and number < before and count > 0
        self._rises += number > before
        self._jumps += number > before + 1
        is_beyond = not (is_whole and 0 <= number <= MAX_SENSOR)
        # a clock that is started again may return once
        if self._returns > (self._is_sensor is False) or (count >= MAX_RISES and not self._rises):
            self._is_sensor = is_whole
        elif is_beyond or self._rises >= MAX_RISES or self._jumps >= MAX_JUMPS:
            self._is_sensor = False
        return self._is_sensor


class TrailingNumber:
    """Tells whether the number behind the quaternions of one stream is that of a sensor."""

    def __init__(self) -> None:
        self._newest: deque[float] = deque(maxlen=MEMORY_BEHIND)
        self._is_sensor = False

    def is_sensor(self, number: float) -> bool:
        """Return True for the number of a sensor, which comes round and round, False for an accuracy."""
        newest = self._newest
        newest.append(number)
        period = len(set(newest))
        self._is_sensor = self._is_sensor or (
            len(newest) == MEMORY_BEHIND
            and 1 < period <= MEMORY_BEHIND // 2
            and all(math.isfinite(each) and each == round(each) for each in newest)
            and all(newest[at] == newest[at - period] for at in range(period, MEMORY_BEHIND))
        )
        return self._is_sensor


class FifthNumber:
    """Separates the fifth number of the lines of one stream, by the norms of both halves.

    A number in front is judged by `LeadingNumber`, one behind by `TrailingNumber`.
    """

    def __init__(self, fifth: Fifth = "auto") -> None:
        self._fifth: Fifth = fifth
        self._is_behind: bool | None = None
        """Side in the newest line in which the norms told it."""
        self._first = 0.0
        """First number of the newest line in which they did not."""
        self._open = 0
        """Number of such lines."""
        self._leading = LeadingNumber()
        self._trailing = TrailingNumber()

    def split(self, numbers: Sequence[float]) -> tuple[Sequence[float], str, float | None] | None:
        """Return the quaternion's four numbers, the sensor's number or `""`, and the time, µs, or None.

        None for the first lines in which its side or meaning is open.

        Raises:
            ValueError: If the side stays open.
        """
        is_behind = self._side(numbers)
        if is_behind is None:
            return None
        four, beside = (numbers[:4], numbers[4]) if is_behind else (numbers[1:], numbers[0])
        if self._fifth == "auto":
            is_sensor = (self._trailing if is_behind else self._leading).is_sensor(beside)
        else:
            is_sensor = self._fifth == "sensor"
        if is_sensor is None:
            return None
        return four, f"{beside:.9g}" if is_sensor else "", None if is_sensor or is_behind else beside

    def _side(self, numbers: Sequence[float]) -> bool | None:
        if self._fifth in ("time", "accuracy"):
            return self._fifth == "accuracy"
        fits_behind, fits_front = is_unit(numbers[:4]), is_unit(numbers[1:])
        if fits_behind != fits_front:
            self._is_behind = fits_behind
        elif fits_behind and self._is_behind is None and self._fifth == "auto":
            fits_behind, fits_front = (
                is_unit(four, ROUNDING_TOLERANCE) for four in (numbers[:4], numbers[1:])
            )
            if fits_behind != fits_front:
                return fits_behind
            before, self._first = self._first, numbers[0]
            is_falling = self._first < before and not self._first.is_integer()
            is_no_front, is_no_accuracy = self._first < 0 or is_falling, numbers[4] < 0
            if is_no_front != is_no_accuracy:
                self._is_behind = is_no_front
                return is_no_front
            self._open += 1
            if self._open <= MAX_OPEN:
                return None
            raise ValueError(
                "has five numbers, of which the first and the last four are a quaternion: set the parameter "
                "`fifth` to time, sensor or accuracy"
            )
        return bool(self._is_behind)


def is_unit(four: Sequence[float], tolerance: float = NORM_TOLERANCE) -> bool:
    """Return True if `four` numbers may be a quaternion."""
    return abs(math.hypot(*four) - 1.0) <= tolerance


REAL = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_UNIT = r"(?:\s?(?:%|°C?|dBm?|[mµu]?s|[kM]?Hz|[mk]?V|mA|C|hPa|fps)\b|\s?[%°])"
_NO_NUMBER = r"[+-]?(?:nan|inf|infinity|ovf|null|none)"
NO_NUMBER = re.compile(rf"(?<![^\W_]){_NO_NUMBER}(?![^\W_])", re.IGNORECASE)
"""Text in place of a number that is not known."""
_FIELD = re.compile(
    rf"(?<![\w.])([^\W\d_][\w.\-]*)\s*[:=]\s*({REAL}|{_NO_NUMBER}){_UNIT}?(?![\w.:])", re.IGNORECASE
)
_NAME_FIELD = re.compile(r"(?<![\w.])([^\W\d_]\w*)\s*[:=]\s*([^\s,;|=]*[^\W_][^\s,;|=]*)")
_MEASURED = re.compile(
    r"t|ts|time\w*|tus|tms|ms|us|micros|millis|uptime|rssi|snr|bat\w*|vbat|volt\w*|m?v|soc|temp\w*|hum\w*|press?\w*"
    r"|alt\w*|seq\w*|cnt|counter|count|n|frame\w*|pa?c?ke?t\w*|fps|hz|rate|dt|heading|yaw|pitch|roll|acc\w*|gyr\w*"
    r"|mag\w*|cal\w*|sys|stat\w*|qual\w*|conf\w*|err\w*|norm|len|crc|steps?",
    re.IGNORECASE,
)
"""Names of fields that have a measurement, a time or a count."""
_PLAIN = re.compile(rf"(?<![\w.]){REAL}{_UNIT}?(?![\w.])|\*[\da-fA-F]{{2,4}}\s*\Z")
"""A number without a name, or a checksum."""
_DECIMAL = re.compile(r"\d+\.\d+")
_WORD = re.compile(r"[0-9a-fA-F]{1,4}(?:::?[0-9a-fA-F]{1,4}){3,}|[^\W_](?:[\w.\-]*\w)?")
"""A word, or an address of Bluetooth or IPv6, which has colons."""
_COLOR = re.compile(r"\x1b\[[\d;]*m")
_DATE = r"(?:\d{4}[-/.]\d\d[-/.]\d\d|\d\d[-/.]\d\d[-/.]\d{4})"
_TIME = r"\d\d:\d\d:\d\d(?:[.,]\d+)?"
_LOG = re.compile(
    r"[EWIDV] \([\d:. ]+\) |\[[\d:., ]+\](?: <\w+> |\[[EWIDV]\]\[[^\]]*\] )"
    rf"|\[{_DATE}?[T ]?{_TIME}(?:Z|[+-]\d\d:?\d\d)?\][,;:\s]*|\[ *\d+\.\d{{3,}}\] "
    rf"|(?:[A-Z][a-z]{{2}} +\d{{1,2}} )?{_TIME}(?: ?-?> ?|[,;\s]+)"
    rf"|{_DATE}[T ]\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?(?:Z|[+-]\d\d:?\d\d)?[,;\s]+"
)
"""Level and time of ESP-IDF, Zephyr, the ESP32's Arduino core, serial monitors and loggers before a line."""
_SCALARS = re.compile(
    rf"(?<![\w.])(?:(?:rssi|snr|v?bat\w*|volt\w*|soc|temp\w*|hum\w*|press?\w*|alt\w*|seq\w*|cnt|counter|count|n"
    rf"|frame\w*|pa?c?ke?t\w*|fps|hz|rate|heading)\s*[:=]\s*{REAL}[,;|\s]+)+"
    rf"(?=[(\[{{]?{REAL}(?:[,;|\s]+{REAL}){{3}})",
    re.IGNORECASE,
)
"""Fields with one measurement or count each, directly before four numbers."""
_SENTENCE = re.compile(r"[$!]([^*]*)\*([\da-fA-F]{2})")
"""A line as of NMEA 0183, with the exclusive or of its characters behind it."""
_COMMA_NUMBER = re.compile(r"((?:[^\W\d]\w*[:=])?[+-]?\d+),(\d+)")
_PLAIN_NUMBER = re.compile(r"(?:[^\W\d]\w*[:=])?[+-]?\d+")
_ORDERS: dict[str, Order] = {"wxyz": "wxyz", "xyzw": "xyzw"}
_ORDER = re.compile(
    r"(?<![a-pr-z])(?:(w)[\W_]*x[\W_]*y[\W_]*z|x[\W_]*y[\W_]*z[\W_]*w)(?![a-z])", re.IGNORECASE
)
_SCALAR_LAST = "VNQTN"
"""Name of VectorNav's sentence with a quaternion."""
_UNIT_OF_COLUMN = re.compile(r"(?<=\w)\s?[(\[][^\s,;|()\[\]]*[)\]]")
_KINDS = frozenset({"quaternion", "quaternions", "quat", "quats", "q", "game", "rotation", "vector"})
"""Words for the quaternion, which do not tell sensors apart."""
_GENERIC = frozenset({"sensor", "imu", "id", "device"})
"""Words that tell sensors apart only with another word or number."""
ANGLES = frozenset({"ypr", "rpy", "yaw", "pitch", "roll", "angle", "angles"})
_OTHER_NAMES = frozenset({
    "orientation", "calibration", "calib", "cal", "status", "euler", "heading", "raw", "uncal", "unical",
    "accel", "gyro", "mag", "temp", "areal", "aworld", "gravity", "linear", "acc", "gyr", "position", "pos",
})  # fmt: skip
"""Names of lines with other numbers that may look like a quaternion."""


def without_frame(text: str) -> str:
    """Return a line without colors, time and level of a logger, checksum, and measurements before numbers.

    Raises:
        ValueError: If the checksum is wrong.
    """
    text = _COLOR.sub("", text).strip(" \t\r\n\0\ufeff")
    if log := _LOG.match(text):
        text = text[log.end() :].lstrip()
    if sentence := _SENTENCE.fullmatch(text):
        checksum = 0
        for each in sentence[1].encode():
            checksum ^= each
        if checksum != int(sentence[2], 16):
            raise ValueError(f"has the checksum {sentence[2]}, {checksum:02X} was expected")
        text = sentence[1]
    return _SCALARS.sub("", text.removeprefix("/*").removesuffix("*/").strip())


def words(label: str) -> set[str]:
    """Return the words of a label in small letters."""
    return {word.lower() for word in _WORD.findall(label)}


def is_other_reading(label: str) -> bool:
    """Return True if a label is of numbers that are no quaternion, such as accelerations."""
    found = words(label)
    return bool(found & _OTHER_NAMES) and not found & _KINDS


def names(label: str, *, is_behind: bool = False) -> tuple[str, ...]:
    """Return the words and numbers of a label that tell sensors apart.

    Args:
        label: the text before or behind the quaternion.
        is_behind: numbers of other fields in it are measurements.
    """
    found: list[str] = []

    def take(field: re.Match[str]) -> str:
        if is_id(field[1]):
            found.append(field[2].strip(":"))
            return " "
        return " " if field.re is _FIELD and (is_behind or _MEASURED.fullmatch(field[1])) else field[0]

    rest = _NAME_FIELD.sub(take, _FIELD.sub(take, _ORDER.sub(" ", label)))
    if is_behind:
        rest = NO_NUMBER.sub(" ", _PLAIN.sub(" ", rest))
    others = [word for word in _WORD.findall(rest) if word.lower() not in _KINDS | _OTHER_NAMES]
    others = [word for word in others if not _DECIMAL.fullmatch(word)]
    others = [word for word in others if word.lower() not in _GENERIC or len(others) == 1]
    return (*others, *found)


def stated_order(label: str) -> Order | None:
    """Return the order that a label such as `quat xyzw` or `VNQTN` states, or None."""
    found = _ORDER.search(label)
    if found is None:
        return "xyzw" if _SCALAR_LAST in label else None
    return "wxyz" if found[1] else "xyzw"


def order_of_header(text: str) -> Order | None:
    """Return the order that a header such as `time,qx,qy,qz,qw` states, or None if it is none."""
    text = _UNIT_OF_COLUMN.sub("", text)
    columns = "".join(component(word)[0] for word in re.split(r"[,;|\s]+", text))
    return None if _PLAIN.search(text) else _ORDERS.get(columns)


def with_points(text: str) -> str:
    """Return `text` with points in its numbers if they have decimal commas, as in `0,6; 0,8; 0; 0`."""
    parts = re.split(r"([;|\s]+)", text)
    numbers = [word for word in parts if _COMMA_NUMBER.fullmatch(word)]
    others = [word for word in parts if _PLAIN_NUMBER.fullmatch(word)]
    if not numbers or len(numbers) + len(others) < 4 or "." in text:
        return text
    return "".join(_COMMA_NUMBER.sub(r"\1.\2", word) if word in numbers else word for word in parts)


LONGEST_LINE = 256
"""Longest line, bytes; longer ones are discarded on arrival."""
MAX_TIME_US = 2**53
"""Largest time in µs that is exact as a float; 285 years."""
_BLOCK = re.compile(rf"(?<![\w.+\-])(?<!:[\da-fA-F]{{2}}:){REAL}(?:[,;|\s]+{REAL})*(?![\w.])")
_BEHIND = re.compile(r"[\w\s:=,;|.%°µ/+\-#*!?&@$]*")
_PAIR = re.compile(rf"([^\W\d_][\w.\-]*)\s*[:=,\s]\s*({REAL})(?![\w.:])")
_SENSOR_KEY = re.compile(r"(?:(.+)[._\-])?(q(?:uat)?_?[wxyz]|[wxyz])_?(\d*)", re.IGNORECASE)
_BUTTON = re.compile(r"(?:([^:]+):\s*)?(?:button|b)(?:[:,;\s]+(press|double|hold))?\Z", re.IGNORECASE)
_SEPARATOR = re.compile(r"[,;|\s]+")
_BRACKETS = str.maketrans("[](){}<>\"'", " " * 10)
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
    """A line is neither a quaternion nor a button; the message is the reason."""


class AnglesError(LineError):
    """A line has angles, which are of no use. Boards also send them beside quaternions."""


@dataclass(frozen=True, slots=True)
class QuaternionLine:
    """world_from_sensor, scalar last and with norm 1, and the other values of the line."""

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
            text = without_frame(line.decode())
        except ValueError as error:
            reason = "is not text" if isinstance(error, UnicodeDecodeError) else str(error)
            raise LineError(reason) from error
        if text.startswith("#") and text[1:2].isdigit():  # the number of a sensor, else a comment
            text = text[1:]
        if not text or text.startswith("#"):
            return None
        if button := _BUTTON.match(text):
            return ButtonLine(cast("Gesture", (button[2] or "press").lower()), names(button[1] or ""))
        if order := order_of_header(text):
            self._order = order
            return None
        text = with_points(text.translate(_BRACKETS).strip())
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
        fields = [(pair[1], pair[2], pair.span()) for pair in _PAIR.finditer(text)]
        values: dict[tuple[str, bool], float] = {}
        plain: set[tuple[str, bool]] = set()
        spans: list[tuple[int, int]] = []
        sensors: dict[str, None] = {}
        for key, number, span in sorted(fields, key=lambda field: not _is_plain(field[0])):
            axis, says_quaternion, sensor = _axis(key)
            kind = (axis, says_quaternion)
            if not axis or (kind in plain and not _is_plain(key)):  # S: of a status, perhaps
                continue
            if kind in values:
                raise LineError(f"has {key} twice: send the quaternion of each sensor in its own line")
            values[kind] = float(number)
            plain |= {kind} if _is_plain(key) else set()
            spans.append(span)
            sensors[sensor] = None
        for says_quaternion in (True, False):
            four = [values.get((each, says_quaternion)) for each in "xyzw"]
            if None in four[:3]:
                continue
            if four[3] is None and (wrong := NO_NUMBER.search(text)):
                raise LineError(f"has {wrong[0]!r} where a number was expected")
            x, y, z = (each or 0.0 for each in four[:3])
            w = four[3] if four[3] is not None else _left_out({key.lower() for key, _, _ in fields}, x, y, z)
            before = _PAIR.sub(" ", text[: min(start for start, _ in spans)])
            behind = _PAIR.sub(" ", text[max(end for _, end in spans) :])
            if not says_quaternion and is_other_reading(before):
                return None
            ids = [number for key, number, _ in fields if is_id(key)]
            own = (*names(before), *names(behind, is_behind=True), *ids, *filter(None, sensors))
            return QuaternionLine(_unit((x, y, z, w)), _time_field(fields), own)
        return None

    def _columns(self, text: str) -> QuaternionLine | None:
        columns: list[tuple[str, list[float], int, int]] = []
        for block in _BLOCK.finditer(text):
            label = text[columns[-1][3] if columns else 0 : block.start()]
            columns.append((label, [float(word) for word in _SEPARATOR.split(block[0])], *block.span()))
        fours = [each for each in columns if len(each[1]) >= 4 and not is_other_reading(each[0])]
        if len(fours) > 1:
            raise LineError("has several quaternions: send that of each sensor in its own line")
        if not fours and any(is_other_reading(label) for label, *_ in columns):
            return None
        label, numbers, start, end = (fours or columns or [(text, [], len(text), len(text))])[-1]
        before, behind = text[:start], text[end:]
        if words(label if fours else before) & ANGLES:
            raise AnglesError(f"has angles: {_QUATERNIONS}")
        is_name = any(map(str.isalpha, before)) or ":" in before or before.count(".") == 3
        is_read = bool(columns) and (is_name or not before.strip())
        if not is_read or not _BEHIND.fullmatch(behind) or (behind.strip(" ,;|\t") and not fours):
            word = next((each for each in _SEPARATOR.split(text) if not re.fullmatch(REAL, each)), text)
            raise LineError(f"has {word[:20]!r} where a number was expected")
        if not all(map(math.isfinite, numbers)):
            raise LineError(f"has {max(numbers, key=abs)}, a number that is not finite")
        if wrong := NO_NUMBER.search(before):
            raise LineError(f"has {wrong[0]!r} where a number was expected")
        vectors = [(s, e) for _, other, s, e in columns if len(other) > 1 and e <= start]
        own = "".join(text[e:s] for (_, e), (s, _) in pairwise([(0, 0), *vectors, (start, start)]))
        return self._quaternion(numbers, own, names(behind, is_behind=True))

    def _quaternion(
        self, numbers: list[float], label: str, other_names: Sequence[str]
    ) -> QuaternionLine | None:
        sensors, time_ns = [*names(label), *other_names], None
        four: Sequence[float] = numbers
        if len(numbers) == 5:
            try:
                split = self._fifth.split(numbers)
            except ValueError as error:
                raise LineError(str(error)) from error
            if split is None:
                return None
            four, sensor, time_us = split
            sensors.append(sensor)
            time_ns = None if time_us is None else _time_ns(time_us * 1e3)
        elif len(numbers) == 6 and is_unit(numbers[2:]):
            four = numbers[2:]
            are_sensors = [of.is_sensor(each) for of, each in zip(self._leading, numbers, strict=False)]
            if None in are_sensors:
                return None
            for number, is_sensor in zip(numbers, are_sensors, strict=False):
                if is_sensor:
                    sensors.append(f"{number:.9g}")
                else:
                    time_ns = _time_ns(number * 1e3)
        elif len(numbers) != 4:
            after = f" after {label.strip()[:20]!r}" if label.strip() else ""
            hint = f"; if they are angles, {_QUATERNIONS}" if len(numbers) == 3 else ""
            hint = ", those of each sensor in its own line" if len(numbers) >= 8 else hint
            raise LineError(f"has {len(numbers)} numbers{after}, 4 or 5 were expected{hint}")
        a, b, c, d = four
        order = stated_order(label) or self._order
        turned = _unit((b, c, d, a) if order == "wxyz" else (a, b, c, d))
        return QuaternionLine(turned, time_ns, tuple(filter(None, sensors)))


def _is_plain(key: str) -> bool:
    """Return True if a component's name ends as w, x, y, z or a digit do, not as i, j, k, r, s or real."""
    return key[-1].lower() in "wxyz" or key[-1].isdigit()


def _axis(key: str) -> tuple[str, bool, str]:
    """Return the result of `component`, and the sensor in the name, as in `imu2.qw` or `qw2`, or `""`."""
    axis, says_quaternion = component(key)
    split = _SENSOR_KEY.fullmatch(key)
    if axis or split is None or is_other_reading(split[1] or ""):
        return axis, says_quaternion, ""
    return (*component(split[2]), split[1] or split[3])


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


def _time_field(fields: Sequence[tuple[str, str, tuple[int, int]]]) -> int | None:
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
