"""The life cycle of a pointing-based interaction (paper, §II-D), for one person, as one table.

`python docs/pictures/life_cycle.py` draws it in docs/explanation/life_cycle.md, which explains each word. The
stages `localizing`, `anchoring` and `joined` are published as the state `localizing`: the person points at
targets, and no cursor is shown.

The cues alone are sufficient instructions: while a cue `waits`, wait; `started`: continue; `target`: point at
what it names; `stopped` and `refused`: rest. `localized`, and a `refused` or `stopped` attempt, are followed
by `started` if pointing continues.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

from pointit.schemas.cues import Cue
from pointit.services.supervisor import user_messages as text

Stage = Literal["idle", "pointing", "localizing", "anchoring", "joined"]

Event = Literal[
    "press", "double", "hold", "sample",
    "target", "found", "refused", "cancelled", "restarted", "lost", "rejected",
    "recovered", "anchor requested", "pose requested",
    "silent", "timeout",
]  # fmt: skip

Condition = Literal[
    "must localize", "localizes", "no pose", "has pose", "press ends", "may start", "may resume",
]  # fmt: skip

Effect = Literal[
    "request pose", "request anchor", "cancel",
    "allow autostart", "forbid autostart", "retry later", "resume soon",
]  # fmt: skip


class Transition(NamedTuple):
    """A row of the table. The first one whose event and conditions fit is used, or nothing happens."""

    events: tuple[Event, ...]
    then: Stage | Literal["before"]
    """Next stage. `before`: `idle` or `pointing`, whichever preceded the attempt."""
    reason: str = ""
    """Reason that is shown to the person, unless the event gives one. `""`: as before."""
    cue: Cue | Literal[""] = ""
    """Cue of the outcome. `started` follows if pointing begins, and `stopped` if a success leads to idle."""
    effects: tuple[Effect, ...] = ()
    conditions: tuple[Condition, ...] = ()


_T = Transition
_ASK: tuple[Effect, ...] = ("allow autostart", "request pose")
_STOP: tuple[Effect, ...] = ("cancel", "forbid autostart")
_START: tuple[Effect, ...] = ("allow autostart",)
_REQUESTS = (
    _T(("double",), "idle", text.NO_POSE_TO_ANCHOR, "refused", conditions=("no pose",)),
    _T(("double",), "anchoring", text.ANCHOR_ASKED, "started", ("request anchor",)),
    _T(("anchor requested",), "anchoring", text.ANCHOR_ASKED_FOR),
    _T(("pose requested",), "joined", text.POSE_ASKED_FOR),
)

TABLE: Mapping[Stage, tuple[Transition, ...]] = {
    "idle": (
        _T(("press",), "localizing", text.ASKED, "started", _ASK, ("must localize",)),
        _T(("hold",), "localizing", text.ASKED, "started", _ASK, ("localizes",)),
        _T(("press", "hold"), "idle", text.NO_POSE, "refused", _START, ("no pose",)),
        _T(("press", "hold"), "pointing", text.PLACE_KNOWN, "started", _START),
        _T(("sample",), "pointing", text.RESUMED, "started", conditions=("may resume",)),
        _T(("sample",), "localizing", text.ASKED, "started", _ASK[1:], ("may start", "must localize")),
        _T(("sample",), "pointing", text.PLACE_KNOWN, "started", conditions=("may start", "has pose")),
        _T(("recovered",), "localizing", text.RESUMED),
        *_REQUESTS,
    ),
    "pointing": (
        _T(("press",), "idle", text.STOPPED, "stopped", ("forbid autostart",), ("press ends",)),
        _T(("hold",), "idle", text.STOPPED, "stopped", ("forbid autostart",)),
        _T(("silent",), "idle", "", "stopped", ("resume soon",)),
        *_REQUESTS,
    ),
    "localizing": (
        _T(("press", "double", "hold"), "idle", text.CANCELLED, "stopped", _STOP),
        _T(("target",), "localizing"),
        _T(("found",), "pointing", text.LOCALIZED, "localized"),
        _T(("refused", "rejected"), "idle", text.REFUSED, "refused", ("retry later",)),
        _T(("cancelled",), "idle", text.CANCELLED, "stopped", ("retry later",)),
        _T(("restarted",), "localizing", text.AGAIN, "", ("request pose",)),
        _T(("silent",), "idle", "", "refused", ("cancel",)),
        _T(("timeout",), "idle", "", "refused", ("cancel", "retry later")),
    ),
    "anchoring": (
        _T(("hold",), "idle", text.ANCHOR_CANCELLED, "stopped", _STOP),
        _T(("press", "double"), "before", text.ANCHOR_CANCELLED, "stopped", ("cancel",)),
        _T(("target",), "anchoring"),
        _T(("found",), "before", text.ANCHORED, "localized"),
        _T(("refused", "rejected"), "before", text.ANCHOR_REFUSED, "refused"),
        _T(("cancelled",), "before", text.ANCHOR_CANCELLED, "stopped"),
        _T(("lost",), "before", text.ANCHOR_LOST, "refused"),
        _T(("silent",), "idle", "", "refused", ("cancel", "resume soon")),
        _T(("timeout",), "before", "", "refused", ("cancel",)),
    ),
    "joined": (
        _T(("hold",), "idle", text.POSE_CANCELLED, "stopped", _STOP),
        _T(("press", "double"), "before", text.POSE_CANCELLED, "stopped", ("cancel",)),
        _T(("target",), "joined"),
        _T(("found",), "before", text.LOCALIZED, "localized"),
        _T(("refused",), "before", text.REFUSED, "refused"),
        _T(("cancelled",), "before", text.POSE_CANCELLED, "stopped"),
        _T(("lost",), "before", text.POSE_LOST, "refused"),
        _T(("silent",), "idle", "", "refused", ("resume soon",)),
        _T(("timeout",), "before", "", "refused"),
    ),
}
