"""Labels beside the numbers of a line of text: names of sensors, order of numbers, other readings."""

import re

from pointit.services.imu_bridge.streams.json_content import Order, component, is_id

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
