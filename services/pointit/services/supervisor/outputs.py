"""What a life cycle gives out: states and cues to publish, requests for the localizer."""

from dataclasses import dataclass

from pointit.schemas import Feedback, Interaction


@dataclass(frozen=True, slots=True)
class Start:
    """Ask the localizer to begin."""

    run: int
    """Which of the person's localizations it is; answers to earlier ones do not count any more."""


@dataclass(frozen=True, slots=True)
class StartAnchor:
    """Ask the localizer to have the person point at one lamp."""

    run: int
    """As in `Start`."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """Ask the localizer to stop, and tell `LifeCycle.on_cancel_reply` when it has answered."""


Output = Interaction | Feedback | Start | StartAnchor | Cancel
