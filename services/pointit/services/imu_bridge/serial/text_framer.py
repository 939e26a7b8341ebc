"""Lines of text that boards send: framer of `text_line.py`."""

from pointit.services.imu_bridge.reading import Item, Press, Reading
from pointit.services.imu_bridge.serial.framer import Framer
from pointit.services.imu_bridge.serial.text_line import (
    ButtonLine,
    Fifth,
    LineError,
    LineParser,
    LineSplitter,
    Order,
)


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
