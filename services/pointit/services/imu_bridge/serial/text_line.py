r"""Lines of text that boards send over a serial port: bytes to lines, lines to readings (hardware.md A.3b).

    line       = [name ":"] number{4,5} | button
    number     = decimal, separated by commas, semicolons or white space; one may trail
    button     = ("button" | "b") ["press" | "double" | "hold"]

Four numbers are a quaternion in the configured order; a fifth is a leading device time in µs or a trailing
accuracy. Lines that boards mix in between (`Orientation:`, `Calibration:`, comments) are passed over.
"""

import math
import re
from dataclasses import dataclass
from typing import Literal, cast

from pointit.geometry.rotation import Quaternion, normalized
from pointit.services.imu_bridge.reading import Item, Press, Reading
from pointit.services.imu_bridge.serial.framer import Framer

LONGEST_LINE = 256
"""Longest line, bytes; longer ones are discarded on arrival."""
NORM_TOLERANCE = 0.1
"""Largest deviation of a quaternion's norm from 1: boards send two decimals."""
MAX_TIME_US = 2**53
"""Largest time in µs that is exact as a float; 285 years."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\Z")
_NAMED = re.compile(r"\s*([A-Za-z][\w \-]*?)\s*:(.*)", re.DOTALL)
_BUTTON = re.compile(r"(?:button|b)(?:[:,;\s]+(press|double|hold))?\Z", re.IGNORECASE)
_SEPARATOR = re.compile(r"[,;\s]+")
_OTHER_NAMES = frozenset({
    "orientation", "calibration", "euler", "heading", "raw", "uncal", "unical", "accel", "gyro", "mag",
    "temp",
})  # fmt: skip
"""Names of lines with other numbers that may look like a quaternion."""
Gesture = Literal["press", "double", "hold"]
Order = Literal["wxyz", "xyzw"]
"""Order of a quaternion's numbers in a line."""
Fifth = Literal["auto", "time", "accuracy"]
"""Meaning of a fifth number in a line."""


class LineError(ValueError):
    """A line is neither a quaternion nor a button; the message says why."""


@dataclass(frozen=True, slots=True)
class QuaternionLine:
    """world_from_sensor, scalar last and with norm 1, and the device's time if it sends one."""

    orientation_xyzw: Quaternion
    device_time_ns: int | None = None


@dataclass(frozen=True, slots=True)
class ButtonLine:
    """A gesture on the device's button."""

    gesture: Gesture = "press"


class LineSplitter:
    """Cuts a stream of bytes into lines and buffers at most one of them.

    Bytes before the first line end are discarded: a port is usually opened in the middle of a line.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._skipping = True
        self.overlong = 0
        """Number of discarded pieces that exceeded the longest line."""

    @property
    def kept(self) -> int:
        """Return the number of buffered bytes of an unfinished line, at most `LONGEST_LINE`."""
        return len(self._rest)

    def feed(self, data: bytes) -> list[bytes]:
        """Return the lines that `data` completes, without their ends and without empty ones."""
        *ended, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if ended and self._skipping:
            del ended[0]
            self._skipping = False
        lines: list[bytes] = []
        for line in ended:
            if len(line) > LONGEST_LINE:
                self.overlong += 1
            elif line:
                lines.append(line)
        if self._skipping:
            rest = b""
        elif len(rest) > LONGEST_LINE:
            self.overlong += 1
            self._skipping = True
            rest = b""
        self._rest = rest
        return lines


class LineParser:
    """Parses lines with one order of the quaternion's numbers."""

    def __init__(self, order: Order = "wxyz", fifth: Fifth = "auto") -> None:
        """Set the `order` and the meaning of a `fifth` number.

        `auto` reads it as a time if the first number is beyond ±(1 + tolerance): such a number cannot belong
        to a unit quaternion, and a device's time is that small only in its first microsecond.
        """
        self._order = order
        self._fifth = fifth

    def parse(self, line: bytes) -> QuaternionLine | ButtonLine | None:
        """Return the content of `line`, or None for an empty line, a comment, or another kind of reading.

        Raises:
            LineError: If it cannot be parsed.
        """
        try:
            text = line.decode("ascii").strip()
        except UnicodeDecodeError as error:
            raise LineError("is not text") from error
        if not text or text.startswith("#"):
            return None
        button = _BUTTON.match(text)
        if button:
            return ButtonLine(cast("Gesture", (button.group(1) or "press").lower()))
        named = _NAMED.match(text)
        if named:
            if named.group(1).lower() in _OTHER_NAMES:
                return None
            text = named.group(2)
        return self._quaternion([_number(word) for word in _SEPARATOR.split(text) if word])

    def _quaternion(self, numbers: list[float]) -> QuaternionLine:
        time_ns: int | None = None
        if len(numbers) == 5 and self._starts_with_time(numbers[0]):
            time_us = numbers.pop(0)
            if not 0 <= time_us <= MAX_TIME_US:
                raise LineError(f"has the time {time_us:g} µs")
            time_ns = round(time_us * 1000)
        elif len(numbers) == 5:
            numbers.pop()
        if len(numbers) != 4:
            raise LineError(f"has {len(numbers)} numbers, 4 or 5 were expected")
        norm = math.hypot(*numbers)
        if abs(norm - 1.0) > NORM_TOLERANCE:
            raise LineError(f"has a quaternion of norm {norm:.3g}, not 1")
        a, b, c, d = numbers
        return QuaternionLine(normalized((b, c, d, a) if self._order == "wxyz" else (a, b, c, d)), time_ns)

    def _starts_with_time(self, first: float) -> bool:
        return self._fifth == "time" or (self._fifth == "auto" and abs(first) > 1.0 + NORM_TOLERANCE)


def _number(word: str) -> float:
    if not _NUMBER.match(word):
        raise LineError(f"has {word[:20]!r} where a number was expected")
    value = float(word)
    if not math.isfinite(value):
        raise LineError(f"has {word[:20]!r}, which is not finite")
    return value


class TextFramer(Framer):
    """Reads quaternions and gestures."""

    UNIT = "lines"
    HINT = "a quaternion looks like `1.0,0.0,0.0,0.0`; check baud and order"

    def __init__(self, order: Order = "wxyz", fifth: Fifth = "auto") -> None:
        super().__init__()
        self._parser = LineParser(order, fifth)
        self._splitter = LineSplitter()

    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the items in the lines that `data` completes."""
        items: list[Item] = []
        overlong = self._splitter.overlong
        for line in self._splitter.feed(data):
            try:
                item = self._item(line, stamp_ns)
            except LineError as error:
                self._count(1, f"{line[:40]!r} {error}")
            else:
                if item is not None:
                    items.append(item)
        if self._splitter.overlong > overlong:
            self._count(self._splitter.overlong - overlong, "a line without an end")
        self.good += len(items)
        return items

    def _item(self, line: bytes, stamp_ns: int) -> Item | None:
        parsed = self._parser.parse(line)
        if isinstance(parsed, ButtonLine):
            return Press(stamp_ns, parsed.gesture)
        if parsed is None:
            return None
        return Reading(stamp_ns, parsed.orientation_xyzw, parsed.device_time_ns)

    def _count(self, count: int, reason: str) -> None:
        self.bad += count
        self.reason = reason
