"""Results of the checks before and while a robot moves."""

from typing import Literal, NamedTuple

from pointit.geometry.vector import Vec3

StopKind = Literal[
    "person",
    "stuck",
    "not_pointing",
    "gone",
    "cursor",
    "unsure",
    "pose",
    "report",
    "other_master",
    "jump",
    "fence",
    "people",
    "robots",
]
"""Kind of a stop. `person`: on request. `report`: the robot sends no reports."""


class StopReason(NamedTuple):
    """Reason to stand still."""

    kind: StopKind
    text: str
    """Problem and remedy, in one sentence."""
    is_freeing: bool
    """True: its user loses the robot. False: its user keeps it, and steering continues after the stop."""


class PermittedSetPoint(NamedTuple):
    """Place to which a robot that follows may go now."""

    position_m: Vec3
    max_speed_mps: float
    problem: str = ""
    """Reason if it is not where the person points, or `""`."""
