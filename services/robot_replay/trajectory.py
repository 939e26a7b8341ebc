"""A recorded robot as reported by a tracker: position and velocity at its own times."""

import numpy as np

from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST, NS_PER_S, TrackedObject, TrackedObjects
from pointit.sim.recordings import RecordedMotion

KIND = "robot"

LATENCY_SIGMA_S = 0.02
"""Uncertainty of the time between robot and arm in a recording: half a sample at 25 Hz."""


class Trajectory:
    """The reports of a recording, one a sample with a position; samples that share a time make one report."""

    def __init__(self, motion: RecordedMotion, robot_id: str = "robot") -> None:
        """Read the robot of `motion`; its velocity comes from finite differences.

        Raises:
            ConfigError: If the recording has no robot, or a single sample.
        """
        if motion.robot_m is None:
            raise ConfigError(
                f"{motion.path}: has no positions in 'robot_x', 'robot_y', 'robot_z': no robot to replay"
            )
        is_finite = np.isfinite(motion.robot_m)
        is_known = is_finite.all(axis=1)
        t_s = motion.t_s[is_known]
        robot_m = motion.robot_m[is_known]

        # Samples that share a time make one report, the first of them
        rounded_ns = np.rint(t_s * NS_PER_S)
        times_ns, first = np.unique(rounded_ns.astype(np.int64), return_index=True)
        if len(times_ns) < 2:
            raise ConfigError(f"{motion.path}: a robot that moves needs two samples at different times")
        positions_m = robot_m[first]
        self._robot_id = robot_id
        self._positions_m: list[list[float]] = positions_m.tolist()
        times_s = times_ns / NS_PER_S
        velocities = np.empty_like(positions_m)
        for axis in range(3):
            velocities[:, axis] = np.gradient(positions_m[:, axis], times_s)
        # samples that are nanoseconds apart give jumps beyond the limits of messages
        clipped = np.clip(velocities, -FARTHEST, FARTHEST)
        self._velocities: list[list[float]] = clipped.tolist()
        self.times_ns: list[int] = times_ns.tolist()
        """Times of the reports from the recording's start, rising."""

    def report(self, index: int, start_ns: int) -> TrackedObjects:
        """Return report `index` of a recording that started at `start_ns`."""
        x, y, z = self._positions_m[index]
        vx, vy, vz = self._velocities[index]
        velocity_mps = (vx, vy, vz)
        robot = TrackedObject(id=self._robot_id, kind=KIND, position_m=(x, y, z), velocity_mps=velocity_mps)
        stamp_ns = start_ns + self.times_ns[index]
        return TrackedObjects(
            stamp_ns=stamp_ns, seq=index + 1, objects=(robot,), latency_sigma_s=LATENCY_SIGMA_S
        )
