"""A person who points at red segments of scenario_3 with a device of theirs."""

import asyncio
import math
from collections.abc import Callable, Mapping

import pointit
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import BodyMeasures, SelectionEvent
from pointit.sim.aim import Stance
from tests.support.bench import repeated

USER = "user1"
PERIOD_S = 0.01
PATIENCE_S = 20.0
FROM_M = 0.5
"""Arc length from which segments are followed."""
TO_M = 3.5
"""Arc length up to which they are."""
STEP_RAD = 0.05
"""Largest turn of an arm from call to call, so that a gyroscope can follow."""


class Follower:
    """An arm that follows the first red segment that is not done, until it has left or is done."""

    def __init__(self, site: pointit.Site) -> None:
        self.target = ""
        self.done: set[str] = set()
        """Segments that are not followed any more, because they were selected."""
        self._site = site
        self._aim = (0.0, -0.5)

    def orientation(self) -> Quaternion:
        """Return the arm's orientation now, which stays where it is if there is nothing to follow."""
        latest = self._site.latest
        pose = latest.pose.get(USER)
        red = {
            each.id: each
            for tracker in latest.objects
            for each in latest.objects[tracker].objects
            if each.kind == "red" and each.id not in self.done and FROM_M < each.surface_position_m < TO_M
        }
        if pose is None or not red:
            return rotation.from_azimuth_elevation(*self._aim)
        if self.target not in red:
            self.target = max(red, key=lambda each: -red[each].surface_position_m)
        stance = Stance(BodyMeasures(), position_m=pose.position_m)
        azimuth, elevation = stance.aim_at(red[self.target].position_m, (0.0, pose.elevation_bias_rad))
        self._turn(azimuth - pose.yaw_rad, elevation)
        return rotation.from_azimuth_elevation(*self._aim)

    def _turn(self, azimuth: float, elevation: float) -> None:
        """Turn by at most `STEP_RAD`."""
        turns = (math.remainder(azimuth - self._aim[0], math.tau), elevation - self._aim[1])
        right, up = (max(-STEP_RAD, min(STEP_RAD, turn)) for turn in turns)
        self._aim = (self._aim[0] + right, self._aim[1] + up)


async def first_selected(
    imu: str, settings: Mapping[str, object], turn: Callable[[Quaternion], None]
) -> SelectionEvent:
    """Run scenario_3 in this process, and turn the device until an object is selected."""
    async with pointit.run("scenario_3", seed=1, imu=[imu], settings=settings) as site:
        follower = Follower(site)
        async with repeated(PERIOD_S, lambda: turn(follower.orientation())), asyncio.timeout(PATIENCE_S):
            async for event in site.selections():
                if event.event == "selected":
                    return event
    raise AssertionError("the site has ended")
