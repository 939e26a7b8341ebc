"""Seam to the view of participant and experimenter: a terminal or pages."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from pointit.study.questionnaire import Scale
from pointit.study.study_step import StudyStep

Point = tuple[float, float]
"""x and y in {W}, m, to the centimetre."""

BREAK = "break, "
"""Start of the state of a break; the rest is the time that is left."""


def flat(point_m: Sequence[float] | None) -> Point | None:
    """Return a point, or a unit vector, seen from above."""
    return None if point_m is None else (round(point_m[0], 2), round(point_m[1], 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class TopView:
    """The room from above. None: not known, or not there."""

    lines: tuple[tuple[Point, ...], ...]
    """Strips, belts, and outlines of fences."""
    person: Point | None
    eyes: Point | None
    """Origin of the ray."""
    direction: Point | None
    cursor: Point | None
    target: Point | None


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyStatus:
    """Position in the study."""

    participant: str
    trial: int
    """Number of the trial, from 1."""
    block: int
    condition: str
    left: int
    """Number of trials to do, with this one."""
    target: str = ""
    say: str = ""
    """Said to the participant, or `""`."""
    state: str = ""
    """Present activity, in a few words."""
    trials: int = 0
    """Number of trials in the plan."""
    outcomes: tuple[str, ...] = ()
    """Last attempts, the newest first: trial and outcome."""
    quality: str = ""
    """Standard deviations of the localization, or `""` if unknown."""
    live: TopView | None = None


@dataclass(frozen=True, slots=True)
class StudyCommand:
    """A command of the experimenter."""

    name: Literal["repeat", "skip", "pause", "stop"]
    reason: str = ""


class StudyView(Protocol):
    """Shows the study. Used in the event loop of the session."""

    async def tell(self, *steps: StudyStep, go: str) -> bool:
        """Show `steps` until the participant does `go`; return False if they do not want to."""
        ...

    async def ask(self, scale: Scale, block: str = "") -> list[int]:
        """Return the answer to each item of a questionnaire on `block`; `""`: it has one block."""
        ...

    def status(self, status: StudyStatus, /) -> None:
        """Show where the study stands. Called at each change."""
        ...

    def command(self) -> StudyCommand | None:
        """Return the next command of the experimenter, if there is one."""
        ...
