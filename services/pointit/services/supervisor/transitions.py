"""The life cycle of a pointing-based interaction (paper, §II-D), for one person, as one table.

`python docs/pictures/life_cycle.py` draws it in docs/explanation/life_cycle.md. The stages `localizing`,
`anchoring` and `joined` are published as the state `localizing`: the person points at targets, and no cursor
is shown.

The cues alone are sufficient instructions: while a cue `waits`, wait; `started`: continue; `target`: point at
what it names; `stopped` and `refused`: rest. `localized`, and a `refused` or `stopped` attempt, are followed
by `started` if pointing continues.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

from pointit.schemas.cues import Cue
from pointit.services.supervisor import user_messages as text

Stage = Literal["idle", "pointing", "localizing", "anchoring", "joined"]

STAGES: Mapping[Stage, str] = {
    "idle": "the person rests",
    "pointing": "the person has a cursor",
    "localizing": "the person asked to be localized, and points at the targets",
    "anchoring": "the person points at one lamp, which corrects the pose",
    "joined": "another client asked to localize the person, who points at its targets",
}

Event = Literal[
    "press", "double", "hold", "sample",
    "target", "found", "refused", "cancelled", "restarted", "lost", "rejected",
    "recovered", "anchor requested", "pose requested",
    "silent", "timeout",
]  # fmt: skip

EVENTS: Mapping[Event, str] = {
    "press": "a short press of the button",
    "double": "a double press",
    "hold": "the button is held",
    "sample": "a timely sample of the wrist",
    "target": "the localizer names a target or a queue",
    "found": "the localizer has found or corrected the pose",
    "refused": "the localizer found no pose",
    "cancelled": "the attempt was cancelled elsewhere",
    "restarted": "the localizer does not know the attempt",
    "lost": "the localizer does something else",
    "rejected": "the localizer rejected the request",
    "recovered": "a localization that an earlier supervisor requested continues",
    "anchor requested": "another client requested an anchor",
    "pose requested": "another client requested a localization",
    "silent": "nothing was heard from the wrist for `imu_timeout_s`",
    "timeout": "no further target within `localization_timeout_s`",
}

Condition = Literal[
    "must localize", "localizes", "no pose", "has pose", "press ends", "may start", "may resume",
]  # fmt: skip

CONDITIONS: Mapping[Condition, str] = {
    "must localize": "`localize`, and no pose is known or `relocalize_each_time`",
    "localizes": "`localize`",
    "no pose": "no pose is known",
    "has pose": "a pose is known",
    "press ends": "`press_while_pointing` is `ends`",
    "may start": "`autostart`, not forbidden, and no delay runs",
    "may resume": "pointing was interrupted within `resume_s`, and the pose is still known",
}

Effect = Literal[
    "request pose", "request anchor", "cancel",
    "allow autostart", "forbid autostart", "retry later", "resume soon",
]  # fmt: skip

EFFECTS: Mapping[Effect, str] = {
    "request pose": "request a localization",
    "request anchor": "request an anchor",
    "cancel": "cancel what the localizer does",
    "allow autostart": "samples may start pointing, with `autostart`",
    "forbid autostart": "only the button starts pointing",
    "retry later": "samples start nothing for `retry_s`",
    "resume soon": "samples may resume pointing for `resume_s`, if it was interrupted",
}


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
