"""Lines of text of a board: bytes to lines, lines to readings of one of its sensors."""

from pointit.services.imu_bridge.serial.framers import SerialFramer
from pointit.services.imu_bridge.serial.line_parser import LONGEST_LINE, LineParser, QuaternionLine
from pointit.services.imu_bridge.sources import Item, Press, Reading
from pointit.services.imu_bridge.streams import (
    QUOTED_BYTES,
    ContentError,
    Order,
    SensorChoice,
    is_text,
    quoted,
)


class LineSplitter:
    """Cuts a stream of bytes into lines and buffers at most one of them.

    Bytes before the first line end are discarded: a port is usually opened in the middle of a line.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._skipping = True
        self.overlong = 0
        """Number of discarded pieces that exceeded the longest line."""

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


class TextFramer(SerialFramer):
    """Reads quaternions and gestures."""

    UNIT = "lines"
    HINT = "check baud, order and line"

    def __init__(self, order: Order = "wxyz", form: str = "", sensors: SensorChoice | None = None) -> None:
        """Read lines as a `LineParser` of `order` and `form`, and those of one of the `sensors`."""
        super().__init__()
        self.refused_text = ""
        """The last line that was refused, with the reason, if it is text; else empty."""
        self._parser = LineParser(order, form)
        self._splitter = LineSplitter()
        self._sensors = SensorChoice("serial.sensor") if sensors is None else sensors

    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the items in the lines that `data` completes."""
        items: list[Item] = []
        overlong = self._splitter.overlong
        for line in self._splitter.feed(data):
            try:
                items += self._parse_line(line, stamp_ns)
            except ContentError as error:
                reason = f"{quoted(line)} {error}"
                self._count_bad(1, reason)
                self.refused_text = reason if is_text(line[:QUOTED_BYTES]) else ""
        if self._splitter.overlong > overlong:
            self.refused_text = ""
            self._count_bad(self._splitter.overlong - overlong, f"a line of more than {LONGEST_LINE} bytes")
        return items

    def _parse_line(self, line: bytes, stamp_ns: int) -> list[Item]:
        parsed = self._parser.parse(line)
        if parsed is None:
            self.passed_over.add("comment lines")
            return []
        self.good += 1  # also of another sensor
        if isinstance(parsed, QuaternionLine):
            if not self._sensors.accepts(*parsed.names):
                return []
            return [Reading(stamp_ns, parsed.orientation_xyzw, parsed.device_time_ns)]
        return [] if self._sensors.is_other(*parsed.names) else [Press(stamp_ns, parsed.gesture)]

    def _count_bad(self, count: int, reason: str) -> None:
        self.bad += count
        self.reason = reason
