"""Cells of a recorded motion: lost values, dates and times of day."""

import datetime as dt
import math
import re

_MISSING = frozenset(
    (
        *("nan", "-nan", "+nan", "nan(ind)", "-nan(ind)", "nat", "na", "n/a", "<na>", "null", "(null)"),
        *("<null>", "\\n", "none", "nil", "missing", "undefined", "lost", "invalid"),
        *("-", "--", "---", ".", "..", "?", "*"),
    )
)
"""Cells of lost values, in lower case, besides empty ones."""
_ERROR = re.compile(r"#[^\W\d][\w/]*[!?]|#n/?[av]|#{2,}|[+-]?\d\.#\w+|err:\d+")
"""Errors of spreadsheets in any language (`#DIV/0!`, `#WERT!`, `Err:502`) and of C libraries (`1.#QNAN`)."""
_NO_COORDINATE = re.compile(r"-?9{4,}|-?214748364[78]")
"""Coordinate of a lost marker in some programs."""
MAX_NUMBER = 1e20
"""Limit of numbers. Those beyond are marks of lost values, as `-3.697314E+028` of NDI's trackers is."""


def is_lost_cell(text: str) -> bool:
    """Return True if programs write `text` for a value that is not known."""
    word = text.strip().lower()
    return not word or word in _MISSING or bool(_ERROR.fullmatch(word)) or is_lost_coordinate(text)


def is_lost_coordinate(text: str) -> bool:
    """Return True if programs write the number `text` for a coordinate that is not known."""
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        return False
    is_beyond = MAX_NUMBER < abs(number) < math.inf
    return is_beyond or _NO_COORDINATE.fullmatch(text.partition(".")[0].partition(",")[0]) is not None


def clock_time_s(text: str) -> float:
    """Return a time of day or a date with time (ISO 8601; UTC if it states no zone), s; NaN if it is none."""
    try:
        if re.fullmatch(r"\d{1,2}:\d\d:\d\d([.,]\d+)?", text):
            hours, minutes, seconds = text.replace(",", ".").split(":")
            return int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds)
        time = dt.datetime.fromisoformat(text.replace(",", "."))
    except ValueError:
        return math.nan
    return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()
