"""Terminal output that shows untrusted text safely."""

from collections.abc import Iterable
from typing import Any

import click
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from pointit.schemas.printable import plain
from pointit.schemas.text import one_line

LONGEST_LINE = 2000
"""Limit of a line with text from other processes, characters."""


class PlainConsole(Console):
    """Console that prints control characters as `?` and interprets no markup. Only code sets styles."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yield the segments of `renderable` without control characters."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment(plain(segment.text), segment.style)


def say(text: str, *, err: bool = False) -> None:
    """Print `text` on one line, without terminal control characters: other processes may have written it."""
    click.echo(one_line(text, LONGEST_LINE), err=err)
