"""Wrists that send datagrams of their own formats: SensaGram, WearMoCap, and a quaternion as JSON or text."""

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

from pydantic import Field

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.datagram_source import (
    DatagramConfig,
    DatagramError,
    DatagramSource,
    Decoder,
    orientation,
    vector,
)
from pointit.services.imu_bridge.serial.line_parser import ButtonLine, Fifth, LineError, LineParser
from pointit.services.imu_bridge.sources import ImuSource, Item, Press, RawReading, Reading
from pointit.services.imu_bridge.streams import (
    ContentError,
    Order,
    SensorChoice,
    is_object,
    names_in,
    quaternions,
    quoted,
)

LONGEST_DATAGRAM = 4096
MAX_LINES = 64
TOGETHER_NS = NS_PER_S // 10
"""Largest age of the acceleration that belongs to a rate, ns."""
MIN_UNIX_MS, MAX_UNIX_MS = 1e12, 1e13
"""Range of Unix times, ms: the years 2001 to 2286."""
DAY_NS = 24 * 3600 * NS_PER_S
_WEARMOCAP = struct.Struct(">28f")
_ANDROID = "android.sensor."
_ORIENTATIONS = frozenset({"game_rotation_vector", "rotation_vector", "geomagnetic_rotation_vector"})


class UdpConfig(DatagramConfig):
    """A device that sends datagrams. Their format is detected from their content."""

    port: int = Field(
        default=46000,
        ge=1,
        le=65535,
        description="UDP port to which the device sends, WearMoCap always to 46000; each person has another",
    )
    order: Order = Field(
        default="wxyz", description="order of the quaternion's numbers in lines of text and in lists of JSON"
    )
    fifth: Fifth = Field(
        default="auto", description="meaning of a fifth number in a line of text, as of `serial.fifth`"
    )


class UdpDecoder(Decoder):
    """Reads the datagrams of one device. Its rates are used until it sends an orientation."""

    def __init__(self, config: UdpConfig) -> None:
        super().__init__(SensorChoice("udp.sensor", config.sensor_name))
        self._order: Order = config.order
        self._lines = LineParser(config.order, config.fifth)
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
        if text.startswith((b"{", b"[{")):
            return self._json(text, stamp_ns)
        if len(data) == _WEARMOCAP.size and not text.isascii():
            return [self._wearmocap(data, stamp_ns)]
        return self._text(text, stamp_ns)

    def _text(self, text: bytes, stamp_ns: int) -> Sequence[Item]:
        items: list[Item] = []
        for line in text.splitlines()[:MAX_LINES]:
            try:
                parsed = self._lines.parse(line)
            except LineError as error:
                self.problem = f"{quoted(line)} {error}"
                continue
            if isinstance(parsed, ButtonLine):
                if not self.sensors.is_other(*parsed.names):
                    items.append(Press(stamp_ns, parsed.gesture))
            elif parsed is not None and self.sensors.accepts(*parsed.names):
                items.append(Reading(stamp_ns, parsed.orientation_xyzw, parsed.device_time_ns))
        if self.problem and not items:
            raise DatagramError(self.problem)
        return items

    def _json(self, text: bytes, stamp_ns: int) -> Sequence[Item]:
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            try:
                return self._text(text, stamp_ns)  # {w:1,x:0,y:0,z:0}, which is not JSON
            except DatagramError:
                raise DatagramError(f"{quoted(text)} cannot be read as JSON: {error}") from error
        try:
            return self._content(content, stamp_ns)
        except DatagramError:
            raise
        except ContentError as error:
            raise DatagramError(f"{quoted(text)} {error}") from error
        except (ValueError, TypeError, OverflowError) as error:
            raise DatagramError(f"{quoted(text)} has a wrong value: {error}") from error

    def _content(self, content: Any, stamp_ns: int) -> Sequence[Item]:
        if is_object(content) and _is_list(values := content.get("values")):
            if not self.sensors.accepts(*names_in(content)):
                return []
            item = self._android(content, _numbers(values), stamp_ns)
            return [] if item is None else [item]
        time_ns = _unix_ns(content) if is_object(content) else None
        return [
            Reading(stamp_ns, each.orientation_xyzw, time_ns)
            for each in quaternions(content, self._order)
            if self.sensors.accepts(*each.names)
        ]

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
        self.unused = self.unused or (
            f"gets readings of {kind[:40]}, but no rotation vector: switch on the game rotation vector"
        )
        return None

    def _wearmocap(self, data: bytes, stamp_ns: int) -> Reading:
        """Return the reading of a datagram. Its time is the time of day."""
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


def _numbers(values: Sequence[Any]) -> list[float]:
    return [float(value) for value in values[:16]]


def _time_ns(content: Mapping[str, Any]) -> int | None:
    time_ns = content.get("timestamp")
    return time_ns if isinstance(time_ns, int) and 0 <= time_ns < 2**62 else None


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


def _unix_ns(content: Mapping[str, Any]) -> int | None:
    """Return the Unix time of a message in ns. Since its unit is not stated, it follows from the amount."""
    time = content.get("timestamp")
    if not isinstance(time, int | float) or isinstance(time, bool) or not MIN_UNIX_MS <= time < 2**62:
        return None
    for scale in (1_000_000, 1000):  # of ms and µs
        if time * scale < MAX_UNIX_MS * 1_000_000:
            return round(time * scale)
    return round(time)
