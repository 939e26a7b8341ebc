"""The driver's core beside a virtual AGV, without a network and with time as an argument."""

import json
from collections.abc import Callable
from typing import Any

from pointit.runtime.service.plugin_guard import Surroundings
from pointit.services.robot.drivers.agv import Agv, Vda5050Config
from pointit.services.robot.robot_driver import LinkLost, OrderStatus, ReportItem, RobotReport, RobotSpec
from pointit.testing.trial import TrialHealth
from pointit_lab.devices.agv_broker import VirtualAgv
from tests.support.bench import ManualClock

SPEC = RobotSpec(
    name="cart",
    kind="ground",
    start_m=(0.0, 0.0, 0.0),
    start_yaw_rad=0.0,
    radius_m=0.3,
    hover_m=0.2,
    max_speed_mps=1.0,
    max_acceleration_mps2=1.0,
)
STEP_S = 0.05


class AgvBench:
    """Passes messages between the two."""

    def __init__(self, **parameters: Any) -> None:
        values = {"broker": "hub", "manufacturer": "acme", "serial_number": "7", **parameters}
        config = Vda5050Config.model_validate(values)
        self.clock = ManualClock()
        self.health = TrialHealth()
        around = Surroundings(clock=self.clock, health=self.health, folder=Surroundings.detached().folder)
        self.agv = Agv(config, SPEC, around)
        self.virtual = VirtualAgv(version=config.version)
        self.items: list[ReportItem] = []
        self.sent: list[tuple[str, str]] = []
        self.now_s = 100.0
        self._commands = 0
        self.is_lossy: Callable[[str], bool] = lambda _topic: False
        """Returns True for a topic whose messages get lost."""
        self.agv.set_report(self.items.append)

    def change(self, **extra: object) -> None:
        """Let the AGV's next states have these fields."""
        self.virtual.extra = extra
        self.virtual.has_changed = True

    def connect(self) -> None:
        """Connect the broker; the AGV, which is connected, hears the question for its state."""
        self.deliver(self.agv.on_connected())

    def deliver(self, publication: tuple[str, str]) -> None:
        self.sent.append(publication)
        if not self.is_lossy(publication[0]):
            self.virtual.receive(*publication)

    def hear(self, name: str, payload: object) -> None:
        self.agv.on_message(self.agv.topic(name), payload, self.now_s)

    def run(self, duration_s: float, speed_mps: float = 1.0) -> None:
        for _ in range(round(duration_s / STEP_S)):
            self.now_s += STEP_S
            self.clock.advance(STEP_S)
            for publication in self.agv.step(self.now_s):
                self.deliver(publication)
            self.virtual.drive(speed_mps * STEP_S)
            if not self.is_lossy(self.agv.topic("state")):
                if self.virtual.has_changed:
                    self.hear("state", self.virtual.state())
                self.hear("visualization", self.virtual.visualization())

    def tell(self, kind: type[Any], *values: Any) -> int:
        self._commands += 1
        self.agv.command(kind(self._commands, *values))
        return self._commands

    def topics(self) -> list[str]:
        """Return the last levels of the topics of what was sent."""
        return [topic.rpartition("/")[2] for topic, _ in self.sent]

    def outcomes(self, order: int) -> list[tuple[str, str]]:
        statuses = [each for each in self.items if isinstance(each, OrderStatus)]
        return [(each.state, each.reason) for each in statuses if each.order == order]

    @property
    def reports(self) -> list[RobotReport]:
        return [each for each in self.items if isinstance(each, RobotReport)]

    @property
    def lost(self) -> list[str]:
        return [each.reason for each in self.items if isinstance(each, LinkLost)]


def connected_bench() -> AgvBench:
    """Return a bench whose AGV has reported."""
    bench = AgvBench()
    bench.connect()
    bench.run(0.1)
    return bench


def orders(bench: AgvBench) -> list[dict[str, object]]:
    return [json.loads(payload) for topic, payload in bench.sent if topic.endswith("/order")]
