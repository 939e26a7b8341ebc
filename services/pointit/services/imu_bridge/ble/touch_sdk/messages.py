"""Messages of the Touch SDK: decoded `Update`s of a watch, and encoded `InputUpdate`s to it.

Numbers of the fields are those of the maker's public specification. Fields that are not used are skipped.
"""

from dataclasses import dataclass

from pointit.geometry.vector import Vec3
from pointit.services.imu_bridge.ble.touch_sdk.wire_format import (
    MessageFields,
    encode_bytes,
    encode_float,
    encode_text,
    encode_varint,
)

ADVERTISED_SERVICE = "008e74d0-7bb3-4ac5-8baf-e5e372cced76"
OUTPUT = "f9d60371-5325-4c64-b874-a68c7c555bad"
INPUT = "f9d60372-5325-4c64-b874-a68c7c555bad"
PINCH = 1
"""Type of a gesture: thumb and forefinger tap each other."""
BEGIN, END, MOVE, CANCEL = 1, 2, 3, 4
"""Types of a touch."""
DISCONNECT = 1
"""Signal: the person declines or forgets this program, or the watch's app ends."""
RIGHT, LEFT = 1, 2
"""Hands that wear the watch."""
MAX_HAPTIC_MS = 5000
"""Longest vibration, ms."""
Quat = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class SensorFrame:
    """Values of the motion sensors at one time, in Android's frame of the device."""

    angular_velocity_radps: Vec3
    acceleration_mps2: Vec3
    orientation_xyzw: Quat
    """world_from_sensor as sent: of any norm, and four zeros if absent."""
    delta_ms: int
    """Time since the frame before, ms."""


@dataclass(frozen=True, slots=True)
class TouchEvent:
    """A change of the fingers on the screen."""

    kind: int
    coordinates_px: tuple[tuple[float, float], ...]
    """Position of each finger: right and down from the upper left corner, px."""


@dataclass(frozen=True, slots=True)
class WatchInfo:
    """Description of the watch."""

    hand: int
    battery_percent: int
    """Charge in %. 0 if absent."""
    screen_width_px: float
    """Width of its screen, px. 0 if absent."""


@dataclass(frozen=True, slots=True)
class Update:
    """Content of one message of a watch. Numbers that an enumeration does not know are kept."""

    frames: tuple[SensorFrame, ...]
    gestures: tuple[int, ...]
    touches: tuple[TouchEvent, ...]
    rotary_steps: tuple[int, ...]
    signals: tuple[int, ...]
    delta_ms: int
    """Time since the message before, ms. 0 if absent."""
    unix_ms: int
    """The watch's clock, ms since 1970. 0 if absent."""
    info: WatchInfo | None


def decode_update(data: bytes) -> Update:
    """Return the content of a message of *output*.

    Raises:
        ValueError: If it is cut, or no message.
    """
    fields = MessageFields(data)
    info = fields.message(9)
    return Update(
        frames=tuple(_decode_frame(each) for each in fields.messages(1)),
        gestures=tuple(MessageFields(each).integer(1) for each in fields.messages(2)),
        touches=tuple(_decode_touch(each) for each in fields.messages(3)),
        rotary_steps=tuple(MessageFields(each).integer(1) for each in fields.messages(5)),
        signals=fields.integers(6),
        delta_ms=fields.integer(7),
        unix_ms=fields.integer(8, 64),
        info=None if info is None else _decode_info(info),
    )


def encode_haptic(intensity: float, duration_ms: int) -> bytes:
    """Return the `InputUpdate` of one vibration: `intensity` from 0 to 1, at most `MAX_HAPTIC_MS` long."""
    event = (
        encode_varint(1, 1) + encode_float(2, intensity) + encode_varint(3, min(duration_ms, MAX_HAPTIC_MS))
    )
    return encode_bytes(1, event)


def encode_client_info(app: str, device: str, system: str) -> bytes:
    """Return the `InputUpdate` by which a program introduces itself; the watch shows it to the person."""
    return encode_bytes(2, encode_text(1, app) + encode_text(2, device) + encode_text(4, system))


def _decode_frame(data: bytes) -> SensorFrame:
    fields = MessageFields(data)
    quaternion = MessageFields(fields.message(4) or b"")
    return SensorFrame(
        angular_velocity_radps=_decode_vector(fields.message(1)),
        acceleration_mps2=_decode_vector(fields.message(2)),
        orientation_xyzw=(quaternion.real(2), quaternion.real(3), quaternion.real(4), quaternion.real(1)),
        delta_ms=fields.integer(5),
    )


def _decode_vector(data: bytes | None) -> Vec3:
    fields = MessageFields(data or b"")
    return (fields.real(1), fields.real(2), fields.real(3))


def _decode_touch(data: bytes) -> TouchEvent:
    fields = MessageFields(data)
    positions = [MessageFields(each) for each in fields.messages(4)]
    return TouchEvent(fields.integer(1), tuple((each.real(1), each.real(2)) for each in positions))


def _decode_info(data: bytes) -> WatchInfo:
    fields = MessageFields(data)
    return WatchInfo(
        hand=fields.integer(1),
        battery_percent=fields.integer(9),
        screen_width_px=MessageFields(fields.message(11) or b"").real(1),
    )
