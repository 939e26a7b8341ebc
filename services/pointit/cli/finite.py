"""Numbers on the command line: click takes `nan` for within any range."""

import math
from typing import Any

import click


class Finite(click.FloatRange):
    """A range of numbers without the one that is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return `value` as a number in the range."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is no finite number", param, ctx)
        return number
