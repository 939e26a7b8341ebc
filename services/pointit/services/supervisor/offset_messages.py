"""A kept pointing offset: under which name it is kept, and how people are told of it."""

import math
from datetime import UTC, datetime

from pointit.schemas import NS_PER_S, PointingOffset

OFFSET_PURPOSE = "offset"
"""Under this name a person's pointing offset is kept, a file for each person."""


LARGEST_RAD = math.radians(45.0)
"""Nobody who points is off by more on average, wherever they point."""


def offset_problem(offset: PointingOffset) -> str:
    """Return what is wrong with an offset that nobody has; empty for one that somebody may have."""
    worst_rad = max(abs(offset.azimuth[0]), abs(offset.elevation[0]))
    if worst_rad <= LARGEST_RAD:
        return ""
    return (
        f"an offset of {math.degrees(worst_rad):.0f}° is nobody's and at most "
        f"{math.degrees(LARGEST_RAD):.0f}° is taken; are its angles in radians?"
    )


def offset_in_use(user: str, offset: PointingOffset) -> str:
    """Return that an offset of before is in use, and how it is forgotten; in this machine's local time."""
    of = ""
    if offset.fitted_ns:
        of = f" of {minute(offset.fitted_ns)}"
    return f"{user}: an offset{of} is in use; `pointit calibrate user {user} --erase` forgets it"


def minute(stamp_ns: int) -> str:
    """Return a time as people write it, in this machine's local time: `2026-11-20 11:05`."""
    return f"{datetime.fromtimestamp(stamp_ns / NS_PER_S, UTC).astimezone():%Y-%m-%d %H:%M}"
