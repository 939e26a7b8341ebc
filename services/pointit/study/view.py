"""Seam to the view of participant and experimenter: a terminal, later a page."""

from dataclasses import dataclass
from typing import Literal, Protocol

from pointit.study.questionnaires import Scale


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Position in the study."""

    participant: str
    trial: int
    """Number of the trial, from 1."""
    block: int
    condition: str
    left: int
    """Number of trials to do, with this one."""
    target: str = ""
    state: str = ""
    """Present activity, in a few words."""


@dataclass(frozen=True, slots=True)
class Command:
    """A command of the experimenter."""

    name: Literal["repeat", "skip", "pause", "stop"]
    reason: str = ""


class StudyView(Protocol):
    """Shows the study. Used in the event loop of the session."""

    async def tell(self, text: str, *, go: str) -> bool:
        """Show `text` until the participant does `go`; return False if they do not want to."""
        ...

    async def ask(self, scale: Scale) -> list[int]:
        """Return the answer to each item of a questionnaire."""
        ...

    def status(self, status: Status, /) -> None:
        """Show where the study stands. Called at each change."""
        ...

    def command(self) -> Command | None:
        """Return the next command of the experimenter, if there is one."""
        ...
