"""SlimeVR's tracker protocol: datagrams to packets, and answers to datagrams.

All numbers are big-endian. A tracker's datagram is `u32 kind | u64 number | payload`. Answers have the number
0, but for the handshake's and the sensor info's, which have none.
"""

import struct
from dataclasses import dataclass

from pointit.geometry.rotation import Quaternion
from pointit.schemas.person import Gesture
from pointit.schemas.printable import is_printable
from pointit.services.imu_bridge.sources import Battery, Signal
from pointit.services.imu_bridge.streams import ContentError, unit_rotation

PORT = 6969
LONGEST_DATAGRAM = 1500
WHOLE_TRACKER = 255
"""Number in place of a sensor's, for the tracker as a whole."""
HEARTBEAT = 1
HANDSHAKE = 3
PING = 10
HANDSHAKE_ANSWER = b"\x03Hey OVR =D 5".ljust(64, b"\0")
HEARTBEAT_DATAGRAM = struct.pack(">IQ", HEARTBEAT, 0)
FLAGS_ANSWER = struct.pack(">IQB", 22, 0, 0)
"""Feature flags of this server: none, so that trackers send no bundles and ask no more."""
OWOTRACK_BOARD = 13
SHARED_MACS = frozenset({"00:00:00:00:00:00", "FF:FF:FF:FF:FF:FF", "00:45:00:00:00:00", "00:0F:00:0F:00:0F"})
"""Addresses that say nothing: none, owoTrack's before it has drawn its own, and that of every Wrangler."""
_ACTIONS: dict[int, Gesture] = {2: "double", 3: "press", 4: "hold", 5: "press"}
"""Gestures of user actions: full reset, yaw reset, mounting reset, pause."""
_DOUBLE_TAP = 0x40
_NORMAL = 1
"""Type of rotation data that is an orientation; 2 is a correction."""
_HEAD = struct.Struct(">IQ")


@dataclass(frozen=True, slots=True)
class Handshake:
    """A tracker that looks for a server."""

    board: int = 0
    firmware: str = ""
    mac: str = ""
    """`AA:BB:CC:DD:EE:FF`, or `""` if it has none that distinguishes it from others."""

    @property
    def is_owotrack(self) -> bool:
        """Return True for owoTrack on a phone or watch, which vibrates."""
        return self.board == OWOTRACK_BOARD or not self.firmware


@dataclass(frozen=True, slots=True)
class Rotation:
    """Orientation of a sensor, world_from_sensor, x, y, z, w, with norm 1; the world's z is up."""

    sensor: int
    orientation_xyzw: Quaternion


@dataclass(frozen=True, slots=True)
class SlimevrButton:
    """A tap, or a press of a button."""

    gesture: Gesture


@dataclass(frozen=True, slots=True)
class SensorInfo:
    """State of a sensor."""

    sensor: int
    status: int
    """0: offline, 1: works, 2: error."""


@dataclass(frozen=True, slots=True)
class SensorFault:
    """A fault of a sensor."""

    sensor: int
    number: int


@dataclass(frozen=True, slots=True)
class FlagsRequest:
    """A tracker that states its features and asks for the server's."""


@dataclass(frozen=True, slots=True)
class Pong:
    """The answer to the ping `number`."""

    number: int


Packet = (
    Handshake | Rotation | Battery | SlimevrButton | SensorInfo | SensorFault | Signal | FlagsRequest | Pong
)


@dataclass(frozen=True, slots=True)
class SlimevrDatagram:
    """Content of a datagram."""

    number: int
    """Number that rises with each datagram of a tracker, or 0 if it has none."""
    packet: Packet | None
    """None if it is of another kind, or without sense."""
    is_readable: bool = True
    """False if it is too short or has implausible numbers."""
    kind: int = 0
    """Number of the kind of packet."""


def decode(data: bytes) -> SlimevrDatagram | None:
    """Return the content of `data`, or None if a SlimeVR tracker sends no such datagram."""
    if not _HEAD.size <= len(data) <= LONGEST_DATAGRAM:
        return None
    kind, number = _HEAD.unpack_from(data)
    if kind in (HANDSHAKE, PING):  # the former has none, the latter is an echo of ours
        number = 0
    try:
        return SlimevrDatagram(number, _decode_packet(kind, data[_HEAD.size :]), kind=kind)
    except (struct.error, IndexError, ContentError):
        return SlimevrDatagram(number, None, is_readable=False, kind=kind)


def ping(number: int) -> bytes:
    """Return a datagram that the tracker sends back."""
    return struct.pack(">IQI", PING, 0, number & 0xFFFFFFFF)


def sensor_answer(info: SensorInfo) -> bytes:
    """Return the confirmation of `info`, without which it is sent again each second."""
    return struct.pack(">IBB", 15, info.sensor, info.status)


def vibration(duration_s: float, amplitude: float = 1.0) -> bytes:
    """Return the command that lets owoTrack vibrate."""
    return struct.pack(">Ifff", 2, duration_s, 100.0, amplitude)


def _decode_packet(kind: int, payload: bytes) -> Packet | None:  # noqa: C901, PLR0912 - the protocol's table
    # Kinds 1 and 16 are of old firmware, which has one for each of two sensors
    match kind:
        case 1:
            return Rotation(0, unit_rotation(struct.unpack_from(">4f", payload), "xyzw"))
        case 3:
            return _decode_handshake(payload)
        case 10:
            return Pong(*struct.unpack_from(">I", payload))
        case 12:
            return _decode_battery(payload)
        case 13:
            return SlimevrButton("double" if payload[1] & _DOUBLE_TAP else "press")
        case 14:
            return SensorFault(payload[0], payload[1])
        case 15:
            return SensorInfo(payload[0], payload[1])
        case 16:
            return Rotation(1, unit_rotation(struct.unpack_from(">4f", payload), "xyzw"))
        case 17:
            sensor, meaning, *numbers = struct.unpack_from(">BB4f", payload)
            if meaning != _NORMAL:
                return None
            return Rotation(sensor, unit_rotation(numbers, "xyzw"))
        case 19:
            return Signal(float(struct.unpack_from(">xb", payload)[0]))
        case 21:
            return SlimevrButton(_ACTIONS[payload[0]]) if payload[0] in _ACTIONS else None
        case 22:
            return FlagsRequest()
        case 23:
            sensor, *parts = struct.unpack_from(">B4h", payload)
            components = [part / 32768 for part in parts]
            return Rotation(sensor, unit_rotation(components, "xyzw"))
        case 60:
            return SlimevrButton("press")
        case _:
            return None


def _decode_battery(payload: bytes) -> Battery:
    values = struct.unpack_from(">ff" if len(payload) >= 8 else ">f", payload)
    level = values[-1]
    volts = values[0] if len(values) == 2 else 0.0
    if not 0.0 <= level <= 1.5:
        raise ContentError(f"has the battery level {level:.3g}")
    return Battery(min(level, 1.0), volts if 0.0 < volts < 100.0 else None)


def _decode_handshake(payload: bytes) -> Handshake:
    """Return the handshake: as much of it as there is, since old apps send none of its parts."""
    if len(payload) < 28:
        return Handshake()
    (board,) = struct.unpack_from(">i", payload)
    firmware_length = payload[28] if len(payload) > 28 else 0
    end = 29 + firmware_length
    firmware = payload[29:end].split(b"\0")[0].decode("ascii", "replace")
    firmware = "".join(filter(is_printable, firmware))
    mac_bytes = payload[end : end + 6]
    mac = mac_bytes.hex(":").upper() if len(mac_bytes) == 6 else ""
    if mac in SHARED_MACS:
        mac = ""
    return Handshake(board, firmware[:40], mac)
