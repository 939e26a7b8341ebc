"""Positions of lamps by pointing at them from two places, of which only the walk between them is known.

The first place is the origin of the room. The person paces to the second one: the length and the direction of
the walk are known roughly, and the yaw of their device drifts on the way. All three are estimated with the
lamps, by the least squares of `by_pointing` with other priors. The result has the scale of the walk, so
positions may be half a metre wrong. Directions from the two places and from between them stay as exact as one
pointing, since the map is wrong in the way in which the person pointed.

One place alone determines directions from there. Lamps are then `USUAL_M` away by assumption.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
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
USUAL_M = 3.0
"""Expected distance of lamps along the floor, m."""
DISTANCE_SIGMA_M = 1.5
"""Its standard deviation."""
PRESS_SIGMA_RAD = math.radians(2.0)
"""Standard deviation of one press beside the others of the person, per axis."""
USUAL_REACH_RAD = math.radians(39.0)
REACH_SIGMA_RAD = math.radians(4.5)
"""Scatter of azimuths after a reach of that angle or more. It grows with the angle (Schmidt 1979)."""
STILL_SIGMA_RAD = math.radians(1.5)
"""Scatter of azimuths that does not depend on the reach."""
KNOWN_M = 1e-3
KNOWN_RAD = 1e-3
"""Standard deviations of what defines the frame: the first place, and the person's own errors."""
MAX_MISFIT = 3.0
"""Rms of the residuals of a lamp, in those of one press, from which its presses contradict each other."""
MIN_GAIN = 18.0
"""Decrease of the sum of squares without a lamp, from which that lamp contradicts the others."""
JUDGED = 3
"""Number of lamps from which one of them can contradict the others."""
MAX_DIRECTION_SIGMA_RAD = math.radians(5.0)
"""Standard deviation of a direction up to which a map is good for pointing."""


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


@dataclass(frozen=True, kw_only=True)
class PacedTarget:
    """A lamp.

    Attributes:
        position_m: {W}, whose origin is on the floor at the first place.
        sigma_m: standard deviation of the position in the worst direction.
        direction_sigmas_rad: the same of the direction, as seen from each place, and from between two.
        reason: why it must be pointed at once more, or `""`.
    """

    position_m: Vec3
    sigma_m: float
    direction_sigmas_rad: tuple[float, ...]
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class PacedRoom:
    """Lamps by name, and the places on the floor from which they were pointed at, {W}."""

    targets: dict[str, PacedTarget]
    places_m: tuple[tuple[float, float], ...]
    drift_rad: float = 0.0
    """Change of the device's yaw from the first place to the second one."""


def paced_ray(
    target: str, place: str, eyes_m: Vec3, direction: Vec3, reach_rad: float | None = None
) -> TargetRay:
    """Return the ray of a press at `place`, with its eyes and direction in the person's frame {H}.

    `reach_rad`: angle by which the arm has moved from the press before, which says how exact this one is.
    None: all presses count the same.
    """
    azimuth_sigma_rad = None
    if reach_rad is not None:
        share = min(reach_rad / USUAL_REACH_RAD, 1.0)
        azimuth_sigma_rad = math.hypot(STILL_SIGMA_RAD, share * REACH_SIGMA_RAD)
    return TargetRay(
        target=target,
        person="",
        place=place,
        origin_m=(0.0, 0.0, eyes_m[2]),
        direction=direction,
        place_sigma_m=KNOWN_M,
        heading_sigma_rad=KNOWN_RAD,
        azimuth_sigma_rad=azimuth_sigma_rad,
    )


def locate_paced(rays: Sequence[TargetRay], walk: Walk | None = None) -> PacedRoom:
    """Return the lamps of `rays`, which are those of `paced_ray`, one or more for each lamp and place.

    Args:
        rays: presses at `FIRST`, and at `SECOND` if the person has walked there.
        walk: what is known about the walk; the usual one if None.

    Raises:
        RefusedError: If there is no press at the first place.
    """
    if not any(ray.place == FIRST for ray in rays):
        raise RefusedError("nobody has pointed at anything from the first place yet")
    walk = walk or Walk()

    # Only the last press of each lamp at each place is judged, all alike: a wide reach hides no wrong lamp
    last_rays = {(ray.target, ray.place): replace(ray, azimuth_sigma_rad=None) for ray in rays}
    equal_rays = list(last_rays.values())
    model = PacedModel(equal_rays, walk)
    solution = model.fit()
    room = model.room(solution)
    contradicting = _contradicting(equal_rays, walk, solution, room)
    if contradicting:
        reason = "the presses from the two places do not meet: was it another lamp?"
        target = room.targets[contradicting]
        room.targets[contradicting] = replace(target, reason=reason)
    if equal_rays == list(rays):
        return room

    # Positions and directions: each press by its own scatter
    weighted_model = PacedModel(rays, walk)
    weighted_solution = weighted_model.fit()
    weighted = weighted_model.room(weighted_solution)
    for name, target in weighted.targets.items():
        reason = room.targets[name].reason
        weighted.targets[name] = replace(target, reason=reason)
    return weighted


def _contradicting(rays: Sequence[TargetRay], walk: Walk, solution: Any, room: PacedRoom) -> str:
    """Return the lamp without which the others fit much better, or `""`.

    A wrong press bends the walk and the drift, so that its own residuals need not be the largest.
    """
    if len(room.places_m) < 2 or len(room.targets) < JUDGED:
        return ""
    gains: dict[str, float] = {}
    for name in room.targets:
        others = [ray for ray in rays if ray.target != name]
        if any(ray.place == SECOND for ray in others):
            without = PacedModel(others, walk).fit()
            gains[name] = 2.0 * float(solution.cost - without.cost)
    if not gains:
        return ""
    worst = max(gains, key=gains.__getitem__)
    return worst if gains[worst] > MIN_GAIN else ""


class PacedModel(PointingModel):
    """The unknowns of `PointingModel`, with the priors of a walk and of usual distances."""

    def __init__(self, rays: Sequence[TargetRay], walk: Walk) -> None:
        """Prepare the fit of the presses `rays`."""
        super().__init__(rays, hold_sigma_rad=PRESS_SIGMA_RAD, bias_sigma_rad=KNOWN_RAD)
        self._walk = walk
        self._second: int | None = None
        """Index of the unknowns of the second place: x, y, yaw; or None."""
        is_second = [ray.place == SECOND for ray in rays]
        if any(is_second):
            self._second = int(self.place[is_second.index(True)])
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
        usual = (distances_m - USUAL_M) / DISTANCE_SIGMA_M
        if self._second is None:
            return np.concatenate([fixed, usual])

        # The second place has the priors of a walk, in polar coordinates, instead of those of a known one.
        first_prior = self._second - (self.count - len(fixed))
        x, y, yaw_rad = values[self._second : self._second + 3]
        length_error_m = math.hypot(x, y) - walk.length_m
        azimuth_rad = math.atan2(y, x)
        azimuth_error_rad = math.remainder(azimuth_rad - walk.azimuth_rad, math.tau)
        fixed[first_prior] = length_error_m / walk.length_sigma_m
        fixed[first_prior + 1] = azimuth_error_rad / walk.azimuth_sigma_rad
        fixed[first_prior + 2] = yaw_rad / walk.drift_sigma_rad
        return np.concatenate([fixed, usual])

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
        return PacedRoom(targets=targets, places_m=places_m, drift_rad=drift_rad)

    def _direction_sigma_rad(self, values: Array, covariance: Array, number: int, share: float) -> float:
        """Return the standard deviation of the direction to a lamp from `share` of the walk."""
        first = 3 * number
        unknowns = [first, first + 1, first + 2]
        lamp_m = values[unknowns]
        eyes_m = self.origins[self._first_ray(number)]
        step_m = np.zeros(3)
        if self._second is not None:
            place = [self._second, self._second + 1]
            unknowns += place
            step_m[:2] = share * values[place]
        x, y, z = lamp_m - eyes_m - step_m
        level_m = max(math.hypot(x, y), NEAREST_M)
        range_m2 = level_m**2 + z**2

        # derivatives of azimuth (across the ray) and elevation by the lamp, then by the second place
        across = np.array([-y, x, 0.0]) / level_m / math.sqrt(range_m2)
        upwards = np.array([-x * z / level_m, -y * z / level_m, level_m]) / range_m2
        by_lamp = np.vstack([across, upwards])
        jacobian = by_lamp
        if self._second is not None:
            by_place = -share * by_lamp[:, :2]
            jacobian = np.hstack([by_lamp, by_place])
        own_covariance = covariance[np.ix_(unknowns, unknowns)]
        return _worst_sigma(jacobian @ own_covariance @ jacobian.T)

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
