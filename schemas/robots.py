"""Robots that people steer: their state and plan, what a person wants of one, and the topics of these."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import Extent, Fraction, KeyNameOrEmpty, Many, Message, Ns, Real, Vec3
from pointit.schemas.pointing import Candidate
from pointit.schemas.table_types import Delivery, Topic

RobotKind = Literal["quadrotor", "ground"]

RobotPhase = Literal["landed", "taking_off", "idle", "moving", "landing", "stopped", "lost"]
"""Activity of a robot.

idle: a ground robot stands, a quadrotor hovers, free to move. stopped: by a stop condition, see `reason`.
lost: nothing is heard of it.
"""


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

RobotReasonCode = Literal[
    "",
    StopKind,
    "lost",
    "moved_away",
    "goal_early",
    "goal_late",
    "refused",
    "unanswered",
    "unreachable",
    "limited",
    "not_free",
    "waiting",
    "no_figure",
]
"""Kind of a `RobotState.reason`.

A kind of stop, or: lost: nothing is heard of it. moved_away: somebody moved it. goal_early, goal_late: by its
stamp. refused: by the robot. unanswered: its driver is silent. unreachable, limited: the place or way.
not_free: for who asks for it. waiting: held up on its path. no_figure: no room for one that people follow.
"""


class RobotState(Message):
    """Pose and activity of a robot, and the person who steers it; `stamp_ns` is that of the pose."""

    version: ClassVar[int] = 2

    kind: RobotKind
    phase: RobotPhase
    position_m: Annotated[Vec3, Field(description="{W}; the last known one while it is lost")]
    yaw_rad: Real
    velocity_mps: Annotated[Vec3, Field(description="{W}")]
    position_sigma_m: Annotated[
        Extent | None, Field(description="1 sigma of the position along the worst direction, if known")
    ] = None
    radius_m: Annotated[Extent, Field(description="of the sphere, or upright cylinder, that it fills")]
    user: Annotated[KeyNameOrEmpty, Field(description="person who steers it, or empty")] = ""
    target_m: Annotated[Vec3 | None, Field(description="where it is sent, or None")] = None
    reason: Annotated[
        str, Field(description="why it does not move as asked, and the remedy; empty if it does")
    ] = ""
    reason_code: Annotated[
        RobotReasonCode, Field(description="kind of the reason, which stays while its figures change")
    ] = ""
    goal_ns: Annotated[Ns, Field(description="stamp of the goal that it carries out; 0: none")] = 0
    battery: Annotated[Fraction | None, Field(description="charge, if known")] = None

    def has_new_reason(self, previous: "RobotState | None") -> bool:
        """Return True if it has a reason of another kind than `previous`, or of no kind and another one."""
        if not self.reason:
            return False
        if previous is None or self.reason_code != previous.reason_code:
            return True
        return not self.reason_code and self.reason != previous.reason


class RobotPlan(Message):
    """The way that a robot is about to take."""

    line_m: Annotated[Many[Vec3], Field(description="rest of its way, {W}, or empty if it goes nowhere")] = ()
    user: Annotated[KeyNameOrEmpty, Field(description="person for whom, or empty")] = ""


class Steering(Message):
    """A person's wish for a robot. The robot itself decides whom it obeys: see `RobotState.user`."""

    robot: Annotated[KeyNameOrEmpty, Field(description="that the person wants to steer, or empty")] = ""
    mode: Annotated[
        Literal["none", "follow", "goals", "land"],
        Field(
            description="`follow`: to the person's cursor; `goals`: along their goals; `land`: at "
            "`target_m`, and then it is free; `none`: it stays"
        ),
    ] = "none"
    target_m: Annotated[Vec3 | None, Field(description="where to land, or None if it is where it hovers")] = (
        None
    )
    waypoints_m: Annotated[Many[Vec3], Field(description="set so far, and not yet sent as a goal")] = ()
    candidates: Annotated[
        Many[Candidate], Field(description="robots that the person may point at; the likeliest first")
    ] = ()


STEERING = Topic(
    key="users/{user}/steering", message=Steering, delivery=Delivery.STATE, rate_hz=None, writers=("goal",),
    about="the robot that the person wants to steer, and how",
)  # fmt: skip
ROBOT_STATE = Topic(
    key="robots/{robot}/state", message=RobotState, delivery=Delivery.LATEST, rate_hz=10, writers=("robot",),
    about="where a robot is, what it does and for whom",
)  # fmt: skip
ROBOT_PLAN = Topic(
    key="robots/{robot}/plan", message=RobotPlan, delivery=Delivery.STATE, rate_hz=None, writers=("robot",),
    about="the way that a robot is about to take",
)  # fmt: skip
