"""What a localization gives out while it goes on: lamps to switch, progress, and the pose."""

from dataclasses import dataclass
from typing import Literal

from pointit.schemas import Localization, UserPose
from pointit.services.localizer.estimator import Solution


@dataclass(frozen=True)
class LampSwitch:
    """A lamp that goes on or off."""

    lamp_id: str
    on: bool


Phase = Literal["idle", "sampling", "solved", "refused", "cancelled"]
"""As in `Localization`."""

Output = LampSwitch | Localization | UserPose


def pose_message(
    solution: Solution, method: Literal["static_targets", "moving_target"], stamp_ns: int, floor_m: float
) -> UserPose:
    """Return `solution` as it travels; `stamp_ns` is that of the newest ray in it."""
    c = [float(value) for value in solution.covariance.ravel()]
    return UserPose(
        stamp_ns=stamp_ns,
        position_m=(solution.x_m, solution.y_m, floor_m),
        yaw_rad=solution.yaw_rad,
        covariance=(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8]),
        method=method,
        elevation_bias_rad=solution.bias_rad,
        residual_rad=solution.residual_rad,
        samples=solution.samples,
    )
