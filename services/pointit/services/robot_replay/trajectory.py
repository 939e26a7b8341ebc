"""A recorded robot as a tracker would have reported it: place and velocity at its own times."""

import numpy as np

from pointit.runtime.errors import ConfigError
from pointit.schemas import TrackedObject, TrackedObjects
from pointit.sim.recordings import ImuRecording

NS_PER_S = 1_000_000_000

KIND = "robot"


class Trajectory:
    """The reports of a recording, one a sample; samples that share a time make one report."""

    def __init__(self, recording: ImuRecording, robot_id: str = "robot") -> None:
        """Take the robot of `recording`; its velocity comes from finite differences.

        Raises:
            ConfigError: the recording has no robot, or a single sample.
        """
        if recording.robot_m is None:
            raise ConfigError(
                f"{recording.path}: has no columns 'robot_x', 'robot_y', 'robot_z': no robot to replay"
            )
        times_s, first = np.unique(recording.t_s, return_index=True)
        if len(times_s) < 2:
            raise ConfigError(f"{recording.path}: a robot that moves needs two samples at different times")
        places = recording.robot_m[first]
        self._robot_id = robot_id
        self._places: list[list[float]] = places.tolist()
        velocities = np.empty_like(places)
        for axis in range(3):
            velocities[:, axis] = np.gradient(places[:, axis], times_s)
        self._velocities: list[list[float]] = velocities.tolist()
        self.times_ns: list[int] = np.rint(times_s * NS_PER_S).astype(np.int64).tolist()
        """When each report is due, from the recording's start, rising."""

    def report(self, index: int, start_ns: int) -> TrackedObjects:
        """Return report `index` of a recording that started at `start_ns`."""
        x, y, z = self._places[index]
        vx, vy, vz = self._velocities[index]
        robot = TrackedObject(id=self._robot_id, kind=KIND, position_m=(x, y, z), velocity_mps=(vx, vy, vz))
        return TrackedObjects(stamp_ns=start_ns + self.times_ns[index], seq=index + 1, objects=(robot,))
