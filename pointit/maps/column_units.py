"""Units in the names of a table's columns: `X [mm]`, `t (ms)`, `pos_x_mm`, `"Z/ft"`."""

import re
import unicodedata

LENGTHS_M = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters", "metro", "metros", "metri"), 1.0),
    **dict.fromkeys(("dm", "decimetre", "decimetres", "decimeter", "decimeters"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters", "zentimeter"), 0.01),
    **dict.fromkeys(("mm", "millimetre", "millimetres", "millimeter", "millimeters"), 0.001),
    **dict.fromkeys(
        ("um", "micron", "microns", "micrometre", "micrometres", "micrometer", "micrometers"), 1e-6
    ),
    **dict.fromkeys(("km", "kilometre", "kilometres", "kilometer", "kilometers"), 1000.0),
    **dict.fromkeys(("in", "inch", "inches", '"'), 0.0254),
    **dict.fromkeys(("ft", "foot", "feet", "'"), 0.3048),
    **dict.fromkeys(("usft", "us_ft", "ftus", "ft_us", "us_survey_foot", "us_survey_feet"), 1200 / 3937),
    **dict.fromkeys(("yd", "yard", "yards"), 0.9144),
}
"""Lengths of the units of length, m."""

TIMES_S = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "usecs", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("hour", "hours"), 3600.0),
    **dict.fromkeys(("day", "days"), 86400.0),
}
"""Durations of the units of time, s."""

_BRACKETED = re.compile(r"(.*?)\s*(?:\[([^]]*)\]|\(([^)]*)\)|\{([^}]*)\}|<([^>]*)>)\s*")
_AFTER_SIGN = re.compile(r"(.*\w)\s*[/,|:]\s*([^\W\d]+)\s*")
_LAST_WORD = re.compile(r"(.*?\w)(?:_|\s+|-)(?:in[\s_]+)?([^\W\d_]+)\s*")
_MICRO = str.maketrans({"µ": "u", "μ": "u"})


def split_unit(column: str) -> tuple[str, str]:
    """Return the name of a column and the unit in it, both normalized, `""` if it states none.

    A name has lower-case words with `_` between them and no quotes: `Point X [mm]` is `("point_x", "mm")`.
    A unit in brackets is returned as it is, also an unknown one: the caller reports it. Without brackets the
    last word is a unit only if it is a known one: `pos_x_mm` is `("pos_x", "mm")`, `pos_x` has no unit.
    """
    text = column.strip().strip("\ufeff").strip().strip("\"'").strip()
    if (match := _BRACKETED.fullmatch(text)) and match[1]:
        return _words(match[1]), unit_name(next(part for part in match.groups()[1:] if part is not None))
    for pattern in (_AFTER_SIGN, _LAST_WORD):
        if (match := pattern.fullmatch(text)) and unit_name(match[2]) in LENGTHS_M | TIMES_S:
            return _words(match[1]), unit_name(match[2])
    return _words(text), ""


def unit_name(text: str) -> str:
    """Return `text` in the spelling of the keys of `LENGTHS_M` and `TIMES_S`."""
    letters = unicodedata.normalize("NFKD", text.strip().lower())
    plain = "".join(each for each in letters if not unicodedata.combining(each)).translate(_MICRO).rstrip(".")
    return plain if plain in LENGTHS_M else _words(plain)


def _words(text: str) -> str:
    return "_".join(re.findall(r"[^\W_]+", text.lower()))
