"""Stored pointing offsets: name of the file, validity, and messages."""

import math
from datetime import UTC, datetime

from pointit.schemas import NS_PER_S, PointingOffset

OFFSET_PURPOSE = "offset"
"""Name of the file of a person's pointing offset."""
MAX_RAD = math.radians(45.0)
"""Limit of the mean error of a person's pointing."""


def offset_problem(offset: PointingOffset) -> str:
    """Return an error message if the mean error of `offset` exceeds 45°, else `""`."""
    worst_rad = max(abs(offset.azimuth[0]), abs(offset.elevation[0]))
    if worst_rad <= MAX_RAD:
        return ""
    return (
        f"an offset of {math.degrees(worst_rad):.0f}° exceeds the limit of "
        f"{math.degrees(MAX_RAD):.0f}°; are its angles in radians?"
    )


def offset_in_use(user: str, offset: PointingOffset) -> str:
    """Return a message that a stored offset is in use, and how to erase it, in local time."""
    of = ""
    if offset.fitted_ns:
        of = f" of {minute(offset.fitted_ns)}"
    return f"{user}: an offset{of} is in use; `pointit person calibrate user {user} --erase` forgets it"


def minute(stamp_ns: int) -> str:
    """Return a time in this machine's local time: `2026-11-20 11:05`."""
    return f"{datetime.fromtimestamp(stamp_ns / NS_PER_S, UTC).astimezone():%Y-%m-%d %H:%M}"
