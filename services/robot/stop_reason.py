"""Results of the checks before and while a robot moves."""

from typing import NamedTuple

from pointit.geometry.vector import Vec3
from pointit.schemas.robots import RobotReasonCode, StopKind


class Hindrance(NamedTuple):
    """Reason not to do what is asked, without a stop."""

    code: RobotReasonCode = ""
    """Kind of the reason, or `""` if there is none."""
    text: str = ""
    """Problem and remedy, in one sentence, or `""`."""


def hindrance_of(code: RobotReasonCode, text: str) -> Hindrance:
    """Return the hindrance `text`, which is none if it is empty."""
    return Hindrance(code, text) if text else Hindrance()


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
