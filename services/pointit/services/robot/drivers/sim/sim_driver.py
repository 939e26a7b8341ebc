"""The driver of simulated robots: they move by the clock, in any speed of it."""

from pointit.runtime.clock import ticks
from pointit.runtime.service.surroundings import Surroundings
from pointit.schemas import NS_PER_S
from pointit.services.robot.drivers.sim.motion_limits import STEP_S
from pointit.services.robot.drivers.sim.ordered_robot import OrderedRobot, SimConfig
from pointit.services.robot.robot_driver import Command, Land, Report, RobotPlugin, RobotSpec, Stop

REPORT_HZ = 50.0
"""Rate of steps and reports, Hz."""
STEP_NS = round(STEP_S * NS_PER_S)
STALL_S = 1.0
"""Wall time without a step after which the robot has stood still meanwhile, instead of jumping, s."""


class SimDriver:
    """Connection to a simulated robot, which is there as long as `run` runs."""

    def __init__(self, config: SimConfig, spec: RobotSpec, surroundings: Surroundings) -> None:
        self._robot = OrderedRobot(config, spec)
        self._clock = surroundings.clock
        self._is_running = False

    async def run(self, report: Report) -> None:
        """Move the robot, and report, until cancelled."""
        at_ns = self._clock.now_ns()
        self._is_running = True
        try:
            async for now_ns in ticks(self._clock, REPORT_HZ):
                if not 0 <= now_ns - at_ns <= STALL_S * self._clock.speed * NS_PER_S:
                    at_ns = now_ns
                while at_ns + STEP_NS <= now_ns:
                    at_ns += STEP_NS
                    self._robot.step()
                for status in self._robot.take_statuses():
                    report(status)
                report(self._robot.report(at_ns))
        finally:
            self._is_running = False
            self.command(Stop(0))  # so that it does not go on if it runs again

    def command(self, command: Command) -> None:
        """Carry out `command`, or refuse it with a reason."""
        is_early = not self._is_running and not isinstance(command, (Stop, Land))
        self._robot.command(command, "it is not connected yet" if is_early else "")


SIM = RobotPlugin(
    summary="a simulated quadrotor or ground robot, with limited speed, acceleration and turn rate",
    config=SimConfig,
    make=SimDriver,
)
