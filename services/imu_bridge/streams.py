"""Quaternions among other content of a stream: JSON of apps and sketches, and the choice of one sensor."""

import codecs
import math
import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count, islice, pairwise
from typing import Any, Literal, TypeGuard

from pointit.geometry.rotation import Quaternion
from pointit.schemas.base import unit_quaternion

MAX_OTHERS = 8
"""Number of other sensors that a warning names."""
MAX_NAMES = 64
"""Number of different names from which counts or times may be among them."""
MIN_READINGS = 4
"""Smallest mean number of readings of each, else they are: counts that begin again return as well."""
MIN_SHARED = 3
"""Smallest number of such names that share a sensor's name. A time is shared by successive ones only."""
MIN_REPEATED = 8
"""Number of readings with the same name among the newest from which it is no count."""
FORGET_AFTER = 500
"""Number of readings after which a silent sensor is no longer named."""
_WORD = re.compile(r"[\w.\-]+")
_COUNTS = (re.compile(r"\d+"), re.compile(r"(?=[a-f]*\d)[\da-f]{2,}|\d|\b[\da-f]{4,}\b", re.IGNORECASE))
"""Parts of names that may be counts: decimal, then hexadecimal."""
_ANYTHING = re.compile(r".+", re.DOTALL)


class SensorChoice:
    """Uses the sensor that is configured, else the first, and reports the others. They never replace it."""

    def __init__(self, parameter: str, wanted: str = "", *, is_noisy: bool = False) -> None:
        """Use the sensor whose name, or a word of it, is `wanted`; `""`: the first one.

        Args:
            parameter: that sets `wanted`, for the warning.
            wanted: name, number or address.
            is_noisy: the stream has no checksum, so that a name counts only when it is repeated.
        """
        self._parameter = parameter
        self._wanted = wanted.strip().casefold()
        self._is_noisy = is_noisy
        self.used: str | None = None
        """Name of the sensor in use; `""` if it has none."""
        self._used_count = 0
        """Number of its last reading."""
        self._used_total = 0
        """Number of its readings in a row, without those of others."""
        self._used_names: tuple[str, ...] = ()
        self._seen: dict[tuple[str, ...], None] = {}
        """Names that were read, in their order."""
        self._shared: set[str] = set()
        """Names that tell sensors apart although others are counts or times."""
        self._counts: re.Pattern[str] | None = None
        """Parts of other names that are counts, or None while no counts are among them."""
        self._unshared: deque[str] = deque(maxlen=MAX_NAMES)
        """The newest names that are counts."""
        self._fixed: set[tuple[str, int]] = set()
        """Numbers in names that are no counts: the name with # for each of them, and which one."""
        self._changing = ""
        """Name of a reading, if the names of all of them differ and are no count, else `""`."""
        self._count = 0
        self._others: dict[str, int] = {}
        """Names of other sensors, and the number of the last reading of each."""

    def accepts(self, *names: str) -> bool:
        """Return True if a reading of the sensor with `names`, such as a label and a number, is used."""
        raw, names = names, self._names(names)
        name = " ".join(names)
        self._count += 1
        is_new = names not in self._seen and len(self._seen) <= MAX_NAMES
        if is_new:
            self._seen[names] = None
            is_full = len(self._seen) > MAX_NAMES
            if is_full and self._counts is None and self._count < MIN_READINGS * MAX_NAMES:
                self._find_counts()
                return self.accepts(*raw)
        is_doubtful = is_new and not self._wanted and (self._is_noisy or self._is_count(names))
        if self.used == "" and name and self._count - self._used_count > MAX_NAMES:
            self.used = None  # numbers are known as those of sensors after some readings
        if self._wanted:
            words = {name, *names, *raw, *_WORD.findall(" ".join((name, *raw)))}
            is_used = self._wanted in map(str.casefold, words)
        elif self.used is None and self._is_noisy and is_new and name:
            return False
        else:
            is_used = self.used is None or name.casefold() == self.used.casefold()
        if is_used:
            self._used_total = self._used_total + 1 if name == self.used else 1
            self.used, self._used_names, self._used_count = name, names, self._count
            self._others.pop(name, None)
        elif name in self._others or (len(self._others) < MAX_OTHERS and not is_doubtful):
            self._others[name] = self._count
        return is_used

    def _is_count(self, names: tuple[str, ...]) -> bool:
        """Return True if new `names` may be of the sensor in use with a count."""
        is_known = self._used_total >= MIN_SHARED and self._used_names != ()
        is_other = is_known and set(self._used_names).isdisjoint(names)
        return any(map(str.isdigit, "".join(names))) and not is_other

    def _find_counts(self) -> None:
        """Find the parts of the names that are counts or times, and tell sensors apart by the rest."""
        indices: dict[str, list[int]] = {}
        for index, names in enumerate(self._seen):
            for each in names:
                indices.setdefault(each, []).append(index)
        self._shared = {
            each for each, at in indices.items() if len(at) >= MIN_SHARED and at[-1] - at[0] >= MAX_NAMES // 2
        }
        remaining: set[tuple[str, ...]] = set()
        for self._counts in (*_COUNTS, _ANYTHING):
            parts: dict[str, list[list[str]]] = {}
            for each in chain(*(names for names in self._seen if self._shared.isdisjoint(names))):
                parts.setdefault(self._counts.sub("#", each), []).append(self._counts.findall(each))
            self._fixed = {
                (shape, at)
                for shape, rows in parts.items()
                for at, column in enumerate(zip(*rows, strict=True))
                if _are_fixed(column)
            }
            remaining = {tuple(self._without_counts(names)) for names in self._seen}
            if len(remaining) <= MAX_OTHERS:
                break
        is_count = all(len(names) == 1 and names[0].isdigit() for names in self._seen)
        is_count = is_count and all(int(a[0]) < int(b[0]) for a, b in pairwise(self._seen))
        self._changing = "" if is_count or any(remaining) else " ".join(next(reversed(self._seen)))
        self.used = None if self.used is None else " ".join(self._without_counts(self._used_names))
        self._others.clear()
        self._seen.clear()

    def _without_counts(self, names: Iterable[str]) -> Iterator[str]:
        for each in names:
            name = each if each in self._shared else self._masked(each)
            if any(map(str.isalnum, name)):
                yield name

    def _masked(self, name: str) -> str:
        """Return `name` with # for each count in it."""
        if self._counts is None:
            return name
        shape, index = self._counts.sub("#", name), count()
        return self._counts.sub(lambda part: part[0] if (shape, next(index)) in self._fixed else "#", name)

    def _names(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of `names` that tell sensors apart, without counts in them."""
        for each in names if self._counts else ():
            if each and each not in self._shared:
                self._unshared.append(each)
                if self._unshared.count(each) >= MIN_REPEATED:
                    self._shared.add(each)
        return tuple(self._without_counts(names))

    def is_other(self, *names: str) -> bool:
        """Return True if an event of the sensor with `names` is not of the one in use."""
        name = " ".join(self._names(names))
        return name in self._others or (bool(name) and self.used is not None and name != self.used)

    @property
    def others(self) -> tuple[str, ...]:
        """Return the names of other sensors, `""` for one without a name."""
        return tuple(self._others)

    @property
    def warning(self) -> str:
        """Return the warning that other sensors are heard, or `""`. Those of a configured one need none."""
        self._others = {name: n for name, n in self._others.items() if self._count - n < FORGET_AFTER}
        others = ", ".join(name or "one without a name" for name in self._others)
        if self._wanted and self.used is not None:
            return ""
        if self._changing and not others:
            return (
                f"each reading names another sensor, the last {self._changing[:40]}, so that several cannot "
                f"be told apart; let it send a name that stays the same, and set {self._parameter} to it"
            )
        if not others:
            return ""
        if self._wanted:
            return f"no sensor {self._wanted!r} is heard, but {others}: set {self._parameter} to one of them"
        used = self.used or "one without a name"
        return (
            f"several sensors send in one stream: {used} is used, not {others}; set {self._parameter} to "
            "the one on the wrist"
        )


def _are_fixed(values: Sequence[str]) -> bool:
    """Return True if numbers in names of one form are those of sensors: they are the same, or return."""
    different, changes = len(set(values)), sum(a != b for a, b in pairwise(values))
    return different == 1 or (different <= MAX_NAMES // 2 and changes >= different)


MIN_READABLE = 0.8
"""Smallest share of readable characters in text."""
_UNREADABLE = "\ufffd"


def quoted(data: bytes, max_bytes: int = 40) -> str:
    """Return the first `max_bytes` bytes: quoted text with escaped control characters, else hexadecimal."""
    shown = data[:max_bytes]
    letters = _decoded(shown, "replace")
    readable = sum(each != _UNREADABLE and (each.isprintable() or each in "\t\r\n") for each in letters)
    if readable < MIN_READABLE * len(letters):
        return shown.hex(" ")
    text = _decoded(shown, "backslashreplace")
    return "'" + "".join(each if each.isprintable() else repr(each)[1:-1] for each in text) + "'"


def _decoded(data: bytes, errors: str) -> str:
    """Return UTF-8 `data` as text, without a character that is cut off at its end."""
    return codecs.getincrementaldecoder("utf-8")(errors).decode(data)


Order = Literal["wxyz", "xyzw"]
"""Order of a quaternion's numbers in a list."""
MAX_DEPTH = 5
"""Objects within objects that are searched."""
MAX_QUATERNIONS = 64
MAX_NAME = 64
"""Largest number of characters of a sensor's name."""
ID_KEYS = frozenset({
    "id", "sensor", "name", "device", "mac", "uuid", "address", "addr", "imu", "node", "tracker", "serial",
    "serialnumber", "sn", "label", "source", "board", "channel", "index", "joint", "bone", "segment", "limb",
    "part", "bodypart", "body", "hand", "side", "location", "position", "player", "user", "person", "ch",
    "dev", "port", "mux", "topic", "frame",
})  # fmt: skip
"""Names of fields that tell sensors apart, without separators; also with one of `_ID_ENDS` behind them."""
_ID_ENDS = ("", "id", "name", "address", "number", "index", "idx", "no", "num", "nr")
_ID_FIELDS = frozenset(key + end for key in ID_KEYS for end in _ID_ENDS) - {
    "frame",
    "framenumber",
    "frameindex",
}
_KINDS = frozenset({
    "quaternion", "quat", "q", "orientation", "rotation", "attitude", "pose", "motion", "sensordata", "data",
    "payload", "message", "msg", "values", "reading", "readings", "sensor", "sensors", "device", "devices",
    "imu", "imus", "gamerotationvector", "rotationvector",
})  # fmt: skip
"""Names of fields that hold orientations and do not tell sensors apart."""
_LISTS = frozenset({"quaternion", "quat", "q", "orientation", "rotation"})
_HEADERS = frozenset({"header", "meta", "metadata", "info"})
"""Names of fields whose object may name the sensor."""
_ORDERS: Mapping[str, Order] = {"wxyz": "wxyz", "xyzw": "xyzw"}
_ORDER_FIELDS = frozenset({"order", "format", "convention", "quatorder", "quaternionorder", "quatformat"})
"""Names of fields that state the order of the numbers in a list."""
SAME = 1e-3
"""Largest difference of the numbers of quaternions that state one rotation twice."""
_ANGLES = frozenset({"yaw", "pitch", "roll", "heading", "euler", "ypr", "rpy"})
_VECTORS = re.compile(
    r"(?:raw|lin|linear|user|local|world|angular|device|motion)*(?:acc(?:el(?:eration|erometer)?)?|"
    r"gyr(?:o(?:scope)?)?|mag(?:net(?:ometer|ic(?:field)?))?|grav(?:ity)?|pos(?:ition)?|translation|"
    r"velocity|rotationrate|euler(?:angles)?|scale)s?"
)
"""Names of fields with other vectors, which may have a component w."""
_PREFIX = re.compile(
    r"(?:motion|device|attitude)?(?:quaternion|quat|q|orientation|orient|rotation|rot)(?=[wxyzrijk0-3s]\Z|real\Z)"
)
_COMPONENTS = {
    "w": "w",
    "x": "x",
    "y": "y",
    "z": "z",
    "r": "w",
    "real": "w",
    "s": "w",
    "i": "x",
    "j": "y",
    "k": "z",
}
_NUMBERED = {"0": "w", "1": "x", "2": "y", "3": "z"}


class ContentError(ValueError):
    """No quaternion can be read; the message is a clause whose subject is the content."""


@dataclass(frozen=True, slots=True)
class NamedQuaternion:
    """world_from_sensor, scalar last and with norm 1."""

    orientation_xyzw: Quaternion
    names: tuple[str, ...]
    """Names, numbers or addresses of its sensor."""
    key: str = ""
    """Name of its field, or `""`."""


def component(key: str) -> tuple[str, bool]:
    """Return the component w, x, y or z that a field's name means, or `""`, and whether it says quaternion.

    q0 to q3 are w, x, y, z, as Madgwick and the makers of DMPs count them.
    """
    plain = _plain(key)
    rest = _PREFIX.sub("", plain, count=1)
    if rest == plain:
        return _COMPONENTS.get(plain, ""), False
    return _COMPONENTS.get(rest, "") or _NUMBERED.get(rest, ""), True


def is_id(key: str) -> bool:
    """Return True if the field `key` tells sensors apart, such as `sensor_id`."""
    return _plain(key) in _ID_FIELDS


def quaternions(content: Any, order: Order) -> list[NamedQuaternion]:
    """Return all quaternions in parsed JSON, by name or as a list in `order`.

    Raises:
        ContentError: If there is none, or its norm is wrong.
    """
    found = _with_own_names([*islice(_search(content, order, (), 0), MAX_QUATERNIONS)])
    if not found:
        has_angles = is_object(content) and any(_plain(key) in _ANGLES for key in content)
        remedy = "angles only: let it send quaternions" if has_angles else "no quaternion"
        raise ContentError(f"has {remedy}")
    return found


def names_in(content: Mapping[str, Any], depth: int = 0) -> tuple[str, ...]:
    """Return the values of those fields of `content` that tell sensors apart."""
    names: list[str] = []
    for key, value in content.items():
        if not is_id(key):
            is_header = _plain(key) in _HEADERS and depth < MAX_DEPTH
            names += names_in(value, depth + 1) if is_header and is_object(value) else ()
        elif isinstance(value, float):  # some languages have no other numbers
            names.append(f"{value:.15g}")
        elif isinstance(value, str | int) and not isinstance(value, bool):
            names.append(f"{value}"[:MAX_NAME])
        elif is_object(value) and depth < MAX_DEPTH:
            names += names_in(value, depth + 1)
    return tuple(names)


def _search(content: Any, order: Order, names: tuple[str, ...], depth: int) -> Iterator[NamedQuaternion]:
    if depth > MAX_DEPTH:
        return
    if _is_list(content):
        for number, each in enumerate(content):
            if is_object(each):
                own = (*names, f"{number}") if len(content) > 1 and not names_in(each) else names
                yield from _search(each, order, own, depth + 1)
        return
    if not is_object(content):
        return
    names = tuple(dict.fromkeys((*names, *names_in(content))))
    order = _stated_order(content) or order
    four = _components(content)
    if four is not None:
        yield NamedQuaternion(four, names)
    for key, value in content.items():
        for each in _search_field(key, value, order, names, depth):
            yield replace(each, key=each.key or key[:MAX_NAME])


def _stated_order(content: Mapping[str, Any]) -> Order | None:
    """Return the order that a field such as `order` states, or None."""
    for key, value in content.items():
        if _plain(key) in _ORDER_FIELDS and (order := _ORDERS.get(_plain(value))):
            return order
    return None


def _search_field(
    key: str, value: Any, order: Order, names: tuple[str, ...], depth: int
) -> Iterator[NamedQuaternion]:
    plain, full = _plain(key), (*names, key[:MAX_NAME])
    for word in [each for each in _ORDERS if each in plain]:
        plain, order = plain.replace(word, ""), _ORDERS[word]
    if (plain in _LISTS or "quat" in plain) and (numbers := _four_numbers(value)):
        yield NamedQuaternion(_rotation(numbers, order), names if plain in _LISTS else full)
    elif (is_object(value) or _is_list(value)) and not _VECTORS.fullmatch(plain):
        yield from _search(value, order, names if plain in _KINDS or is_id(key) else full, depth + 1)


def _four_numbers(value: Any) -> list[Any] | None:
    """Return the numbers of a list of four, or of a string such as `1, 0, 0, 0`, or None."""
    values = re.split(r"[,;\s]+", value.strip(" []()")) if isinstance(value, str) else value
    is_four = _is_list(values) and len(values) == 4
    return values if is_four and not any(is_object(each) or _is_list(each) for each in values) else None


def _with_own_names(quaternions: list[NamedQuaternion]) -> list[NamedQuaternion]:
    """Return those with the same names with that of their field or position, each rotation once."""
    counts = Counter(each.names for each in quaternions)
    keys = Counter((each.names, each.key) for each in quaternions)
    named: list[NamedQuaternion] = []
    for number, each in enumerate(quaternions, 1):
        if any(each.names == other.names and _are_same(each, other) for other in quaternions[: number - 1]):
            continue
        is_key_own = each.key != "" and keys[each.names, each.key] == 1
        own = (each.key if is_key_own else f"{number}",) if counts[each.names] > 1 else ()
        named.append(replace(each, names=(*each.names, *own)))
    return named


def _are_same(a: NamedQuaternion, b: NamedQuaternion) -> bool:
    return math.dist(a.orientation_xyzw, b.orientation_xyzw) < SAME


def _components(content: Mapping[str, Any]) -> Quaternion | None:
    """Return the quaternion whose components are fields of `content`, or None."""
    values: dict[tuple[str, bool], Any] = {component(key): value for key, value in content.items()}
    for says_quaternion in (True, False):
        four = [values.get((each, says_quaternion)) for each in "xyzw"]
        if all(isinstance(each, str | int | float) and not isinstance(each, bool) for each in four):
            return _rotation(four, "xyzw")
    return None


def _rotation(values: list[Any], order: Order) -> Quaternion:
    try:
        a, b, c, d = map(float, values)
    except (ValueError, TypeError, OverflowError) as error:
        raise ContentError(f"has {values} where numbers were expected"[:120]) from error
    try:
        return unit_quaternion((b, c, d, a) if order == "wxyz" else (a, b, c, d))
    except ValueError as error:
        raise ContentError(f"has {error}") from error


def _plain(key: Any) -> str:
    return re.sub(r"[\W_]", "", f"{key}".casefold())


def is_object(value: Any) -> TypeGuard[dict[str, Any]]:
    """Return True if parsed JSON is an object."""
    return isinstance(value, dict)


def _is_list(value: Any) -> TypeGuard[list[Any]]:
    return isinstance(value, list)
