"""A robot that is steered through its safety checks, in virtual time and without a bus."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, Interaction, UserPose
from pointit.schemas.environment import Fence
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.drivers.sim_driver import SimConfig, SimulatedRobot, make_simulated_robot
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
    report_fault,
)
from pointit.services.robot.safety.safety import Safety
from pointit.services.robot.stop_reason import StopReason

START_NS = 1_000_000 * NS_PER_S
STEP_NS = NS_PER_S // 100
TICK = 5
"""Steps between two checks: 20 Hz."""
EYES_M = 1.6


def fence(
    kind: str, *outline_m: tuple[float, float], low_m: float | None = None, high_m: float | None = None
) -> Fence:
    return Fence.model_validate(
        {
            "id": f"{kind}-{len(outline_m)}",
            "kind": kind,
            "outline_m": outline_m,
            "low_m": low_m,
            "high_m": high_m,
        }
    )


def spec(config: RobotConfig, name: str = "quad") -> RobotSpec:
    return RobotSpec(
        name=name, kind=config.kind, start_m=config.start_m, radius_m=config.radius_m,
        start_yaw_rad=math.radians(config.start_yaw_deg),
        hover_m=config.hover_m, max_speed_mps=config.max_speed_mps,
        max_acceleration_mps2=config.max_acceleration_mps2,
    )  # fmt: skip


@dataclass
class Steered:
    """One robot with its safety, steered by ada."""

    config: RobotConfig
    fences: Sequence[Fence] = ()
    people_m: dict[str, Vec3] = field(default_factory=lambda: {"ada": (0.0, -5.0, 0.0)})
    person_sigma_m: float = 0.0
    target_m: Vec3 | None = None
    is_cursor_alive: bool = True
    are_reports_alive: bool = True
    change_report: Callable[[RobotReport], RobotReport] = lambda report: report
    on_step: Callable[[], None] = lambda: None
    tick: int = TICK

    def __post_init__(self) -> None:
        """Put the robot at its start, in the air if it flies, and everybody at their places."""
        self.now_ns = START_NS
        self.robot: SimulatedRobot = make_simulated_robot(SimConfig(), spec(self.config))
        self.safety = Safety(self.config, "quad")
        self.stop: StopReason | None = None
        self.problem = ""
        self._order = 0
        self._step = 0
        self.safety.on_map(Environment(stamp_ns=START_NS, name="room", fences=tuple(self.fences)))
        for user, place_m in self.people_m.items():
            self.place(user, place_m)
        self.interact("pointing")
        if self.config.kind == "quadrotor":
            self.command(TakeOff(0, self.config.hover_m))
            while not self.robot.is_done:
                self.robot.step()

    def place(self, user: str, place_m: Vec3) -> None:
        square = self.person_sigma_m**2
        covariance = (square, 0.0, 0.0, 0.0, square, 0.0, 0.0, 0.0, 0.0)
        pose = UserPose(stamp_ns=self.now_ns, position_m=place_m, yaw_rad=0.0, covariance=covariance)
        self.safety.people.on_pose(user, pose)

    def interact(self, state: str, *, is_unsure: bool = False) -> None:
        interaction = {"stamp_ns": self.now_ns, "state": state, "is_unsure": is_unsure}
        self.safety.people.on_interaction("ada", Interaction.model_validate(interaction))

    def command(self, command: Command) -> None:
        self._order += 1
        assert not self.robot.command(command)

    @property
    def report(self) -> RobotReport:
        return self.robot.report(self.now_ns)

    @property
    def speed_mps(self) -> float:
        return math.hypot(*self.report.velocity_mps)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.step()

    def step(self) -> None:
        """Advance by 10 ms; cursors and reports come at 50 Hz, checks at 20 Hz."""
        self.robot.step()
        self.now_ns += STEP_NS
        self._step += 1
        if self._step % 2 == 0:
            if self.are_reports_alive:
                self._take(self.change_report(self.report))
            if self.is_cursor_alive:
                self.safety.people.on_cursor("ada", self._cursor())
        if self._step % self.tick == 0:
            self._tick()
        self.on_step()

    def _take(self, report: RobotReport) -> None:
        if fault := report_fault(report):
            self.safety.on_link_lost(fault)
        else:
            self.safety.on_report(report, self.now_ns)

    def _cursor(self) -> Cursor:
        x, y, z = self.people_m["ada"]
        return Cursor(
            stamp_ns=self.now_ns, surface_id="workspace/horizontal", point_m=self.target_m,
            origin_m=(x, y, z + EYES_M),
        )  # fmt: skip

    def _tick(self) -> None:
        self.stop = self.safety.stop("ada", "follow", self.now_ns)
        if self.stop is not None:
            self.command(Stop(self._order))
            return
        if self.target_m is None:
            return
        x, y, z = self.target_m
        height_m = self.config.hover_m if self.config.kind == "quadrotor" else 0.0
        at = self.safety.set_point("ada", (x, y, z + height_m), self.now_ns)
        self.problem = at.problem
        self.command(Follow(self._order, at.position_m, None, at.max_speed_mps))
