"""A person who points at robots and places, and robots that answer as told."""

from typing import Any, Literal

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Feedback,
    Goal,
    Interaction,
    PointingRay,
    RobotState,
    Steering,
    UserPose,
)
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.robot_steering import Output, RobotSteering
from tests.unit.goal.floor import EYES, POINTING, ROOM, START_NS, STEP_S, cursor

QUAD: Vec3 = (2.0, 0.0, 0.0)
ROVER: Vec3 = (0.0, 2.0, 0.1)
STEP_NS = round(STEP_S * NS_PER_S)


class Ben:
    """He stands in the origin and steers; his robots report every 0.1 s."""

    def __init__(self, **settings: Any) -> None:
        self.steps = RobotSteering(GoalConfig.model_validate({"steer": "robots"} | settings), "ben")
        self.now_ns = START_NS
        self.outputs: list[Output] = []
        self.robots: dict[str, dict[str, Any]] = {
            "quad": {"kind": "quadrotor", "phase": "landed", "position_m": QUAD},
            "rover": {"kind": "ground", "phase": "idle", "position_m": ROVER},
        }
        self.obeys = True
        """Robots accept who asks, unless somebody has them."""
        self.steps.on_map(ROOM)
        self.steps.on_pose("ben", UserPose(stamp_ns=START_NS, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
        self.outputs += self.steps.on_interaction(POINTING, self.now_ns)

    def set(self, robot: str, **fields: Any) -> "Ben":
        self.robots[robot] |= fields
        return self.report(robot)

    def report(self, robot: str) -> "Ben":
        usual = {"stamp_ns": self.now_ns, "yaw_rad": 0.0, "velocity_mps": (0.0, 0.0, 0.0), "radius_m": 0.2}
        state = RobotState.model_validate(usual | self.robots[robot])
        self.outputs += self.steps.on_robot(robot, state, self.now_ns)
        return self

    def point(self, at_m: Vec3, lasting_s: float = 1.5) -> "Ben":
        """Point at a place, or a robot, on the floor."""
        for step in range(round(lasting_s / STEP_S)):
            self.now_ns += STEP_NS
            direction = vector.normalized(vector.subtract(at_m, EYES))
            self.steps.on_ray(PointingRay(stamp_ns=self.now_ns, origin_m=EYES, direction=direction))
            self.outputs += self.steps.on_cursor(cursor(self.now_ns, at_m), self.now_ns)
            if step % 5 == 0:
                for robot, fields in self.robots.items():
                    if self.obeys and self.steps.robot == robot and not fields.get("user"):
                        fields["user"] = "ben"
                    self.report(robot)
        return self

    def press(self, ago_s: float = 0.0) -> "Ben":
        stamp_ns = self.now_ns - round(ago_s * NS_PER_S)
        event = ButtonEvent(stamp_ns=stamp_ns, gesture="press")
        self.outputs += self.steps.on_button(event, self.now_ns)
        return self

    def wait(self, lasting_s: float) -> "Ben":
        """Let time pass without any message."""
        self.now_ns += round(lasting_s * NS_PER_S)
        self.outputs += self.steps.tick(self.now_ns)
        return self

    def start(self) -> "Ben":
        began = POINTING.model_copy(update={"stamp_ns": self.now_ns})
        self.outputs += self.steps.on_interaction(began, self.now_ns)
        return self

    def rest(self, state: Literal["idle", "localizing"] = "idle") -> "Ben":
        self.outputs += self.steps.on_interaction(Interaction(stamp_ns=self.now_ns, state=state), self.now_ns)
        return self

    def take(self, robot: str) -> "Ben":
        return (
            self.point(self.robots[robot]["position_m"]).press().point(self.robots[robot]["position_m"], 0.3)
        )

    @property
    def steering(self) -> Steering:
        return [each for each in self.outputs if isinstance(each, Steering)][-1]

    @property
    def goals(self) -> list[Goal]:
        return [each for each in self.outputs if isinstance(each, Goal)]

    @property
    def cues(self) -> list[Feedback]:
        return [each for each in self.outputs if isinstance(each, Feedback)]

    @property
    def text(self) -> str:
        return self.cues[-1].text
