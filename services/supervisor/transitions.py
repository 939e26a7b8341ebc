"""The life cycle of an interaction (paper, §II-D) as one table, what a press starts or stops, its messages.

`python docs/pictures/life_cycle.py` draws it in docs/explanation/life_cycle.md, which explains each word. The
stages `localizing`, `anchoring` and `joined` are published as the state `localizing`: the person points at
targets, and no cursor is shown.

The cues alone are sufficient instructions: while a cue `waits`, wait; `started`: continue; `target`: point at
what it names; `stopped` and `refused`: rest. `localized`, and a `refused` or `stopped` attempt, are followed
by `started` if pointing continues.
"""

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Literal, NamedTuple

from pointit.runtime.host.advised_commands import advised_commands
from pointit.schemas import NS_PER_S, Localization, PointingOffset
from pointit.schemas.cues import Cue
from pointit.schemas.pointing import PressEffect
from pointit.schemas.selection import SelectionManner
from pointit.schemas.text import all_of, round_beyond

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

CANCELLED = "Localizing was cancelled."
STOPPED = "You stopped."
REFUSED = "You could not be localized. Point more steadily or stand somewhere else, and try again."
NO_POSE = "Your position in the room is not known."
RESUMED = "You continue where you were interrupted."
PLACE_KNOWN = "Your position in the room is known."
LOCALIZED = "You are localized."
ASKED = "You asked to start."
POSE_ASKED_FOR = "You were asked to point at a target, so that your position can be found."
POSE_CANCELLED = "Pointing at the target was cancelled."
POSE_LOST = "The localizer started something else. Ask again to have your position found."
AGAIN = "The localizer was restarted, so localizing starts again."
NO_POSE_TO_ANCHOR = "Your position in the room is not known, so there is nothing to correct."
ANCHOR_ASKED = "You asked to have your pose corrected."
ANCHOR_ASKED_FOR = "You were asked to point at a lamp, so that your pose can be corrected."
ANCHORED = "Your pose has been corrected."
ANCHOR_REFUSED = "Your pose could not be corrected. Hold your arm straight and still, and try again."
ANCHOR_CANCELLED = "Pointing at the lamp was cancelled. Your pose has not changed."
ANCHOR_LOST = (
    "The localizer started something else. Your pose has not changed: ask again to have it corrected."
)
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
WAIT = "Wait for a target to point at. Press the button to cancel."
POINT = "Point with your arm straight. Press the button to stop."
POINT_AND_CONFIRM = "Point with your arm straight and press the button to confirm. Hold it to stop."
STAY = "Point with your arm straight and stay on what you want. Hold the button to stop."
STAY_OR_PRESS = (
    "Point with your arm straight and stay on what you want. For {pressed}, press the button. "
    "Hold the button to stop."
)
PRESS_AT_NAME = (
    "Point with your arm straight. Press the button once you have heard the name that you want. "
    "Hold the button to stop."
)
POINT_AT_LAMP = "Your direction has become uncertain. Press the button twice and point at a lamp once."
PRESS = "Press the button to start pointing."
PRESS_FOR_LAMP = "Press the button and point at the lamp that lights up."
PRESS_FOR_ROBOT = "Press the button and keep pointing at the robot while it moves."
BY_ITSELF = "Put on the wristband, or take the arm in the page. Pointing starts by itself."
BY_ITSELF_AT_LAMP = "Put on the wristband, or take the arm in the page. Point at the lamp that lights up."
BY_ITSELF_AT_ROBOT = "Put on the wristband, or take the arm in the page. Point at the robot while it moves."
SET_POSE = "Give the localizer your pose, by its fixed pose or its request set_pose, or switch `localize` on."

OFFSET_PURPOSE = "offset"
"""Name of the file of a person's pointing offset."""
MAX_RAD = math.radians(45.0)
"""Limit of the mean error of a person's pointing."""
_ASK: tuple[Effect, ...] = ("allow autostart", "request pose")
_STOP: tuple[Effect, ...] = ("cancel", "forbid autostart")
_START: tuple[Effect, ...] = ("allow autostart",)


def silent(timeout_s: float) -> str:
    """Return the reason if the wrist was silent for `timeout_s`."""
    return f"Your wrist has sent nothing for {timeout_s:g} s. Is the wristband on and charged?"


def too_long(timeout_s: float) -> str:
    """Return the reason if localizing reached neither another target nor an end within `timeout_s`."""
    return (
        f"Localizing has made no progress for {timeout_s:g} s. Is the localizer running, and is the target "
        "in sight?"
    )


def aim(localization: Localization) -> str:
    """Return the next step while localizing: the current target."""
    if localization.purpose == "anchor":
        return f"Point at {localization.target_id} with your arm straight and stay on it. No cursor is shown."
    counts_targets = localization.target_count > 1 and not localization.candidates  # else it counts robots
    number = ""
    if counts_targets:
        number = f" ({localization.target_index + 1} of {localization.target_count})"
    return f"Point at {localization.target_id} and stay on it{number}."


def queue(ahead: Sequence[str]) -> str:
    """Return the next step in a queue after the persons `ahead`, the first of whom points now."""
    first, *others = ahead
    then = ""
    if others:
        verb = "come" if len(others) > 1 else "comes"
        then = f", then {verb} {', '.join(others)}"
    place = len(ahead)
    ordinal = ORDINALS[place] if place < len(ORDINALS) else f"number {place + 1}"
    return f"Wait: {first} is pointing at the lamps{then}. You are {ordinal}. Press the button to cancel."


def rest(*, localizes: bool, is_place_known: bool, follows_robot: bool, is_eager: bool) -> str:
    """Return the next step while idle. `is_eager`: pointing starts without a button."""
    if localizes and not is_place_known:
        if is_eager:
            return BY_ITSELF_AT_ROBOT if follows_robot else BY_ITSELF_AT_LAMP
        return PRESS_FOR_ROBOT if follows_robot else PRESS_FOR_LAMP
    if not is_place_known:
        return SET_POSE
    return BY_ITSELF if is_eager else PRESS


def point(*, is_end: bool, manner: SelectionManner | None, hears_names: bool) -> str:
    """Return the next step while pointing. `is_end`: a press ends it. `manner`: how people select here."""
    if is_end:
        return POINT
    if manner is None:
        return POINT_AND_CONFIRM  # without a selector, a service of another package takes presses
    if hears_names:
        return STAY if manner.names_by == "stay" else PRESS_AT_NAME
    if manner.by == "press":
        return POINT_AND_CONFIRM
    return STAY_OR_PRESS.format(pressed=_pressed(manner)) if manner.pressed else STAY


def _pressed(manner: SelectionManner) -> str:
    """Return the objects that want a press, in words."""
    more = manner.pressed_count - len(manner.pressed)
    others = (f"{more} more",) if more > 0 else ()
    return all_of((*manner.pressed, *others))


def press_effect(
    stage: "Stage", *, is_end: bool, manner: SelectionManner | None, hears_names: bool
) -> PressEffect:
    """Return the effect of a press now, or `""` if it has none."""
    if stage != "pointing":
        return "start" if stage == "idle" else "cancel"
    if is_end:
        return "stop"
    if manner is None:
        return "confirm"
    if hears_names:
        return "" if manner.names_by == "stay" else "confirm"
    if manner.by == "stay" and not manner.pressed:
        return ""
    return "confirm"


def offset_problem(offset: PointingOffset) -> str:
    """Return an error message if the mean error of `offset` exceeds 45°, else `""`."""
    worst_rad = max(abs(offset.azimuth[0]), abs(offset.elevation[0]))
    worst_deg = math.degrees(worst_rad)
    limit_deg = math.degrees(MAX_RAD)
    worst = round_beyond(worst_deg, limit_deg, 0)
    text = f"an offset of {worst}° exceeds the limit of {limit_deg:.0f}°; are its angles in radians?"
    return text if worst_deg > limit_deg else ""


def offset_in_use(user: str, offset: PointingOffset) -> str:
    """Return a message that a stored offset is in use, and how to erase it, in local time."""
    date = ""
    if offset.fitted_ns:
        date = f" of {minute(offset.fitted_ns)}"
    erase = advised_commands().command(f"pointit person calibrate user {user} --erase", user)
    return f"{user}: an offset{date} is in use; {erase} forgets it"


def minute(stamp_ns: int) -> str:
    """Return a time in this machine's local time: `2026-11-20 11:05`."""
    return f"{datetime.fromtimestamp(stamp_ns / NS_PER_S, UTC).astimezone():%Y-%m-%d %H:%M}"


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
_REQUESTS = (
    _T(("double",), "idle", NO_POSE_TO_ANCHOR, "refused", conditions=("no pose",)),
    _T(("double",), "anchoring", ANCHOR_ASKED, "started", ("request anchor",)),
    _T(("anchor requested",), "anchoring", ANCHOR_ASKED_FOR),
    _T(("pose requested",), "joined", POSE_ASKED_FOR),
)

TABLE: Mapping[Stage, tuple[Transition, ...]] = {
    "idle": (
        _T(("press",), "localizing", ASKED, "started", _ASK, ("must localize",)),
        _T(("hold",), "localizing", ASKED, "started", _ASK, ("localizes",)),
        _T(("press", "hold"), "idle", NO_POSE, "refused", _START, ("no pose",)),
        _T(("press", "hold"), "pointing", PLACE_KNOWN, "started", _START),
        _T(("sample",), "pointing", RESUMED, "started", conditions=("may resume",)),
        _T(("sample",), "localizing", ASKED, "started", _ASK[1:], ("may start", "must localize")),
        _T(("sample",), "pointing", PLACE_KNOWN, "started", conditions=("may start", "has pose")),
        _T(("recovered",), "localizing", RESUMED),
        *_REQUESTS,
    ),
    "pointing": (
        _T(("press",), "idle", STOPPED, "stopped", ("forbid autostart",), ("press ends",)),
        _T(("hold",), "idle", STOPPED, "stopped", ("forbid autostart",)),
        _T(("silent",), "idle", "", "stopped", ("resume soon",)),
        *_REQUESTS,
    ),
    "localizing": (
        _T(("press", "double", "hold"), "idle", CANCELLED, "stopped", _STOP),
        _T(("target",), "localizing"),
        _T(("found",), "pointing", LOCALIZED, "localized"),
        _T(("refused", "rejected"), "idle", REFUSED, "refused", ("retry later",)),
        _T(("cancelled",), "idle", CANCELLED, "stopped", ("retry later",)),
        _T(("restarted",), "localizing", AGAIN, "", ("request pose",)),
        _T(("silent",), "idle", "", "refused", ("cancel",)),
        _T(("timeout",), "idle", "", "refused", ("cancel", "retry later")),
    ),
    "anchoring": (
        _T(("hold",), "idle", ANCHOR_CANCELLED, "stopped", _STOP),
        _T(("press", "double"), "before", ANCHOR_CANCELLED, "stopped", ("cancel",)),
        _T(("target",), "anchoring"),
        _T(("found",), "before", ANCHORED, "localized"),
        _T(("refused", "rejected"), "before", ANCHOR_REFUSED, "refused"),
        _T(("cancelled",), "before", ANCHOR_CANCELLED, "stopped"),
        _T(("lost",), "before", ANCHOR_LOST, "refused"),
        _T(("silent",), "idle", "", "refused", ("cancel", "resume soon")),
        _T(("timeout",), "before", "", "refused", ("cancel",)),
    ),
    "joined": (
        _T(("hold",), "idle", POSE_CANCELLED, "stopped", _STOP),
        _T(("press", "double"), "before", POSE_CANCELLED, "stopped", ("cancel",)),
        _T(("target",), "joined"),
        _T(("found",), "before", LOCALIZED, "localized"),
        _T(("refused",), "before", REFUSED, "refused"),
        _T(("cancelled",), "before", POSE_CANCELLED, "stopped"),
        _T(("lost",), "before", POSE_LOST, "refused"),
        _T(("silent",), "idle", "", "refused", ("resume soon",)),
        _T(("timeout",), "before", "", "refused"),
    ),
}
