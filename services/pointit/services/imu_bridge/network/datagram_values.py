"""Error of decoders of datagrams, and their check of the norm of orientations."""

import math
from collections.abc import Sequence

from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.streams.json_content import Order


class DatagramError(ValueError):
    """A datagram cannot be used; the message, a clause, is the reason."""


def orientation(numbers: Sequence[float], order: Order) -> Quaternion:
    """Return the rotation x, y, z, w, with norm 1, that four `numbers` in `order` are.

    Raises:
        DatagramError: If their norm is not 1, or one is not finite.
    """
    a, b, c, d = numbers
    try:
        return unit_quaternion((b, c, d, a) if order == "wxyz" else (a, b, c, d))
    except ValueError as error:
        raise DatagramError(f"has {error}") from error


def vector(numbers: Sequence[float], scale: float = 1.0) -> Vec3:
    """Return the first three `numbers`, multiplied by `scale`.

    Raises:
        DatagramError: If they are fewer, or one is not finite.
    """
    if len(numbers) < 3 or not all(math.isfinite(number) for number in numbers[:3]):
        raise DatagramError("has a vector that is not three finite numbers")
    x, y, z = numbers[:3]
    return (scale * x, scale * y, scale * z)
