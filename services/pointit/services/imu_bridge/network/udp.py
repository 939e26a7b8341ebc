"""Wrists that send datagrams of their own formats: SensaGram, WearMoCap, and a quaternion as JSON or text."""

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

from pydantic import Field

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.contents import DatagramError, Order, orientation, vector
from pointit.services.imu_bridge.network.datagram_source import DatagramConfig, DatagramSource, Decoder
from pointit.services.imu_bridge.reading import Item, Press, RawReading, Reading
from pointit.services.imu_bridge.serial.text_line import ButtonLine, LineError, LineParser
from pointit.services.imu_bridge.sources import ImuSource

LONGEST_DATAGRAM = 4096
MOST_LINES = 64
DEEPEST = 4
"""Objects within objects in which a quaternion is searched."""
TOGETHER_NS = NS_PER_S // 10
"""Largest age of the acceleration that belongs to a rate, ns."""
DAY_NS = 24 * 3600 * NS_PER_S
_WEARMOCAP = struct.Struct(">28f")
_ANDROID = "android.sensor."
_ORIENTATIONS = frozenset({"game_rotation_vector", "rotation_vector"})
_QUATERNION_KEYS = frozenset({"quaternion", "quat", "q", "orientation"})
_NAMES = (("x", "y", "z", "w"), ("qx", "qy", "qz", "qw"))


class UdpConfig(DatagramConfig):
    """A device that sends datagrams, whose format is found by reading them."""

    port: int = Field(
        default=46000,
        ge=1,
        le=65535,
        description="UDP port to which the device sends, WearMoCap always to 46000; each person has another",
    )
    order: Order = Field(
        default="wxyz", description="order of the quaternion's numbers in lines of text and in lists of JSON"
    )


class UdpDecoder(Decoder):
    """Reads the datagrams of one device. Its rates are used until it sends an orientation."""

    def __init__(self, config: UdpConfig) -> None:
        self._order: Order = config.order
        self._lines = LineParser(config.order)
        self._kind = ""
        """Android's sensor whose orientations are used, the first that came, or `""`."""
        self._acceleration: Vec3 | None = None
        self._acceleration_ns = 0
        self._before_ns: int | None = None
        """Time of WearMoCap's datagram before, ns."""

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the reading of a datagram, or nothing if it is of another sensor.

        Raises:
            DatagramError: If it cannot be read.
        """
        if len(data) > LONGEST_DATAGRAM:
            raise DatagramError(f"has {len(data)} bytes, more than {LONGEST_DATAGRAM}")
        text = data.strip()
        if text.startswith(b"{"):
            return self._json(text, stamp_ns)
        if len(data) == _WEARMOCAP.size and not text.isascii():
            return [self._wearmocap(data, stamp_ns)]
        return self._text(text, stamp_ns)

    def _text(self, text: bytes, stamp_ns: int) -> Sequence[Item]:
        found: list[Item] = []
        for line in text.splitlines()[:MOST_LINES]:
            try:
                parsed = self._lines.parse(line)
            except LineError as error:
                raise DatagramError(f"{line[:40]!r}, {error}") from error
            if isinstance(parsed, ButtonLine):
                found.append(Press(stamp_ns, parsed.gesture))
            elif parsed is not None:
                found.append(Reading(stamp_ns, parsed.orientation_xyzw, parsed.device_time_ns))
        return found

    def _json(self, text: bytes, stamp_ns: int) -> Sequence[Item]:
        try:
            item = self._content(json.loads(text), stamp_ns)
        except DatagramError:
            raise
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise DatagramError(f"cannot be read as JSON: {error}") from error
        return [] if item is None else [item]

    def _content(self, content: dict[str, Any], stamp_ns: int) -> Item | None:
        values = content.get("values")
        if _is_list(values):
            return self._android(content, _numbers(values), stamp_ns)
        four = _quaternion(content, self._order)
        if four is None:
            raise DatagramError("has no quaternion")
        return Reading(stamp_ns, orientation(four, "xyzw"), _time_ns(content))

    def _android(self, content: Mapping[str, Any], values: list[float], stamp_ns: int) -> Item | None:
        time_ns = _time_ns(content)
        kind = str(content.get("type", "rotation_vector")).removeprefix(_ANDROID)
        if kind in _ORIENTATIONS:
            self._kind = self._kind or kind
            if kind != self._kind:
                return None
            if len(values) == 3:  # old phones leave w out
                values.append(max(0.0, 1.0 - sum(value * value for value in values)) ** 0.5)
            if len(values) < 4:
                raise DatagramError(f"has {len(values)} values, 4 were expected")
            return Reading(stamp_ns, orientation(values[:4], "xyzw"), time_ns)
        if kind == "accelerometer":
            self._acceleration, self._acceleration_ns = vector(values), stamp_ns
        elif kind == "gyroscope" and not self._kind and self._acceleration is not None:
            rates = vector(values)
            if 0 <= stamp_ns - self._acceleration_ns < TOGETHER_NS:
                return RawReading(stamp_ns, rates, self._acceleration, time_ns)
        return None

    def _wearmocap(self, data: bytes, stamp_ns: int) -> Reading:
        """Return the reading of a datagram, whose time is that of the day."""
        numbers = _WEARMOCAP.unpack(data)
        world_from_sensor = orientation(numbers[5:9], "wxyz")
        hours, minutes, seconds, nanoseconds = vector(numbers[1:4]) + vector(numbers[4:7])[:1]
        time_ns = round((hours * 3600 + minutes * 60 + seconds) * NS_PER_S + nanoseconds)
        if not 0 <= time_ns < DAY_NS:
            return Reading(stamp_ns, world_from_sensor)
        if self._before_ns is not None:  # midnight is no restart
            time_ns += DAY_NS * max(0, round((self._before_ns - time_ns) / DAY_NS))
        self._before_ns = time_ns
        return Reading(stamp_ns, world_from_sensor, time_ns)


def _is_list(value: Any) -> TypeGuard[list[Any]]:
    return isinstance(value, list)


def _is_object(value: Any) -> TypeGuard[dict[str, Any]]:
    return isinstance(value, dict)


def _numbers(values: Sequence[Any]) -> list[float]:
    return [float(value) for value in values[:16]]


def _time_ns(content: Mapping[str, Any]) -> int | None:
    time_ns = content.get("timestamp")
    return time_ns if isinstance(time_ns, int) and 0 <= time_ns < 2**62 else None


def _quaternion(content: Mapping[str, Any], order: Order, depth: int = 0) -> Sequence[float] | None:
    """Return x, y, z, w of the first quaternion in `content`, by name or as a list in `order`, or None."""
    named = {f"{key}".casefold(): value for key, value in content.items()}
    for names in _NAMES:
        if all(name in named for name in names):
            return _numbers([named[name] for name in names])
    for key, value in named.items():
        if key in _QUATERNION_KEYS and _is_list(value) and len(value) == 4:
            return orientation(_numbers(value), order)
        if _is_object(value) and depth < DEEPEST:
            found = _quaternion(value, order, depth + 1)
            if found is not None:
                return found
    return None


UDP = ImuSource(
    summary="an app that sends datagrams: SensaGram, WearMoCap, a quaternion as JSON or text",
    config=UdpConfig,
    make=lambda config, around: DatagramSource(
        "udp", config, lambda: UdpDecoder(config), around.clock, around.health
    ),
    argument="port",
    argument_optional=True,
    example="46000",
)
