"""What is left out of a view that is higher than the terminal."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rich.segment import Segment

Worth: TypeAlias = tuple[int, int] | None
"""What is worth least is left out first; what has none stays."""


@dataclass(frozen=True)
class Block:
    """Lines that are shown or left out together."""

    lines: Sequence[Sequence[Segment]]
    worth: Worth


def fitted(blocks: Sequence[Block], room: int) -> list[list[Segment]]:
    """Return the lines of `blocks` in their order, at most `room`: those worth least are left out."""
    height = sum(len(block.lines) for block in blocks)
    kept = dict(enumerate(blocks))
    dispensable = sorted((block.worth, at) for at, block in kept.items() if block.worth is not None)
    for _, at in dispensable:
        if height <= room:
            break
        height -= len(kept.pop(at).lines)
    return [list(line) for block in kept.values() for line in block.lines]
