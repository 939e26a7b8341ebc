"""Health metrics of a tracked pose."""

import math
from collections.abc import Iterator

from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftPose

FIGURES = (
    ("drift", "°/min"),
    ("anchor age", "s"),
    ("position σ", "m"),  # noqa: RUF001 - sigma is meant
    ("yaw σ", "°"),  # noqa: RUF001 - sigma is meant
)


def figures(pose: DriftPose | None, now_ns: int) -> Iterator[tuple[str, float | None, str]]:
    """Yield name, value and unit of each metric.

    Args:
        pose: current estimate. None if there is none; then all values are None.
        now_ns: the time.
    """
    values: tuple[float | None, ...] = (None,) * len(FIGURES)
    if pose is not None:
        values = (
            math.degrees(pose.yaw_rate_radps) * 60.0,
            max(0, now_ns - pose.anchored_ns) / NS_PER_S if pose.anchored_ns else None,
            pose.position_sigma_m,
            math.degrees(pose.yaw_sigma_rad),
        )
    for (name, unit), value in zip(FIGURES, values, strict=True):
        yield name, value, unit
