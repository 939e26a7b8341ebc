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
    return UserPose(
        stamp_ns=stamp_ns,
        position_m=(bounded(solution.x_m), bounded(solution.y_m), bounded(config.floor_m)),
        yaw_rad=solution.yaw_rad,
        covariance=_row_major(solution.covariance),
        method=method,
        elevation_bias_rad=solution.bias_rad,
        residual_rad=solution.residual_rad,
        samples=solution.samples,
    )


def _row_major(covariance: Array) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return a covariance (3 x 3) as messages hold it."""
    (xx, xy, xt), (yx, yy, yt), (tx, ty, tt) = covariance.tolist()
    return xx, xy, xt, yx, yy, yt, tx, ty, tt


def bounded(value: float) -> float:
    """Return the coordinate nearest to `value` that is valid in messages."""
    return max(-FARTHEST, min(FARTHEST, value))


def finite_or_none(value: float) -> float | None:
    """Return `value`, or None if it exceeds the limit of messages."""
    return value if value <= FARTHEST else None


def followed(base: UserPose, now: DriftPose) -> UserPose:
    """Return the pose `base` as estimated by the drift filter now."""
    position_m = (bounded(now.x_m), bounded(now.y_m), base.position_m[2])
    return base.model_copy(
        update={
            "stamp_ns": now.stamp_ns,
            "position_m": position_m,
            "yaw_rad": now.yaw_rad,
            "covariance": _row_major(now.covariance),
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
    reason = result.note if result.accepted else result.reason
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
        reason=reason,
    )
