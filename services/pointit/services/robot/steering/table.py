"""Actions of a robot for its person, and its reasons to stand still, as two tables."""

from collections.abc import Mapping
from typing import Literal

from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, TakeOff
from pointit.services.robot.stop_reason import StopReason

Stage = Literal["landed", "taking_off", "landing", "following", "on_path", "resting"]
"""Activity. `landed`: a quadrotor on the ground; `resting`: it has no order, or one to stop."""

Mode = Literal["none", "follow", "goals", "land"]
"""Wish of its person, as in `Steering`."""

Action = Literal["wait", "take off", "follow", "go", "land", "stay", "stop", "let go"]
"""`go`: drive to the pending goal, if any. `stay`: stop. `let go`: release the robot."""

ACTIONS: Mapping[Stage, Mapping[Mode, Action]] = {
    "landed": {"none": "wait", "follow": "take off", "goals": "take off", "land": "let go"},
    "taking_off": {"none": "wait", "follow": "wait", "goals": "wait", "land": "wait"},
    "landing": {"none": "stop", "follow": "stop", "goals": "stop", "land": "land"},
    "following": {"none": "stay", "follow": "follow", "goals": "stay", "land": "land"},
    "on_path": {"none": "stay", "follow": "follow", "goals": "go", "land": "land"},
    "resting": {"none": "wait", "follow": "follow", "goals": "go", "land": "land"},
}

Hold = Literal["none", "kept", "passing", "freed"]
"""Reason to stand. Its user keeps it, or it has no user until the reason ends or a user chooses it."""

Verdict = Literal["safe", "hold", "free", "other_master"]
"""Result of the safety checks."""

Change = Literal["-", "resume", "end", "note", "halt", "release"]
"""`end` ends the order. `note` ends it and stores the new reason. `halt` does both and stops the robot.
`release` stops the robot and takes it from its user: all who want it must name it again."""

HOLDS: Mapping[Hold, Mapping[Verdict, Change]] = {
    "none": {"safe": "-", "hold": "halt", "free": "release", "other_master": "release"},
    "kept": {"safe": "resume", "hold": "note", "free": "release", "other_master": "release"},
    "passing": {"safe": "resume", "hold": "note", "free": "note", "other_master": "note"},
    "freed": {"safe": "-", "hold": "end", "free": "end", "other_master": "note"},
}

PASSING = ("report", "other_master")  # kinds of stops that free the robot and pass by themselves


def stage_of(command: Command | None, *, is_down: bool) -> Stage:
    """Return the stage of a robot with this order; `is_down`: it is a quadrotor on the ground."""
    match command:
        case TakeOff():
            return "taking_off"
        case Land():
            return "landing"
        case _ if is_down:
            return "landed"
        case Follow():
            return "following"
        case FollowPath():
            return "on_path"
        case _:
            return "resting"


def hold_of(stop: StopReason | None, user: str) -> Hold:
    """Return the effect of `stop` on a robot that `user` has, or nobody, `""`."""
    if stop is None:
        return "none"
    if not stop.is_freeing:
        return "kept" if user else "passing"
    return "passing" if stop.kind in PASSING else "freed"


def verdict_of(stop: StopReason | None) -> Verdict:
    """Return the result of safety checks with the reason `stop`."""
    if stop is None:
        return "safe"
    if stop.kind == "other_master":
        return "other_master"
    return "free" if stop.is_freeing else "hold"
