"""Safety checks that permit everything but what a test forbids, and a pilot with them."""

from collections.abc import Sequence

from pointit.geometry.vector import Vec3
from pointit.runtime.virtual_time import START_NS
from pointit.schemas import NS_PER_S, Goal, Steering
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import Command, RobotReport
from pointit.services.robot.robot_pilot import RobotPilot
from pointit.services.robot.safety.safety import Safety
from pointit.services.robot.stop_reason import PermittedSetPoint, StopReason
from tests.unit.robot.flight import ROBOT, ROOM, cursor_at, goal_at


class Permits(Safety):
    """Permits everything but what a test forbids."""

    def __init__(self) -> None:
        super().__init__(RobotConfig(), ROBOT)
        self.stop_reason: StopReason | None = None
        self.place_problem = ""
        self.person_problem = ""

    def on_report(self, report: RobotReport, now_ns: int) -> str:  # noqa: ARG002
        return ""

    def take_problem(self, user: str, now_ns: int) -> str:  # noqa: ARG002
        return self.person_problem

    def way_problem(self, points_m: Sequence[Vec3]) -> str:  # noqa: ARG002
        return ""

    def target_problem(self, user: str, points_m: Sequence[Vec3], now_ns: int, *, sigma_m: float) -> str:  # noqa: ARG002
        return self.place_problem

    def set_point(self, user: str, target_m: Vec3, now_ns: int) -> PermittedSetPoint:  # noqa: ARG002
        return PermittedSetPoint(target_m, 1.0, self.place_problem)

    def stop(self, user: str, mode: str, now_ns: int) -> StopReason | None:  # noqa: ARG002
        return self.stop_reason

    def speed_limit_mps(self, points_m: Sequence[Vec3]) -> float:  # noqa: ARG002
        return 1.0


class Desk:
    """A pilot whose robot and people do what a test says."""

    def __init__(self, **parameters: object) -> None:
        self.safety = Permits()
        config = RobotConfig.model_validate({"kind": "quadrotor", **parameters})
        self.pilot = RobotPilot(config, ROBOT, self.safety)
        self.pilot.on_map(ROOM)
        self.now_ns = START_NS
        self.last_order = 0

    def step(self, duration_s: float = 0.05) -> Command | None:
        self.now_ns += round(duration_s * NS_PER_S)
        command = self.pilot.step(self.now_ns)
        if command is not None:
            self.last_order = command.order
        return command

    def report(self, position_m: Vec3 = (0.0, 0.0, 0.0), *, is_flying: bool = False) -> str:
        return self.pilot.on_item(RobotReport(self.now_ns, position_m, is_flying=is_flying), self.now_ns)

    def steer(
        self,
        user: str,
        mode: str = "follow",
        robot: str = ROBOT,
        target_m: Vec3 | None = None,
        age_s: float = 0.0,
    ) -> None:
        stamp_ns = self.now_ns - round(age_s * NS_PER_S)
        steering = {"stamp_ns": stamp_ns, "robot": robot, "mode": mode, "target_m": target_m}
        self.pilot.on_presence(user, present=True)
        self.pilot.on_steering(user, Steering.model_validate(steering))

    def point(self, user: str, place_m: Vec3) -> None:
        self.pilot.on_cursor(user, cursor_at(place_m, self.now_ns))

    def send(self, user: str, place_m: Vec3, *via_m: Vec3, robot: str = "", age_s: float = 0.0) -> Goal:
        stamp_ns = self.now_ns - round(age_s * NS_PER_S)
        goal = goal_at(place_m, *via_m, stamp_ns=stamp_ns, robot=robot)
        self.pilot.on_goal(user, goal, self.now_ns)
        return goal
