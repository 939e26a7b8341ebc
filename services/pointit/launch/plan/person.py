"""A person of a run: where they stand, how tall they are, and how their simulation is parametrized."""

from dataclasses import dataclass
from typing import Any

from pointit.services.supervisor.body import measures

REALISTIC: dict[str, Any] = {
    "wristband": {"yaw_rate_bias_sd_degps": 0.25, "dropout_share": 0.01},
    "anchor_when_off_deg": 10.0,
}
"""Simulated person who is localized by pointing: a band with realistic drift (pointing.md §7), and they point
at a lamp again when the cursor has drifted away."""


@dataclass(frozen=True, kw_only=True)
class Pose:
    """A place on the floor of {W}, and the azimuth there of the IMU's yaw 0."""

    x_m: float
    y_m: float
    yaw_deg: float | None = None
    """None if not given."""


def body_of(stature_m: float) -> dict[str, float]:
    """Return the body measures, as parameters, of a person `stature_m` tall."""
    return {name: round(value, 4) for name, value in measures(stature_m, {}).model_dump().items()}
