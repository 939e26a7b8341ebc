"""Outputs of a localization: progress, the pose, an anchor."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pointit.geometry.array_types import Array
from pointit.schemas import FARTHEST, Anchor, Lamp, Localization, UserPose
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.drift.filter import AnchorResult, DriftPose
from pointit.services.localizer.estimation.estimator import Solution
from pointit.services.localizer.estimation.unfiltered_rays import Mean

Phase = Literal["idle", "sampling", "solved", "refused", "cancelled"]
"""Phases of `Localization`."""


@dataclass(frozen=True)
class WithdrawPose:
    """Withdraw our pose because another source publishes it now."""


@dataclass(frozen=True)
class AnchorOutcome:
    """Result of pointing at one lamp."""

    anchor: Anchor
    is_done: bool
    """True if nothing is left to do: the anchor was accepted, or it was only to be measured."""


Output = Localization | UserPose | Anchor | WithdrawPose


def pose_message(
    solution: Solution,
    method: Literal["static_targets", "moving_target"],
    stamp_ns: int,
    config: LocalizerConfig,
) -> UserPose:
    """Return `solution` as a message; `stamp_ns` is that of its newest ray.

    The feet are on the floor: an error of the eye height is not a height of the feet.
    """
    c = [float(value) for value in solution.covariance.ravel()]
    return UserPose(
        stamp_ns=stamp_ns,
        position_m=(bounded(solution.x_m), bounded(solution.y_m), bounded(config.floor_m)),
        yaw_rad=solution.yaw_rad,
        covariance=(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8]),
        method=method,
        elevation_bias_rad=solution.bias_rad,
        residual_rad=solution.residual_rad,
        samples=solution.samples,
    )


def bounded(value: float) -> float:
    """Return the coordinate nearest to `value` that is valid in messages."""
    return max(-FARTHEST, min(FARTHEST, value))


def finite_or_none(value: float) -> float | None:
    """Return `value`, or None if it exceeds the limit of messages."""
    return value if value <= FARTHEST else None


def followed(base: UserPose, now: DriftPose) -> UserPose:
    """Return the pose `base` as estimated by the drift filter now."""
    c = [float(value) for value in now.covariance.ravel()]
    return base.model_copy(
        update={
            "stamp_ns": now.stamp_ns,
            "position_m": (bounded(now.x_m), bounded(now.y_m), base.position_m[2]),
            "yaw_rad": now.yaw_rad,
            "covariance": (c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8]),
            "yaw_rate_radps": now.yaw_rate_radps,
            "yaw_rate_sigma_radps": now.yaw_rate_sigma_radps,
            "anchored_ns": now.anchored_ns,
        }
    )


def covariance_of(pose: UserPose) -> Array:
    """Return the covariance of (x, y, yaw) as a 3 x 3 matrix."""
    return np.array(pose.covariance, dtype=np.float64).reshape(3, 3)


def anchor_message(lamp: Lamp, mean: Mean, before: UserPose, result: AnchorResult) -> Anchor:
    """Return the message of pointing at `lamp`; `before` is the pose at that time, without this anchor."""
    return Anchor(
        stamp_ns=mean.stamp_ns,
        target_id=lamp.id,
        target_m=lamp.position_m,
        origin_m=mean.origin_m,
        raw_direction=mean.raw_direction,
        direction=mean.direction,
        spread_rad=mean.spread_rad,
        samples=mean.samples,
        position_m=before.position_m,
        yaw_rad=before.yaw_rad,
        azimuth_error_rad=result.azimuth_error_rad,
        elevation_error_rad=result.elevation_error_rad,
        accepted=result.accepted,
        reason=result.note if result.accepted else result.reason,
    )
