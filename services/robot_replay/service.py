"""Publishes the positions of a recorded robot at the times of the recording."""

import asyncio
import logging
from pathlib import Path
from typing import ClassVar

from pydantic import Field

from pointit.runtime.clock import sleep
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S
from pointit.schemas.base import Name
from pointit.schemas.topics import OBJECTS
from pointit.services.robot_replay.trajectory import Trajectory
from pointit.sim.motion_table import MotionForm
from pointit.sim.recordings import read_robot_csv

log = logging.getLogger(__name__)


class RobotReplayConfig(MotionForm):
    """The recording and its start time."""

    recording: str = Field(
        default="", description="CSV file with columns t (s), robot_x, robot_y, robot_z (m)"
    )
    start_ns: int = Field(
        default=0,
        ge=0,
        le=2**62,
        description="time of the recording's first sample, Unix ns; 0: start of the service",
    )
    tracker: Name = Field(default="robot", description="name of the tracker, unique on the site")
    robot_id: str = Field(default="robot", min_length=1, max_length=64, description="id of the robot")


class RobotReplay(Service[RobotReplayConfig]):
    """Publishes the robot of a recording as a tracker would, sample by sample."""

    NAME: ClassVar[str] = "robot-replay"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = RobotReplayConfig

    def __init__(self, config: RobotReplayConfig, context: Context) -> None:
        """Read the recording.

        Raises:
            ConfigError: If it is not given, cannot be read, or has no robot.
        """
        super().__init__(config, context)
        self.validate_config(config)
        recording = read_robot_csv(Path(config.recording), config)
        for sentence in recording.notes:
            log.warning("%s: %s", recording.path, sentence)
        self._trajectory = Trajectory(recording, config.robot_id)
        self._objects = self.bus.publisher(OBJECTS, config.tracker)

    @classmethod
    def validate_config(cls, config: RobotReplayConfig) -> None:
        """Check that a recording is named."""
        if not config.recording:
            raise ConfigError(
                "recording: is missing; name a CSV file with columns t, robot_x, robot_y, robot_z"
            )

    async def run(self) -> None:
        """Publish each report when it is due and skip past ones; then wait to be cancelled."""
        now_ns = self.clock.now_ns()
        start_ns = self.config.start_ns or now_ns
        for index, time_ns in enumerate(self._trajectory.times_ns):
            due_ns = start_ns + time_ns
            if due_ns < now_ns:
                continue

            # By the clock: a single sleep may end before it shows that time
            wait_ns = due_ns - self.clock.now_ns()
            while wait_ns > 0:
                await sleep(self.clock, wait_ns / NS_PER_S)
                wait_ns = due_ns - self.clock.now_ns()
            report = self._trajectory.report(index, start_ns)
            self._objects.put(report)
        log.info("%s is over", self.config.recording)
        await asyncio.Event().wait()


SERVICE = RobotReplay
