"""Outputs of a life cycle: states and cues to publish, requests to the localizer."""

from dataclasses import dataclass

from pointit.schemas import Feedback, Interaction


@dataclass(frozen=True, slots=True)
class Start:
    """Request to start a localization."""

    run: int
    """Number of the person's localization. Replies to earlier ones are ignored."""


@dataclass(frozen=True, slots=True)
class StartAnchor:
    """Request to point at one lamp as an anchor."""

    run: int
    """Number as in `Start`."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """Request to cancel, to be followed by `LifeCycle.on_cancel_reply`."""


Output = Interaction | Feedback | Start | StartAnchor | Cancel
