"""Wrists that send datagrams of their own formats: SensaGram, WearMoCap, and a quaternion as JSON or text."""

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field, field_validator

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.datagram_source import (
    DatagramConfig,
    DatagramSource,
    Decoder,
    vector,
)
from pointit.services.imu_bridge.serial.line_parser import ButtonLine, LineParser, validated_form
from pointit.services.imu_bridge.sources import ImuSource, Item, Press, RawReading, Reading
from pointit.services.imu_bridge.streams import (
    ContentError,
    Order,
    SensorChoice,
    is_object,
    names_in,
    quoted,
    unit_rotation,
)

LONGEST_DATAGRAM = 4096
MAX_LINES = 64
TOGETHER_NS = NS_PER_S // 10
"""Largest age of the acceleration that belongs to a rate, ns."""
DAY_NS = 24 * 3600 * NS_PER_S
_WEARMOCAP = struct.Struct(">28f")
_ANDROID = "android.sensor."
_RATES = frozenset({"accelerometer", "gyroscope"})
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
    line: str = Field(
        default="", description="form of a line of text, or of JSON as a line of text, as of `serial.line`"
    )

    _form = field_validator("line")(validated_form)


class UdpDecoder(Decoder):
    """Reads the datagrams of one device. Its rates are used until it sends an orientation."""

    def __init__(self, config: UdpConfig) -> None:
        super().__init__(SensorChoice("udp.sensor", config.sensor_name))
        self._is_described = config.line != ""
        self._lines = LineParser(config.order, config.line, "imu-bridge.udp.line")
        self._kind = ""
        """Android's sensor whose orientations are used, the first that came, or `""`."""
        self._acceleration: Vec3 | None = None
        self._acceleration_ns = 0
        self._before_ns: int | None = None
        """Time of WearMoCap's datagram before, ns."""

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the reading of a datagram, or nothing if it is of another sensor.

        Raises:
            ContentError: If it cannot be read.
        """
        if len(data) > LONGEST_DATAGRAM:
            raise ContentError(f"has {len(data)} bytes, more than {LONGEST_DATAGRAM}")
        text = data.strip()
        is_wearmocap = len(data) == _WEARMOCAP.size and not text.isascii()
        if is_wearmocap and not self._is_described:
            return [self._decode_wearmocap(data, stamp_ns)]
        items: list[Item] = []
        for message in self._messages(text):
            try:
                item = self._decode_message(message, stamp_ns)
            except ContentError as error:
                self.problem = f"{quoted(message)} {error}"
                continue
            if item is not None:
                items.append(item)
        if self.problem and not items:
            raise ContentError(self.problem)
        return items

    def _messages(self, text: bytes) -> Sequence[bytes]:
        """Return the lines in `text`, or its objects of JSON, which may have several lines each."""
        if not text.startswith((b"{", b"[{")):
            return text.splitlines()[:MAX_LINES]
        return [text] if self._lines.has_form(text) else _json_objects(text)

    def _decode_message(self, message: bytes, stamp_ns: int) -> Item | None:
        """Return the item in a JSON object or a line, or None if it is of another sensor or is passed over.

        Raises:
            ContentError: If it cannot be read.
        """
        # A message of SensaGram
        content = None if self._is_described else _sensagram(message)
        if content is not None:
            if not self.sensors.accepts(*names_in(content)):
                return None
            try:
                return self._decode_android(content, _numbers(content["values"]), stamp_ns)
            except ContentError:
                raise
            except (ValueError, TypeError, OverflowError) as error:
                raise ContentError(f"has a wrong value: {error}") from error

        # A quaternion or a button, as text or as JSON
        parsed = self._lines.parse(message)
        if parsed is None:
            self.passed_over.add("comment lines")
            return None
        if isinstance(parsed, ButtonLine):
            return None if self.sensors.is_other(*parsed.names) else Press(stamp_ns, parsed.gesture)
        if not self.sensors.accepts(*parsed.names):
            return None
        return Reading(stamp_ns, parsed.orientation_xyzw, parsed.device_time_ns)

    def _decode_android(self, content: Mapping[str, Any], values: list[float], stamp_ns: int) -> Item | None:
        # An orientation, of the first kind that comes
        time_ns = _time_ns(content)
        kind = str(content["type"]).removeprefix(_ANDROID)
        if kind in _ORIENTATIONS:
            self._kind = self._kind or kind
            if kind != self._kind:
                return None
            if len(values) == 3:  # old phones leave w out
                norm_squared = sum(value * value for value in values)
                values.append(max(0.0, 1.0 - norm_squared) ** 0.5)
            if len(values) < 4:
                raise ContentError(f"has {len(values)} values, 4 were expected")
            return Reading(stamp_ns, unit_rotation(values[:4], "xyzw"), time_ns)

        # Rates until then, each with the newest acceleration
        if kind not in _RATES:
            self.passed_over.add(kind)
        if kind == "accelerometer":
            self._acceleration = vector(values)
            self._acceleration_ns = stamp_ns
        elif kind == "gyroscope" and not self._kind:
            acceleration_mps2 = self._acceleration
            if acceleration_mps2 is not None:
                rates = vector(values)
                if 0 <= stamp_ns - self._acceleration_ns < TOGETHER_NS:
                    return RawReading(stamp_ns, rates, acceleration_mps2, time_ns)
        self.unused = self.unused or (
            f"gets readings of {kind[:40]}, but no rotation vector: switch on the game rotation vector"
        )
        return None

    def _decode_wearmocap(self, data: bytes, stamp_ns: int) -> Reading:
        """Return the reading of a datagram. Its time is the time of day."""
        numbers = _WEARMOCAP.unpack(data)
        world_from_sensor = unit_rotation(numbers[5:9], "wxyz")
        hours, minutes, seconds = vector(numbers[1:4])
        nanoseconds, _, _ = vector(numbers[4:7])
        time_ns = round((hours * 3600 + minutes * 60 + seconds) * NS_PER_S + nanoseconds)
        if not 0 <= time_ns < DAY_NS:
            return Reading(stamp_ns, world_from_sensor)
        if self._before_ns is not None:  # midnight is no restart
            days = round((self._before_ns - time_ns) / DAY_NS)
            time_ns += DAY_NS * max(0, days)
        self._before_ns = time_ns
        return Reading(stamp_ns, world_from_sensor, time_ns)


def _json_objects(text: bytes) -> list[bytes]:
    """Return the objects of JSON in `text`, in a list or one after the other; the last may be no object."""
    try:
        rest = text.decode()
    except UnicodeDecodeError:
        return [text]
    decoder = json.JSONDecoder()
    objects: list[bytes] = []
    rest = rest.removeprefix("[")
    while rest and len(objects) < MAX_LINES:
        try:
            _, end = decoder.raw_decode(rest)
        except (ValueError, RecursionError):
            objects.append(rest.encode())
            break
        objects.append(rest[:end].encode())
        rest = rest[end:].lstrip(" \t\r\n,;]\0")
    return objects


def _sensagram(text: bytes) -> dict[str, Any] | None:
    """Return the fields of a message of SensaGram, which has a type and a list of values, else None."""
    if not text.startswith(b"{"):
        return None
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not is_object(content) or "type" not in content:
        return None
    return content if isinstance(content.get("values"), list) else None


def _numbers(values: Sequence[Any]) -> list[float]:
    return [float(value) for value in values[:16]]


def _time_ns(content: Mapping[str, Any]) -> int | None:
    time_ns = content.get("timestamp")
    if not isinstance(time_ns, int):
        return None
    return time_ns if 0 <= time_ns < 2**62 else None


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
