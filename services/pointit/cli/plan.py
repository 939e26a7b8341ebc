"""Everything a run needs to know, decided before it begins."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pointit.runtime import Launch
from pointit.runtime.zenoh_session import Link


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything a run needs to know."""

    name: str
    launches: Sequence[Launch]
    link: Link
    target_kinds: Sequence[str] = ()
    seed: int = 0
    duration_s: float | None = None
    speed: float = 1.0
    processes: bool = False
    may_move: bool = False
    """The address to listen on is only the default: take the next port when it is taken."""
    scored: bool = True
    """A whole scenario: sum it up at the end, and without any cursor it has failed."""
    view: bool = True
    person: str = ""
    """Only this person's part is told and drawn; empty for everybody's."""
    notes: Sequence[str] = ()
    """Sentences that are said at the start."""
    summary: Path | None = None
    as_json: bool = False
