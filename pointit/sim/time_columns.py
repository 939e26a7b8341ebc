"""Columns of times in a text file: counters that start again, and other columns that could be times."""

from collections.abc import Sequence

import numpy as np

from pointit.geometry.array_types import Array
from pointit.maps.text_table import COMMENTS, TextLayout, parse_number, split_cells
from pointit.maps.units import TIMES_S
from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError

COUNTER_BITS = (8, 16, 24, 32, 48)
"""Sizes of counters that devices have."""
MIN_FILLED = 0.9
"""Smallest share of a counter's range at which it may start again."""
SAMPLE_ROWS = 100
"""Number of rows by which a column of times is recognized."""
MIN_PERIOD_S = 0.0004
"""Least median time between samples: 2500 Hz."""
MAX_PERIOD_S = 0.25
"""Largest median time between samples: 4 Hz."""
FRAME_UNIT = "0.01"
"""Period of numbers of frames if nothing states another, s."""
MAX_ALTERNATIVES = 3
"""Maximum number of other columns that a message names."""


def counter_bits(previous: float, number: float) -> int:
    """Return the bits of a counter that goes from `previous` to the smaller `number`, or 0 if it is none."""
    for bits in COUNTER_BITS:
        size = 2.0**bits
        is_within = MIN_FILLED * size <= previous < size
        if is_within and 0.0 <= number < size * (1.0 - MIN_FILLED):
            return bits
    return 0


def unwrapped(numbers: Array, bits: int) -> Array:
    """Return the `numbers` of a counter of `bits`, n, as if it had not started again.

    Raises:
        ConfigError: If one is negative or needs more bits.
    """
    size = 2.0**bits
    beyond = numbers[(numbers < 0.0) | (numbers >= size)]
    if len(beyond):
        raise ConfigError(
            f"t has {beyond[0]:.12g}, which no counter of {bits} bits has; set columns to another number of "
            "bits"
        )
    restarts = np.cumsum(np.diff(numbers, prepend=numbers[:1]) < 0.0)
    return np.asarray(numbers + size * restarts, dtype=np.float64)


class TimeColumns:
    """The columns of a file that could be times: numbers that rise by a plausible period in some unit."""

    def __init__(self, rows: Sequence[str], layout: TextLayout) -> None:
        """Search the first of `rows`, which are below the names of the columns."""
        self._rows = rows
        self._layout = layout

    def alternatives(self, title: str) -> str:
        """Return the end of a sentence with other columns than `title` that could be times, or `""`."""
        shown: list[str] = []
        numbers = self._numbers()
        names = self._layout.names
        count = numbers.shape[1] if len(numbers) > 1 else 0
        for index in range(count):
            name = names[index] if index < len(names) else f"{index + 1}"
            unit = _fitting_unit(numbers[:, index])

            # A number of a frame is a time, too, if the rate is known
            if unit and name != title:
                rate = ", numbers of frames at 100 Hz" if unit == FRAME_UNIT else ""
                shown.append(f"t={index + 1}/{unit} ({format_value(name)}{rate})")
        if not shown:
            return ""
        others = " or ".join(shown[:MAX_ALTERNATIVES])
        return f"; or use another column of times, such as {others}"

    def _numbers(self) -> Array:
        """Return the numbers in the first rows, n x columns, NaN where there are none."""
        layout = self._layout
        numbers: list[list[float]] = []
        for line in self._rows:
            if not line.strip() or line.startswith(COMMENTS):
                continue
            cells = split_cells(line, layout.delimiter, layout.width)
            if len(cells) == layout.width:
                numbers.append([parse_number(cell, layout.delimiter) for cell in cells])
            if len(numbers) >= SAMPLE_ROWS:
                break
        return np.array(numbers, dtype=np.float64)


def _fitting_unit(numbers: Array) -> str:
    """Return the unit, by name or in seconds, in which rising `numbers`, n, are times, or `""`."""
    steps = np.diff(numbers)
    if not (steps > 0.0).all():
        return ""
    period = float(np.median(steps))
    is_frame_number = bool((steps == 1.0).all())
    if is_frame_number:
        return FRAME_UNIT
    for unit, size_s in TIMES_S.items():
        if MIN_PERIOD_S <= period * size_s <= MAX_PERIOD_S:
            return unit
    return ""
