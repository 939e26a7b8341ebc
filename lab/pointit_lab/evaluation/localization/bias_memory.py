"""Elevation bias of a person, remembered between localizations by following (localization.md).

A long localization measures the bias without any truth. A Kalman filter over the bias at `REFERENCE_RAD` and
its slope by the elevation gives the expected bias of the next localization, in place of that of any person.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import Array
from pointit.services.localizer.estimation.estimator import Pointings, Solution, SolverSettings, solve

REFERENCE_RAD = math.radians(-20.0)
"""Elevation of the filter's bias: the median of rays at robots 2 to 5 m away."""

WANDER_RAD = math.radians(2.0)
"""Standard deviation of one person's bias between localizations."""

MIN_SPAN_S = 9.9
"""Shortest time of following that measures the bias: a full window of 10 s, less the interval of the rays."""

MAX_SIGMAS = 2.0
"""Difference from the remembered bias, in its standard deviations, from which it is another person's."""

MAX_HEIGHT_CHANGE_M = 0.05
"""Change of the origin's height from which the rays are those of another body."""


@dataclass(frozen=True, kw_only=True)
class RememberedBias:
    """Bias of one person with one wearing of the sensor, from their localizations so far."""

    localizations: int = 0
    """Number of measurements."""
    origin_height_m: float
    """Height of the rays' origin over the feet."""
    bias_rad: float = 0.0
    """Elevation of rays above targets at `REFERENCE_RAD`."""
    slope: float = 0.0
    """Change of the bias per elevation."""
    covariance: Array
    """Covariance of bias and slope, `(2, 2)`."""

    def expected_bias(self, elevation_rad: float) -> tuple[float, float]:
        """Return mean and standard deviation (rad) of the next bias of rays at `elevation_rad`."""
        row = np.array([1.0, elevation_rad - REFERENCE_RAD])
        mean_rad = float(row @ (self.bias_rad, self.slope))
        return mean_rad, math.sqrt(float(row @ self.covariance @ row) + WANDER_RAD**2)

    def updated(self, bias_rad: float, sigma_rad: float, elevation_rad: float) -> "RememberedBias":
        """Return the memory after a measurement of the bias at `elevation_rad` (Kalman filter).

        Args:
            bias_rad: as measured without this memory and without a prior.
            sigma_rad: its standard deviation.
            elevation_rad: mean elevation of the rays.
        """
        row = np.array([1.0, elevation_rad - REFERENCE_RAD])
        mean_rad, spread_rad = self.expected_bias(elevation_rad)
        gain = self.covariance @ row / (spread_rad**2 + sigma_rad**2)
        bias, slope = (self.bias_rad, self.slope) + gain * (bias_rad - mean_rad)
        left = self.covariance - np.outer(gain, row @ self.covariance)
        return replace(
            self,
            bias_rad=float(bias),
            slope=float(slope),
            covariance=left,
            localizations=self.localizations + 1,
        )

    def contradicts(self, bias_rad: float, elevation_rad: float, origin_height_m: float) -> bool:
        """Return True if a person with this bias, found without memory, is not the remembered one."""
        mean_rad, sigma_rad = self.expected_bias(elevation_rad)
        is_other_body = abs(origin_height_m - self.origin_height_m) > MAX_HEIGHT_CHANGE_M
        return is_other_body or abs(bias_rad - mean_rad) > MAX_SIGMAS * sigma_rad

    def believed(self, settings: SolverSettings, elevation_rad: float) -> SolverSettings:
        """Return `settings` that expect the remembered bias; the largest bias that is pointing stays."""
        mean_rad, sigma_rad = self.expected_bias(elevation_rad)
        if sigma_rad >= settings.bias_sigma_rad:
            return settings
        limit_rad = settings.bias_sigma_limit * settings.bias_sigma_rad
        return replace(
            settings, bias_rad=mean_rad, bias_sigma_rad=sigma_rad, bias_sigma_limit=limit_rad / sigma_rad
        )


class BiasMemory:
    """The remembered bias of one person, who may be another one the next time."""

    def __init__(self) -> None:
        self.remembered: RememberedBias | None = None
        """None before the first long localization."""

    def believed(self, pointings: Pointings, settings: SolverSettings, floor_m: float) -> SolverSettings:
        """Return `settings` with the remembered bias, or as they are if the rays contradict it."""
        remembered = self.remembered
        if remembered is None or len(pointings) < settings.min_samples:
            return settings
        found = solve(pointings, settings.any_fit(), floor_m=floor_m)
        elevation_rad, height_m = _elevation_and_height(pointings)
        if not isinstance(found, Solution) or remembered.contradicts(found.bias_rad, elevation_rad, height_m):
            return settings
        return remembered.believed(settings, elevation_rad)

    def learn(self, pointings: Pointings, settings: SolverSettings, floor_m: float) -> bool:
        """Forget a bias that the rays of an accepted pose contradict, and measure it if they are enough.

        Args:
            pointings: of the localization.
            settings: without memory.
            floor_m: height of the floor in {W}.

        Returns:
            True if the bias was measured.
        """
        if self.remembered is None and pointings.span_s < MIN_SPAN_S:
            return False
        found = solve(pointings, settings.any_fit(), floor_m=floor_m)
        if not isinstance(found, Solution):
            return False
        elevation_rad, height_m = _elevation_and_height(pointings)
        if self.remembered is not None and self.remembered.contradicts(
            found.bias_rad, elevation_rad, height_m
        ):
            self.remembered = None
        # what the rays say without the prior: the filter has it already
        information = found.bias_sigma_rad**-2 - settings.bias_sigma_rad**-2
        if pointings.span_s < MIN_SPAN_S or information <= 0.0:
            return False
        before = self.remembered or RememberedBias(
            origin_height_m=height_m,
            bias_rad=settings.bias_rad,
            covariance=np.diag([settings.bias_sigma_rad**2, settings.elevation_slope_sigma**2]),
        )
        shift_rad = (found.bias_rad - settings.bias_rad) / found.bias_sigma_rad**2 / information
        self.remembered = before.updated(settings.bias_rad + shift_rad, information**-0.5, elevation_rad)
        return True


def _elevation_and_height(pointings: Pointings) -> tuple[float, float]:
    """Return the mean elevation of the rays, rad, and the mean height of their origins in {H}, m."""
    x, y, z = pointings.directions.T
    return float(np.arctan2(z, np.hypot(x, y)).mean()), float(pointings.origins_m[:, 2].mean())
