"""Interface of the checks before and while a robot moves."""

from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol

from pointit.geometry.vector import Vec3
from pointit.schemas import Cursor, Environment, Interaction, RobotState, UserPose
from pointit.services.robot.robot_driver import RobotReport

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
"""Kind of a stop; `person`: on request, `report`: nothing is heard of it."""


class StopReason(NamedTuple):
    """Reason to stand still."""

    kind: StopKind
    text: str
    """Problem and remedy, in one sentence."""
    is_freeing: bool
    """True: nobody steers it any longer. False: its person keeps it, and goes on when this is over."""


class PermittedSetPoint(NamedTuple):
    """Place to which a robot that follows may go now."""

    position_m: Vec3
    max_speed_mps: float
    problem: str = ""
    """Reason if it is not where the person points, or `""`."""


class RobotSafety(Protocol):
    """Permission of what a robot is told. Times are the service's, ns; places are in {W}."""

    def on_map(self, environment: Environment) -> None:
        """Update the map."""
        ...

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update the pose of any person."""
        ...

    def on_presence(self, user: str, present: bool) -> None:  # noqa: FBT001 - as the bus says it
        """Update whether the services of any person run."""
        ...

    def on_interaction(self, user: str, interaction: Interaction) -> None:
        """Update the interaction of any person."""
        ...

    def on_cursor(self, user: str, cursor: Cursor) -> None:
        """Update the cursor of any person."""
        ...

    def on_robot(self, name: str, state: RobotState) -> None:
        """Update the state of another robot."""
        ...

    def on_report(self, report: RobotReport, now_ns: int) -> str:
        """Check a report of this robot. Return why it is not used, or `""`."""
        ...

    def on_link_lost(self, reason: str) -> None:
        """Note that this robot is not connected."""
        ...

    def take_problem(self, user: str, now_ns: int) -> str:
        """Return the reason not to let `user` steer this robot, or `""`."""
        ...

    def target_problem(self, user: str, points_m: Sequence[Vec3], now_ns: int, *, sigma_m: float) -> str:
        """Return the reason not to go along points, known to `sigma_m` (1 sigma), or `""`."""
        ...

    def way_problem(self, points_m: Sequence[Vec3]) -> str:
        """Return the reason not to send it along points, for any person, or `""`."""
        ...

    def set_point(self, user: str, target_m: Vec3, now_ns: int) -> PermittedSetPoint:
        """Return where it may go on its way to the place at which `user` points."""
        ...

    def stop(self, user: str, mode: str, now_ns: int) -> StopReason | None:
        """Return the reason to stand still now, or None. `user`: owner, or `""`; `mode`: of `Steering`."""
        ...

    def speed_limit_mps(self, points_m: Sequence[Vec3]) -> float:
        """Return the greatest speed along points."""
        ...
