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
    values = [round(component * WITMOTION_FULL_SCALE) for component in (w, x, y, z)]
    return witmotion_packet(0x59, *values)


def bno085_packet(
    index: int, yaw: int, pitch: int, roll: int, acceleration_mg: tuple[int, int, int] = (0, 0, 0)
) -> bytes:
    """Return a packet of a BNO085 in UART-RVC mode, angles in 0.01°.

    Raises:
        OverflowError: If a value does not fit.
    """
    values = (yaw, pitch, roll, *acceleration_mg)
    body = bytes((index & 0xFF,)) + _int16s(values) + bytes(3)
    checksum = bytes((_checksum(body),))
    return b"\xaa\xaa" + body + checksum


def _int16s(values: Sequence[int]) -> bytes:
    data = bytearray()
    for value in values:
        data += value.to_bytes(2, "little", signed=True)
    return bytes(data)


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
    yaw, pitch, roll = map(_hundredths, _euler_angles_rad(orientation))
    # At rest an accelerometer measures what holds it up: 1 g upwards.
    upwards = rotation.rotate(rotation.inverse(orientation), (0.0, 0.0, 1.0))
    up_x_mg, up_y_mg, up_z_mg = (round(1000 * component) for component in upwards)
    return bno085_packet(index, yaw, pitch, roll, (up_x_mg, up_y_mg, up_z_mg))


def _euler_angles_rad(orientation: Quaternion) -> tuple[float, float, float]:
    """Return yaw, pitch and roll: the turns about z, y and x, in this order."""
    x, y, z, w = orientation
    yaw_sine = 2 * (w * z + x * y)
    yaw_cosine = 1 - 2 * (y * y + z * z)
    pitch_sine = 2 * (w * y - z * x)
    roll_sine = 2 * (w * x + y * z)
    roll_cosine = 1 - 2 * (x * x + y * y)
    yaw_rad = math.atan2(yaw_sine, yaw_cosine)
    pitch_rad = math.asin(max(-1.0, min(1.0, pitch_sine)))  # rounding may leave the range of a sine
    roll_rad = math.atan2(roll_sine, roll_cosine)
    return yaw_rad, pitch_rad, roll_rad


def _hundredths(angle_rad: float) -> int:
    """Return an angle in 0.01°."""
    return round(100 * math.degrees(angle_rad))


def ximu3_text(letter: str, time_us: int, *values: float) -> bytes:
    """Return a message of an x-IMU3 as text."""
    numbers = ",".join(f"{value:.4f}" for value in values)
    text = f"{letter},{time_us},{numbers}\r\n"
    return text.encode()


def ximu3_binary(letter: str, time_us: int, *values: float) -> bytes:
    """Return a binary message of an x-IMU3."""
    kind = 0x80 + ord(letter)
    body = struct.pack(f"<BQ{len(values)}f", kind, time_us, *values)
    # SLIP with a line end as the end: the escape byte is replaced first, else it would be escaped twice.
    escaped = body.replace(b"\xdb", b"\xdb\xdd")
    escaped = escaped.replace(b"\n", b"\xdb\xdc")
    return escaped + b"\n"


def ximu3_quaternion(orientation: Quaternion, time_us: int = 0) -> bytes:
    """Return the binary message of the orientation x, y, z, w."""
    x, y, z, w = orientation
    try:
        return ximu3_binary("Q", time_us, w, x, y, z)
    except struct.error as error:
        raise ValueError(str(error)) from error
