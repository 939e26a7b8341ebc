"""The least squares of lamps that were pointed at from two places, of which only the walk between is known.

The first place is the origin of the room. The person paces to the second one: the length and the direction of
the walk are known roughly, and the yaw of their device drifts on the way. All three are estimated with the
lamps, by the least squares of `by_pointing` with other priors. The result has the scale of the walk, so
positions may be half a metre wrong. Directions from the two places and from between them stay as exact as one
pointing, since the map is wrong in the way in which the person pointed.

One place alone determines directions from there. Lamps are then `USUAL_M` away by assumption.

Stated standard deviations of directions are those of the angle on the sphere, the root of the sum of the
variances of azimuth and elevation: twice that covers the right direction in more than 95 %.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pointit.geometry.vector import Vec3
from pointit.scan.bundle import Array, vec3
from pointit.scan.by_pointing import NEAREST_M, PointingModel, TargetRay

FIRST = "A"
SECOND = "B"
"""Names of the two places."""
WALK_M = 2.0
"""Length of the walk that people are asked for, m."""
WALK_SIGMA_M = 0.4
"""Standard deviation of what they walk, m."""
TO_THE_LEFT_RAD = math.pi / 2.0
WALK_AZIMUTH_SIGMA_RAD = math.radians(20.0)
"""Standard deviation of its direction."""
DRIFT_SIGMA_RAD = math.radians(2.0)
"""Standard deviation of the change of the device's yaw on the walk."""
ZERO_SIGMA_RAD = math.radians(5.5)
"""Standard deviation of the device's yaw after its zero was found again by a press at a lamp. It is that of
the press, which comes after a wide reach, and of the one with which it is compared."""
USUAL_M = 3.0
"""Expected distance of lamps along the floor, m."""
DISTANCE_SIGMA_M = 1.5
"""Its standard deviation."""
MIN_HEIGHT_M = 0.16
MAX_HEIGHT_M = 3.0
"""Lamps are not below the floor and seldom higher than a ceiling."""
FLOOR_SIGMA_M = 0.05
CEILING_SIGMA_M = 0.4
"""Standard deviations of these limits."""
BENT_ARM_RAD = math.radians(3.3)
"""Least standard deviation that is stated: every twentieth reach is with a bent arm, 5 to 10° off."""
PRESS_SIGMA_RAD = math.radians(2.0)
"""Standard deviation of one press beside the others of the person, per axis."""
USUAL_REACH_RAD = math.radians(39.0)
REACH_SIGMA_RAD = math.radians(4.5)
"""Scatter of azimuths after a reach of that angle or more. It grows with the angle (Schmidt 1979)."""
STILL_SIGMA_RAD = math.radians(1.5)
"""Scatter of azimuths that does not depend on the reach."""
MOVING_SHARE = math.sqrt(3.0)
"""Half the way of an arm that moves evenly, in the rms of its rays around their mean: what a press is off."""
KNOWN_M = 1e-3
KNOWN_RAD = 1e-3
"""Standard deviations of what defines the frame: the first place, and the person's own errors."""
MAX_MISFIT = 3.0
"""Rms of the residuals of a lamp, in those of one press, from which its presses contradict each other."""
MAX_DIRECTION_SIGMA_RAD = math.radians(7.0)
"""Standard deviation of the angle to a lamp, up to which people can point by a map: 5° an axis."""


@dataclass(frozen=True, kw_only=True)
class Walk:
    """Prior of the walk from the first place to the second one.

    Attributes:
        length_m: its length, with the standard deviation `length_sigma_m`.
        azimuth_rad: its direction, where 0 is that of the device's yaw 0 at the first place.
        drift_sigma_rad: standard deviation of the change of the device's yaw on the way.
    """

    length_m: float = WALK_M
    length_sigma_m: float = WALK_SIGMA_M
    azimuth_rad: float = TO_THE_LEFT_RAD
    azimuth_sigma_rad: float = WALK_AZIMUTH_SIGMA_RAD
    drift_sigma_rad: float = DRIFT_SIGMA_RAD


@dataclass(frozen=True)
class PacedRay(TargetRay):
    """A press.

    Attributes:
        judged_sigma_rad: standard deviation of its azimuth by which contradictions are judged. That does not
            grow with the reach: a wide reach hides no wrong lamp.
        zero: number of the zero of the device's yaw. Presses with the same one share its error.
    """

    judged_sigma_rad: float = PRESS_SIGMA_RAD
    zero: int = 0


@dataclass(frozen=True, kw_only=True)
class PacedTarget:
    """A lamp.

    Attributes:
        position_m: {W}, whose origin is on the floor at the first place.
        sigma_m: standard deviation of the position in the worst direction.
        direction_sigmas_rad: standard deviation of the angle to the right direction, as seen from each place
            with the device's yaw there, and from the middle between two.
        reason: why it must be pointed at once more, or `""`.
        other: name of the lamp whose presses from one place fit this one better, or `""`.
        is_unsure: the presses cannot tell that they are not exchanged with those of another lamp.
    """

    position_m: Vec3
    sigma_m: float
    direction_sigmas_rad: tuple[float, ...]
    reason: str = ""
    other: str = ""
    is_unsure: bool = False


@dataclass(frozen=True, kw_only=True)
class PacedRoom:
    """Lamps by name, and the places on the floor from which they were pointed at, {W}."""

    targets: dict[str, PacedTarget]
    places_m: tuple[tuple[float, float], ...]
    drift_rad: float = 0.0
    """Change of the device's yaw from the first place to the second one."""
    walk_m: float = 0.0
    """Length of the walk. 0 if there was none."""
    walk_sigma_m: float = 0.0
    """Its standard deviation."""


def paced_ray(
    target: str,
    place: str,
    eyes_m: Vec3,
    direction: Vec3,
    reach_rad: float | None = None,
    *,
    spread_rad: float = 0.0,
    zero: int = 0,
) -> PacedRay:
    """Return the ray of a press at `place`, with its eyes and direction in the person's frame {H}.

    Args:
        target: name.
        place: name.
        eyes_m: {H}; only their height counts.
        direction: {H}, unit.
        reach_rad: angle by which the arm has moved from the press before, which says how exact this one is.
            None: all presses count the same.
        spread_rad: rms angle of the rays of the press around their mean.
        zero: number of the zero of the device's yaw. Presses with the same one share its error.
    """
    moving_rad = MOVING_SHARE * spread_rad
    azimuth_sigma_rad = PRESS_SIGMA_RAD
    if reach_rad is not None:
        share = min(reach_rad / USUAL_REACH_RAD, 1.0)
        azimuth_sigma_rad = math.hypot(STILL_SIGMA_RAD, share * REACH_SIGMA_RAD)
    return PacedRay(
        target=target,
        person="",
        place=place,
        origin_m=(0.0, 0.0, eyes_m[2]),
        direction=direction,
        place_sigma_m=KNOWN_M,
        heading_sigma_rad=KNOWN_RAD,
        azimuth_sigma_rad=math.hypot(azimuth_sigma_rad, moving_rad),
        elevation_sigma_rad=math.hypot(PRESS_SIGMA_RAD, moving_rad),
        judged_sigma_rad=math.hypot(PRESS_SIGMA_RAD, moving_rad),
        zero=zero,
    )


class PacedModel(PointingModel):
    """The unknowns of `PointingModel`, with the priors of a walk and of usual distances."""

    def __init__(self, rays: Sequence[PacedRay], walk: Walk) -> None:
        """Prepare the fit of the presses `rays`."""
        # Each zero of the yaw at each place is a place of `PointingModel`, with a heading of its own
        named_rays = [replace(ray, place=f"{ray.place}{ray.zero}") for ray in rays]
        super().__init__(named_rays, hold_sigma_rad=PRESS_SIGMA_RAD, bias_sigma_rad=KNOWN_RAD)
        self._walk = walk
        self._places: dict[tuple[str, int], int] = {}
        """Index of the unknowns of each place and zero: x, y, yaw."""
        for ray, index in zip(rays, self.place.tolist(), strict=True):
            self._places.setdefault((ray.place, ray.zero), index)
        seconds = [index for (place, _), index in self._places.items() if place == SECOND]
        self._second: int | None = None
        """Index of the unknowns of the second place; or None."""
        if seconds:
            self._second = seconds[0]
        self._targets_end = 3 * len(self._targets)

    def fit(self) -> Any:
        """Return the solution of `scipy.optimize.least_squares`."""
        return least_squares(self.residuals, self.start())

    def start(self) -> Array:
        """Return lamps at the usual distance along their first ray, and the walk as it was asked for."""
        values = np.zeros(self.count)
        for number in range(len(self._targets)):
            first_ray = self._first_ray(number)
            direction = self.directions[first_ray]
            x, y, _ = direction
            level = max(float(np.hypot(x, y)), NEAREST_M)
            part = slice(3 * number, 3 * number + 3)
            values[part] = self.origins[first_ray] + direction * USUAL_M / level
        if self._second is not None:
            azimuth_rad = self._walk.azimuth_rad
            walk_direction = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad)])
            part = slice(self._second, self._second + 2)
            values[part] = self._walk.length_m * walk_direction
        return values

    def _first_ray(self, number: int) -> int:
        """Return the index of the first ray to a target."""
        own = np.flatnonzero(self.target == 3 * number)
        return int(own[0])

    def priors(self, values: Array) -> Array:
        """Return the weighted residuals of people, of the first place, of the walk, and of distances."""
        walk = self._walk
        fixed = super().priors(values).copy()
        points = values[: self._targets_end]
        distances_m = np.hypot(points[0::3], points[1::3])
        heights_m = points[2::3]
        below = np.minimum(heights_m - MIN_HEIGHT_M, 0.0) / FLOOR_SIGMA_M
        above = np.maximum(heights_m - MAX_HEIGHT_M, 0.0) / CEILING_SIGMA_M
        usual = np.concatenate([(distances_m - USUAL_M) / DISTANCE_SIGMA_M, below + above])
        self._weigh_zeros(values, fixed)
        if self._second is None:
            return np.concatenate([fixed, usual])

        # The second place has the priors of a walk, in polar coordinates, instead of those of a known one.
        first_prior = self._prior(self._second)
        x, y, _ = values[self._second : self._second + 3]
        length_error_m = math.hypot(x, y) - walk.length_m
        azimuth_rad = math.atan2(y, x)
        azimuth_error_rad = math.remainder(azimuth_rad - walk.azimuth_rad, math.tau)
        fixed[first_prior] = length_error_m / walk.length_sigma_m
        fixed[first_prior + 1] = azimuth_error_rad / walk.azimuth_sigma_rad
        return np.concatenate([fixed, usual])

    def _prior(self, unknown: int) -> int:
        """Return the index of the prior of an unknown of a place."""
        return unknown - (self.count - len(self._prior_sigmas))

    def _weigh_zeros(self, values: Array, fixed: Array) -> None:
        """Write the priors of places beside the first of their name, and of all headings, into `fixed`."""
        base: dict[str, tuple[int, int]] = {}
        for (place, zero), index in self._places.items():
            if place not in base:
                base[place] = (index, zero)
                continue
            base_index, _ = base[place]
            prior = self._prior(index)
            difference = values[index : index + 3] - values[base_index : base_index + 3]
            fixed[prior : prior + 3] = difference / np.array([KNOWN_M, KNOWN_M, ZERO_SIGMA_RAD])
        if self._second is None:
            return

        # The yaw drifts on the walk, from that of the first place with the same zero if there is one
        _, second_zero = base[SECOND]
        yaw_rad = values[self._second + 2]
        sigma_rad = self._walk.drift_sigma_rad
        same_zero = self._places.get((FIRST, second_zero))
        if same_zero is not None:
            yaw_rad = yaw_rad - values[same_zero + 2]
        else:
            sigma_rad = math.hypot(sigma_rad, ZERO_SIGMA_RAD)
        fixed[self._prior(self._second) + 2] = yaw_rad / sigma_rad

    def room(self, solution: Any) -> PacedRoom:
        """Return the room of a solution of `fit`."""
        values = np.asarray(solution.x, dtype=np.float64)
        residuals = np.asarray(solution.fun, dtype=np.float64)
        information = solution.jac.T @ solution.jac
        covariance = np.asarray(np.linalg.pinv(information), dtype=np.float64)

        # Directions are judged as seen from both places, and from the middle of the walk.
        places_m: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
        shares: tuple[float, ...] = (0.0,)
        drift_rad = 0.0
        if self._second is not None:
            x, y, yaw_rad = values[self._second : self._second + 3].tolist()
            places_m = ((0.0, 0.0), (x, y))
            shares = (0.0, 1.0, 0.5)
            drift_rad = yaw_rad

        walk_m, walk_sigma_m = self._walk_length(values, covariance)
        targets: dict[str, PacedTarget] = {}
        for number, name in enumerate(self._targets):
            own = np.flatnonzero(self.target == 3 * number)
            part = slice(3 * number, 3 * number + 3)
            sigmas_rad: list[float] = []
            for share in shares:
                sigma_rad = self._direction_sigma_rad(values, covariance, number, share)
                sigmas_rad.append(sigma_rad)
            targets[name] = PacedTarget(
                position_m=vec3(values[part]),
                sigma_m=_worst_sigma(covariance[part, part]),
                direction_sigmas_rad=tuple(sigmas_rad),
                reason=self._reason(values, residuals, own),
            )
        return PacedRoom(
            targets=targets,
            places_m=places_m,
            drift_rad=drift_rad,
            walk_m=walk_m,
            walk_sigma_m=walk_sigma_m,
        )

    def _walk_length(self, values: Array, covariance: Array) -> tuple[float, float]:
        """Return the length of the walk and its standard deviation, m."""
        if self._second is None:
            return 0.0, 0.0
        part = slice(self._second, self._second + 2)
        walk_m = float(np.linalg.norm(values[part]))
        along = values[part] / max(walk_m, NEAREST_M)
        variance = float(along @ covariance[part, part] @ along)
        return walk_m, math.sqrt(max(variance, 0.0))

    def log_evidence(self, solution: Any) -> float:
        """Return the logarithm of the probability of the presses under this walk, but for a constant.

        Laplace's approximation. The prior of the walk is in polar coordinates, the unknowns are not.
        """
        values = np.asarray(solution.x, dtype=np.float64)
        information = solution.jac.T @ solution.jac
        _, log_determinant = np.linalg.slogdet(information)
        evidence = -float(solution.cost) - 0.5 * float(log_determinant)
        if self._second is None:
            return evidence
        walk_m = math.hypot(*values[self._second : self._second + 2].tolist())
        walk = self._walk
        priors = math.log(walk.length_sigma_m) + math.log(walk.azimuth_sigma_rad)
        return evidence - math.log(max(walk_m, KNOWN_M)) - priors

    def _direction_sigma_rad(self, values: Array, covariance: Array, number: int, share: float) -> float:
        """Return the standard deviation of the angle to a lamp from `share` of the walk.

        The direction is that of the device, whose yaw has drifted by that share of the drift.
        """
        first = 3 * number
        unknowns = [first, first + 1, first + 2]
        lamp_m = values[unknowns]
        eyes_m = self.origins[self._first_ray(number)]
        step_m = np.zeros(3)
        if self._second is not None:
            place = [self._second, self._second + 1]
            unknowns += [*place, self._second + 2]
            step_m[:2] = share * values[place]
        x, y, z = lamp_m - eyes_m - step_m
        level_m = max(math.hypot(x, y), NEAREST_M)
        range_m2 = level_m**2 + z**2

        # derivatives of azimuth (across the ray) and elevation by the lamp, the second place, and its yaw
        across = np.array([-y, x, 0.0]) / level_m / math.sqrt(range_m2)
        upwards = np.array([-x * z / level_m, -y * z / level_m, level_m]) / range_m2
        by_lamp = np.vstack([across, upwards])
        jacobian = by_lamp
        if self._second is not None:
            by_place = -share * by_lamp[:, :2]
            by_yaw = np.array([[share * level_m / math.sqrt(range_m2)], [0.0]])
            jacobian = np.hstack([by_lamp, by_place, by_yaw])
        own_covariance = covariance[np.ix_(unknowns, unknowns)]
        angle_variance = float(np.trace(jacobian @ own_covariance @ jacobian.T))
        return max(math.sqrt(max(angle_variance, 0.0)), BENT_ARM_RAD)

    def _reason(self, values: Array, residuals: Array, own: NDArray[np.intp]) -> str:
        """Return the reason for which the presses `own` at a lamp do not fit, or `""`."""
        places = self.place[own][:, None] + np.arange(2)
        origins = self.origins[own].copy()
        origins[:, :2] += values[places]
        first = self.target[own[0]]
        sights = values[first : first + 3] - origins
        along_rays = np.sum(sights * self.directions[own], axis=1)
        if bool(np.any(along_rays < 0.0)):
            return "the presses do not meet in front of you: was it another lamp?"

        # Residuals are all azimuths, then all elevations.
        count = len(self._all)
        own_residuals = np.concatenate([residuals[own], residuals[count + own]])
        misfit = math.sqrt(float(np.mean(own_residuals**2)))
        if misfit > MAX_MISFIT:
            return "the presses do not meet: was it another lamp?"
        return ""


def _worst_sigma(covariance: Array) -> float:
    """Return the standard deviation in the worst direction."""
    worst_variance = float(np.linalg.eigvalsh(covariance)[-1])
    return math.sqrt(max(worst_variance, 0.0))
