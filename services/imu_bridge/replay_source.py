"""A recorded device, replayed at its own times.

No core: it reads a file and waits for the times in it.
"""

import asyncio
import logging
from pathlib import Path

import numpy as np
from pydantic import Field

from pointit.runtime.clock import Clock, sleep
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.sources import Deliver, ImuSource, Reading
from pointit.sim.motion_table import MotionForm
from pointit.sim.recordings import read_imu_csv

log = logging.getLogger(__name__)


class ReplayConfig(MotionForm):
    """A recorded device."""

    recording: str = Field(default="", description="CSV file with columns t (s), qw, qx, qy, qz")
    start_ns: int = Field(
        default=0,
        ge=0,
        le=2**62,
        description="time at which the recording's t is 0, Unix ns; 0: start of the service",
    )
    loop: bool = Field(default=False, description="restart at the end")


class ReplaySource:
    """Plays a recording; each sample is delivered at its time and stamped with it."""

    def __init__(self, config: ReplayConfig, clock: Clock) -> None:
        """Read the recording.

        Raises:
            ConfigError: If it cannot be used.
        """
        recording = read_imu_csv(Path(config.recording), config)
        self._config = config
        self._clock = clock
        for sentence in recording.notes:
            log.warning("%s: %s", recording.path, sentence)
        is_known = np.isfinite(recording.orientation_xyzw).all(axis=1)
        times_ns = np.rint(recording.t_s[is_known] * NS_PER_S)
        self._times_ns: list[int] = times_ns.astype(np.int64).tolist()
        self._orientations: list[list[float]] = recording.orientation_xyzw[is_known].tolist()

    async def run(self, deliver: Deliver) -> None:
        """Deliver the samples, once or in a loop; then wait to be cancelled.

        Samples whose time has passed at the start are skipped.
        """
        start_ns = self._config.start_ns or self._clock.now_ns()
        first_ns = self._clock.now_ns()
        span_ns = self._span_ns()
        while True:
            for time_ns, (x, y, z, w) in zip(self._times_ns, self._orientations, strict=True):
                due_ns = start_ns + time_ns
                if due_ns < first_ns:
                    continue
                await self._until(due_ns)
                deliver(Reading(due_ns, (x, y, z, w)))
            if not self._config.loop:
                break
            start_ns += span_ns
        log.info("%s is over", self._config.recording)
        await asyncio.Event().wait()

    async def _until(self, due_ns: int) -> None:
        await asyncio.sleep(0)  # when late: subscribers in this process still get every sample
        while (wait_ns := due_ns - self._clock.now_ns()) > 0:
            await sleep(self._clock, wait_ns / NS_PER_S)

    def _span_ns(self) -> int:
        """Return the period of the loop, ns: the recording and one mean step after its last sample."""
        times_ns = self._times_ns
        length_ns = times_ns[-1] - times_ns[0]
        return length_ns + max(length_ns // max(len(times_ns) - 1, 1), NS_PER_S // 1000)


def _check(config: ReplayConfig) -> None:
    if not config.recording:
        raise ConfigError("replay.recording: is missing; name a CSV file with columns t, qw, qx, qy, qz")
    read_imu_csv(Path(config.recording), config)


REPLAY = ImuSource(
    summary="a recorded device",
    config=ReplayConfig,
    make=lambda config, around: ReplaySource(config, around.clock),
    check=_check,
    argument="recording",
    example="FILE.csv",
)
