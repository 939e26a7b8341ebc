"""Elevation bias of a person, remembered between localizations by following (localization.md).

Each accepted localization measures the bias without any truth. A Kalman filter over the bias at
`REFERENCE_RAD` and its slope by the elevation gives the expected bias of the next localization, in place of
that of any person.
"""

import math
from dataclasses import replace

import numpy as np

from pointit.geometry.array_types import Array
from pointit.schemas import RememberedBias
from pointit.services.localizer.estimation.estimator import Pointings, Solution, SolverSettings, solve

REFERENCE_RAD = math.radians(-20.0)
"""Elevation of the filter's bias: the median of rays at robots 2 to 5 m away."""

WANDER_RAD = math.radians(2.0)
"""Standard deviation of one person's bias between localizations."""

MIN_SPAN_S = 2.9
"""Shortest time of following that measures the bias: 3 s, less the interval of the rays."""

MAX_SIGMAS = 2.0
"""Difference from the remembered bias, in its standard deviations, from which it is another person's."""

MAX_HEIGHT_CHANGE_M = 0.05
"""Change of the origin's height from which the rays are those of another body."""


def expected_bias(remembered: RememberedBias, elevation_rad: float) -> tuple[float, float]:
    """Return mean and standard deviation (rad) of the next bias of rays at `elevation_rad`."""
    row = np.array([1.0, elevation_rad - REFERENCE_RAD])
    mean_rad = float(row @ (remembered.bias_rad, remembered.slope))
    variance = float(row @ _covariance(remembered) @ row)
    return mean_rad, math.sqrt(max(0.0, variance) + WANDER_RAD**2)


def updated(
    remembered: RememberedBias, bias_rad: float, sigma_rad: float, elevation_rad: float
) -> RememberedBias:
    """Return the remembered bias after one more measurement (Kalman filter).

    Args:
        remembered: before; without any localization, what is expected of anybody.
        bias_rad: as measured without memory and without a prior.
        sigma_rad: its standard deviation.
        elevation_rad: mean elevation of the rays.
    """
    row = np.array([1.0, elevation_rad - REFERENCE_RAD])
    covariance = _covariance(remembered)
    mean_rad, spread_rad = expected_bias(remembered, elevation_rad)

    # `spread_rad` includes what the bias wanders between localizations, the covariance does not
    gain = covariance @ row / (spread_rad**2 + sigma_rad**2)
    step = gain * (bias_rad - mean_rad)
    new_covariance = covariance - np.outer(gain, row @ covariance)
    localizations = min(remembered.localizations + 1, 2**31 - 1)  # as a message can hold
    return remembered.model_copy(
        update={
            "localizations": localizations,
            "bias_rad": remembered.bias_rad + float(step[0]),
            "slope": remembered.slope + float(step[1]),
            "covariance": tuple(new_covariance.ravel().tolist()),
        }
    )


class BiasMemory:
    """The remembered bias of one person, who may be another one the next time."""

    def __init__(self) -> None:
        self.remembered: RememberedBias | None = None
        """None before the first localization."""
        self.mounting = ""
        """Mounting of the sensor now, see `ImuSample`. With another one the bias is another one, too."""

    def believed(self, pointings: Pointings, settings: SolverSettings, floor_m: float) -> SolverSettings:
        """Return `settings` with the remembered bias, or as they are if the rays contradict it.

        Args:
            pointings: of the localization so far, without spikes.
            settings: without memory.
            floor_m: height of the floor in {W}.
        """
        remembered = self.remembered
        if remembered is None or len(pointings) < settings.min_samples:
            return settings
        solution = solve(pointings, settings.any_bias(), floor_m=floor_m)
        if not isinstance(solution, Solution):
            return settings
        if self._contradicts(remembered, solution.bias_rad, pointings):
            return settings
        mean_rad, sigma_rad = expected_bias(remembered, _mean_elevation(pointings))

        # The limit of the bias stays where it is without memory, however the expected bias moves
        limit_rad = settings.bias_sigma_limit * settings.bias_sigma_rad
        remaining_rad = limit_rad - abs(mean_rad - settings.bias_rad)
        if sigma_rad >= settings.bias_sigma_rad or remaining_rad <= 0.0:
            return settings
        return replace(
            settings, bias_rad=mean_rad, bias_sigma_rad=sigma_rad, bias_sigma_limit=remaining_rad / sigma_rad
        )

    def learn(self, pointings: Pointings, settings: SolverSettings, floor_m: float) -> bool:
        """Measure the bias if the rays of an accepted pose are enough, and forget one that they contradict.

        Args:
            pointings: of the localization, without spikes.
            settings: without memory.
            floor_m: height of the floor in {W}.

        Returns:
            True if the bias was measured.
        """
        solution = solve(pointings, settings.any_bias(), floor_m=floor_m)
        if not isinstance(solution, Solution) or pointings.span_s < MIN_SPAN_S:
            return False
        if self.remembered is not None and self._contradicts(self.remembered, solution.bias_rad, pointings):
            self.remembered = None

        # What the rays say without the prior, which the filter has already
        information = solution.bias_sigma_rad**-2 - settings.bias_sigma_rad**-2
        if information <= 0.0:
            return False
        shift_rad = (solution.bias_rad - settings.bias_rad) / solution.bias_sigma_rad**2 / information
        bias_rad = settings.bias_rad + shift_rad
        sigma_rad = information**-0.5

        previous = self.remembered or RememberedBias(
            localizations=0,
            origin_height_m=_origin_height_m(pointings),
            bias_rad=settings.bias_rad,
            slope=0.0,
            covariance=(settings.bias_sigma_rad**2, 0.0, 0.0, settings.elevation_slope_sigma**2),
            mounting=self.mounting,
        )
        self.remembered = updated(previous, bias_rad, sigma_rad, _mean_elevation(pointings))
        return True

    def _contradicts(self, remembered: RememberedBias, bias_rad: float, pointings: Pointings) -> bool:
        """Return True if the person with this bias, measured without memory, is not the remembered one."""
        if self.mounting != remembered.mounting:
            return True
        height_change_m = abs(_origin_height_m(pointings) - remembered.origin_height_m)
        if height_change_m > MAX_HEIGHT_CHANGE_M:
            return True
        mean_rad, sigma_rad = expected_bias(remembered, _mean_elevation(pointings))
        return abs(bias_rad - mean_rad) > MAX_SIGMAS * sigma_rad


def _covariance(remembered: RememberedBias) -> Array:
    return np.array(remembered.covariance, dtype=np.float64).reshape(2, 2)


def _mean_elevation(pointings: Pointings) -> float:
    x, y, z = pointings.directions.T
    return float(np.arctan2(z, np.hypot(x, y)).mean())


def _origin_height_m(pointings: Pointings) -> float:
    return float(pointings.origins_m[:, 2].mean())
