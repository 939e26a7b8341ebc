"""Packets of serial wrists, as the devices send them."""

import math
import struct
from collections.abc import Sequence

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion

WITMOTION_FULL_SCALE = 32767
"""Largest value; the devices divide by 32768, so a component of exactly 1 is slightly less."""


def witmotion_packet(kind: int, *values: int) -> bytes:
    """Return WitMotion's packet of a type, such as 0x59, with four 16-bit values.

    Raises:
        OverflowError: If a value does not fit.
    """
    body = bytes((0x55, kind)) + _int16s(values)
    return body + bytes((_checksum(body),))


def witmotion_quaternion(orientation: Quaternion) -> bytes:
    """Return WitMotion's packet of the orientation x, y, z, w.

    Raises:
        ValueError: If it cannot be expressed.
    """
    x, y, z, w = orientation
    return witmotion_packet(0x59, *(round(value * WITMOTION_FULL_SCALE) for value in (w, x, y, z)))


def bno085_packet(
    index: int, yaw: int, pitch: int, roll: int, acceleration_mg: tuple[int, int, int] = (0, 0, 0)
) -> bytes:
    """Return a packet of a BNO085 in UART-RVC mode, angles in 0.01°.

    Raises:
        OverflowError: If a value does not fit.
    """
    values = (yaw, pitch, roll, *acceleration_mg)
    body = bytes((index & 0xFF,))
    body += _int16s(values)
    body += bytes(3)
    return b"\xaa\xaa" + body + bytes((_checksum(body),))


def _int16s(values: Sequence[int]) -> bytes:
    return b"".join(value.to_bytes(2, "little", signed=True) for value in values)


def _checksum(body: bytes) -> int:
    return sum(body) & 0xFF


def bno085_orientation(orientation: Quaternion, index: int = 0) -> bytes:
    """Return the packet of the orientation x, y, z, w, at rest: pitch about y, roll about x.

    Raises:
        ValueError: If it cannot be expressed.
    """
    norm = math.hypot(*orientation)
    if not abs(norm - 1.0) < 0.01:
        raise ValueError(f"the format has angles, and no quaternion of norm {norm}")
    x, y, z, w = orientation
    yaw_rad = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    sine = 2 * (w * y - z * x)
    pitch_rad = math.asin(max(-1.0, min(1.0, sine)))  # rounding may leave the range of a sine
    roll_rad = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw, pitch, roll = (round(100 * math.degrees(angle)) for angle in (yaw_rad, pitch_rad, roll_rad))

    # At rest an accelerometer measures what holds it up: 1 g upwards.
    ux, uy, uz = rotation.rotate(rotation.inverse(orientation), (0.0, 0.0, 1.0))
    up_mg = (round(1000 * ux), round(1000 * uy), round(1000 * uz))
    return bno085_packet(index, yaw, pitch, roll, up_mg)


def ximu3_text(letter: str, time_us: int, *values: float) -> bytes:
    """Return a message of an x-IMU3 as text."""
    texts = ",".join(f"{value:.4f}" for value in values)
    return f"{letter},{time_us},{texts}\r\n".encode()


def ximu3_binary(letter: str, time_us: int, *values: float) -> bytes:
    """Return a binary message of an x-IMU3."""
    body = struct.pack(f"<BQ{len(values)}f", 0x80 + ord(letter), time_us, *values)
    # SLIP with a line end as the end: the escape byte is replaced first, else it would be escaped twice.
    escaped = body.replace(b"\xdb", b"\xdb\xdd").replace(b"\n", b"\xdb\xdc")
    return escaped + b"\n"


def ximu3_quaternion(orientation: Quaternion, time_us: int = 0) -> bytes:
    """Return the binary message of the orientation x, y, z, w."""
    x, y, z, w = orientation
    try:
        return ximu3_binary("Q", time_us, w, x, y, z)
    except struct.error as error:
        raise ValueError(str(error)) from error
