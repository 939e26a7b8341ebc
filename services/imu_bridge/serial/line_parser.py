"""Lines of text that boards send over a serial port or in datagrams, in the documented forms alone.

    line   = [label] number number number number | [label] (axis number) four times | JSON
           | [name ":"] ("button" | "b") ["press" | "double" | "hold"] | the form of the parameter `line`
    label  = "quaternion" | "quat" | "q"
    axis   = ["q" | "quat" | "quat_"] ("w" | "x" | "y" | "z")

Numbers are decimal, and commas, semicolons, bars or white space separate them; repeated ones count once.
Comments (`#`) and Adafruit's lines `Orientation:` and `Calibration:` are passed over.
"""

import json
import re
from dataclasses import dataclass
from typing import cast

from pointit.geometry.rotation import Quaternion
from pointit.schemas.person import Gesture
from pointit.services.imu_bridge.streams import (
    ContentError,
    Order,
    named_components,
    names_in,
    quaternion_in,
    unit_rotation,
)

LONGEST_LINE = 256
"""Longest line of a serial port, bytes; longer ones are discarded on arrival."""
MAX_TIME_US = 2**53
"""Largest time in µs that is exact as a float; 285 years."""
TIME_NS = {"t_us": 1e3, "t_ms": 1e6, "t_s": 1e9}
"""Parts of a line with the device's time, and their units, ns."""
PARTS = ("w", "x", "y", "z", "_", "sensor", *TIME_NS)
"""Names of parts of a line; `_` is passed over."""
_PASSED_OVER = ("#", "orientation:", "calibration:")
_SEPARATORS = r",;|\s"
_SEPARATOR = re.compile(rf"[{_SEPARATORS}]+")
_REAL = r"[+-]?(?:\d+(?:MARK\d*)?|MARK\d+)(?:[eE][+-]?\d+)?"
_POINT = _REAL.replace("MARK", r"\.")
"""Number with a decimal point."""
_COMMA = _REAL.replace("MARK", "[.,]")
"""Number with a decimal point or comma."""
_NUMBER = re.compile(_POINT)
_DECIMAL_COMMA = re.compile(r"(?<![\d,])\d+,\d+(?![\d,])")
_STAMP = (
    r"\d{4}[-_/]\d\d[-_/]\d\d(?:[T_][\d:.]+(?:Z|[+-]\d\d:?\d\d)?)?|\d\d?:\d\d:\d\d(?:[.,]\d+)*"
    r"|(?:[\da-fA-F]{2}:){5}[\da-fA-F]{2}|0[xX][\da-fA-F]+|(?<=\*)[\da-fA-F]{2}(?!\w)"
)
"""Dates, times of day, addresses, hexadecimal numbers and checksums, each of which is one part."""
_LABEL = re.compile(
    rf"(?:quaternion|quat|q)(?:[{_SEPARATORS}]*[:=][{_SEPARATORS}]*|[{_SEPARATORS}]+)", re.IGNORECASE
)
_BUTTON = re.compile(r"(?:([^:]+):\s*)?(?:button|b)(?:[:,;\s]+(press|double|hold))?\Z", re.IGNORECASE)
_PART = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True, slots=True)
class QuaternionLine:
    """world_from_sensor, scalar last and with norm 1, and the other values of the line."""

    orientation_xyzw: Quaternion
    device_time_ns: int | None = None
    names: tuple[str, ...] = ()
    """Names or numbers of the sensor."""


@dataclass(frozen=True, slots=True)
class ButtonLine:
    """A gesture on the device's button."""

    gesture: Gesture = "press"
    names: tuple[str, ...] = ()
    """Name of the sensor, if the line has one."""


def compile_line(line: str) -> re.Pattern[str]:
    """Return the expression of a form such as `{sensor},{t_us},{w},{x},{y},{z}`, a group for each part.

    A comma is a decimal comma if the form has none.

    Raises:
        ValueError: If a part is unknown or is there twice, w, x, y or z is missing, or two parts adjoin.
    """
    # Each part of the quaternion once, and no part twice
    names = [name for name in _PART.findall(line) if name != "_"]
    unknown = sorted(set(names) - {*PARTS})
    if unknown:
        raise ValueError(f"has the unknown part {{{unknown[0]}}}: use {', '.join(PARTS)}")
    if not set("wxyz") <= set(names) or len(set(names)) < len(names):
        raise ValueError("must have each of {w}, {x}, {y} and {z} once, and no other part twice")

    # A form with commas has them between its parts, so its numbers have a decimal point
    number = _POINT if "," in line else _COMMA
    separators = _SEPARATORS if "," in line else _SEPARATORS.replace(",", "")

    # Parts, separators and other text in turn
    pieces = list(filter(None, re.split(r"(\{\w+\}|[,;|\s]+)", line.strip(",;| \t"))))
    expression = ""
    for before, piece, behind in zip(["", *pieces], pieces, [*pieces[1:], ""], strict=False):
        part = _PART.fullmatch(piece)
        is_before_part = _PART.fullmatch(behind) is not None
        if part is not None and is_before_part:
            raise ValueError(f"has {piece}{behind} without a separator between them")
        if part is not None:
            name = part[1]
            next_letter = re.escape(behind[:1].strip(",;|"))
            word = f"[^{separators}{next_letter}]+"  # ends where the next text begins
            value = word if name in ("_", "sensor") else number
            expression += value if name == "_" else f"(?P<{name}>{value})"
        elif _SEPARATOR.fullmatch(piece):
            is_between_parts = is_before_part and _PART.fullmatch(before) is not None
            repetition = "++" if is_between_parts else "*+"  # beside other text it may be missing
            expression += f"[{separators}]{repetition}"
        else:
            expression += rf"[{separators}]*+{re.escape(piece)}[{separators}]*+"
    return re.compile(expression)


def validated_form(line: str) -> str:
    """Return `line`, which is empty or a form of a line. Raises ValueError like `compile_line` otherwise."""
    if line:
        compile_line(line)
    return line


def suggested_line(text: str) -> str:
    """Return the form of the line `text` in which each number is `{_}`, to be filled in by a person."""
    has_decimal_comma = "." not in text and _DECIMAL_COMMA.search(text) is not None
    number = _COMMA if has_decimal_comma else _POINT
    form = re.sub(rf"(?<![\w.])(?:{_STAMP}|{number})|(?<=[A-Za-z])[+-]?\d+\.\d+", "{_}", text)
    return re.sub(r"\s*([,;|])[,;|\s]*|\s+", lambda separator: separator[1] or " ", form)


class LineParser:
    """Parses the lines of one stream: in the form that a person has described, else in documented ones."""

    def __init__(
        self, order: Order = "wxyz", line: str = "", parameter: str = "imu-bridge.serial.line"
    ) -> None:
        """Read numbers without names in `order`, or lines of the form `line`, which `parameter` sets."""
        self._order: Order = order
        self._form = compile_line(line) if line else None
        self._parameter = parameter

    def has_form(self, line: bytes) -> bool:
        """Return True if `line` has the form that a person has described."""
        if self._form is None:
            return False
        try:
            return self._form.fullmatch(_stripped(line)) is not None
        except ValueError:
            return False

    def parse(self, line: bytes) -> QuaternionLine | ButtonLine | None:
        """Return the content of `line`, or None for an empty line or one that is passed over.

        Raises:
            ContentError: If it has another form, or a wrong value. Names the parameter that describes it.
        """
        try:
            text = _stripped(line)
        except ValueError as error:
            raise ContentError("is not text") from error
        if self._form is not None:
            values = self._form.fullmatch(text)
            if values is not None:
                return _parse_described(values.groupdict())
        if not text or text.casefold().startswith(_PASSED_OVER):
            return None
        button = _BUTTON.match(text)
        if button is not None:
            names = (button[1].strip(),) if button[1] else ()
            gesture = (button[2] or "press").lower()
            return ButtonLine(cast("Gesture", gesture), names)
        if self._form is not None:
            raise ContentError(f"has another form than {self._parameter}; {self._remedy(text)}")
        return self._parse_documented(text)

    def _parse_documented(self, text: str) -> QuaternionLine:
        if text.startswith("{"):
            return self._parse_json(text)
        label = _LABEL.match(text)
        content = text if label is None else text[label.end() :]
        words = _SEPARATOR.split(content)
        if len(words) == 4 and all(map(_NUMBER.fullmatch, words)):
            return QuaternionLine(unit_rotation(words, self._order))
        fields = re.split(rf"[:={_SEPARATORS}]+", content)
        if len(fields) == 8 and all(map(_NUMBER.fullmatch, fields[1::2])):
            four = named_components(dict(zip(fields[::2], fields[1::2], strict=True)))
            if four is not None:
                return QuaternionLine(unit_rotation(four, "xyzw"))
        raise ContentError(f"has none of the documented forms; {self._remedy(text)}")

    def _parse_json(self, text: str) -> QuaternionLine:
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ContentError(f"is no JSON ({error}); {self._remedy(text)}") from error
        try:
            return QuaternionLine(quaternion_in(content, self._order), None, names_in(content))
        except ContentError as error:
            raise ContentError(f"{error}; {self._remedy(text)}") from error

    def _remedy(self, text: str) -> str:
        form = suggested_line(text)
        if form.count("{_}") < 4:
            return "let the device send four numbers, w, x, y and z"
        return (
            f"describe it by {self._parameter}={json.dumps(form, ensure_ascii=False)}, with {{w}}, {{x}}, "
            "{y} and {z} for the quaternion's {_}"
        )


def _stripped(line: bytes) -> str:
    """Return the text of `line` without what may stand around it. Raises: ValueError: If it is no text."""
    return line.decode().strip(" ,;|\t\r\n\0\ufeff")


def _parse_described(values: dict[str, str]) -> QuaternionLine:
    times: list[int] = []
    for key, unit in TIME_NS.items():
        if key in values:
            number = float(values[key].replace(",", "."))
            times.append(_time_ns(number * unit))
    components = [values[axis].replace(",", ".") for axis in "xyzw"]
    names = (values["sensor"],) if "sensor" in values else ()
    return QuaternionLine(unit_rotation(components, "xyzw"), times[0] if times else None, names)


def _time_ns(time_ns: float) -> int:
    if not 0 <= time_ns <= MAX_TIME_US * 1e3:
        raise ContentError(f"has the time {time_ns / 1e3:g} µs")
    return round(time_ns)
