"""A played localizer whose pose was found, is wrong, or which is busy."""

import time
from dataclasses import dataclass, field
from typing import Any

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import Anchor, Done, PointAnchor, SetPose, UserPose
from tests.support.played_localizer import PlayedLocalizer


@dataclass
class ErringLocalizer(PlayedLocalizer):
    """As the played one, until something else is said of it."""

    truly_m: Vec3 | None = None
    """True position of the person in {W}, m. None if it is the announced one."""
    refuses: str = ""
    """Reason for which pointing at a lamp is refused, or `""` if it is accepted."""
    poses: list[SetPose] = field(default_factory=list[SetPose])
    """As they were said."""

    def find(self, yaw_sigma_rad: float, bias_rad: float = 0.0) -> None:
        """Publish the pose as one that was found by pointing."""
        variances = (0.01, 0.0, 0.0, 0.0, 0.0025, 0.0, 0.0, 0.0, yaw_sigma_rad**2)
        pose = UserPose(
            stamp_ns=time.time_ns(),
            position_m=self.position_m,
            yaw_rad=self.yaw_rad,
            covariance=variances,
            method="static_targets",
            elevation_bias_rad=bias_rad,
        )
        self._poses.put(pose)

    async def _point_anchor(self, query: PointAnchor, _user: str) -> Done:
        if self.refuses:
            self.asked.append(f"anchor {query.lamp}".strip())
            raise RefusedError(self.refuses)
        return await super()._point_anchor(query, _user)

    async def _set_pose(self, query: SetPose, _user: str) -> Done:
        self.poses.append(query)
        return await super()._set_pose(query, _user)

    def _anchor(self, lamp: str, reason: str) -> Anchor:
        told_m = self.position_m
        self.position_m = self.truly_m or told_m
        seen: Anchor = super()._anchor(lamp, reason)
        self.position_m = told_m
        fields: dict[str, Any] = {"position_m": told_m}
        return seen.model_copy(update=fields)
