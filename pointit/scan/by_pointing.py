"""Positions of lamps, corners and tables by pointing at them from two or three places.

Each press gives a ray in the room. Rays of one person share an error of azimuth and elevation, rays of one
place share an error of position and heading; all are estimated with the targets (least squares with priors).
The covariance says how well a target is known.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from pointit.geometry.array_types import Array
from pointit.geometry.rotation import from_yaw, rotate
from pointit.geometry.solids import plane_axes
from pointit.geometry.vector import Vec3, add, normalized
from pointit.maps.model import BoxEntry, PlaneEntry
from pointit.runtime.errors import RefusedError
from pointit.scan.bundle import vec3
from pointit.schemas import PointingRay, UserPose

HOLD_SIGMA_RAD = math.radians(1.5)
"""Standard deviation of one ray beside the others of the person, per axis."""
BIAS_SIGMA_RAD = math.radians(4.0)
"""Standard deviation of people's common error, per axis."""
PLACE_SIGMA_M = 0.05
"""Standard deviation of a person's position, per axis, unless their pose says another one."""
HEADING_SIGMA_RAD = math.radians(1.0)
"""The same of the heading."""
MIN_ANGLE_RAD = math.radians(60.0)
"""Angle between two rays from which two places suffice."""
RESIDUAL = 2.2
"""Rms error of a target's rays, in those of one ray, from which they do not meet."""
START_M = 2.0
NEAREST_M = 0.2
MIN_SIDE_M = 0.02
"""Smallest side of a box, m."""
NEARLY_RAD = math.radians(20.0)
"""Angle within which a table counts as level, or a screen as upright."""


@dataclass(frozen=True)
class TargetRay:
    """A ray to a target, {W}.

    Attributes:
        target: name of what is pointed at. Corners of one thing have names of their own.
        person, place: names; the same for rays that share their errors.
        origin_m, direction: from the eyes, unit.
        place_sigma_m, heading_sigma_rad: of the person's pose.
        azimuth_sigma_rad: of this ray's azimuth beside others of the person, or None for that of the model.
        elevation_sigma_rad: the same of its elevation.
    """

    target: str
    person: str
    place: str
    origin_m: Vec3
    direction: Vec3
    place_sigma_m: float = PLACE_SIGMA_M
    heading_sigma_rad: float = HEADING_SIGMA_RAD
    azimuth_sigma_rad: float | None = None
    elevation_sigma_rad: float | None = None


@dataclass(frozen=True)
class PointedAt:
    """A target.

    Attributes:
        sigma_m: standard deviation in the worst direction.
        places: number of places.
        reason: why it needs one more place, or `""`.
    """

    position_m: Vec3
    sigma_m: float
    places: int
    reason: str = ""


def pointing_of(
    target: str, person: str, place: str, rays: Sequence[PointingRay], pose: UserPose
) -> TargetRay:
    """Return the pointing of a person with `pose` who held `rays`, at least one, on `target`."""
    # The held direction in the person's frame {H}, without the elevation bias
    mean = np.mean([ray.direction for ray in rays], axis=0)
    azimuth = math.atan2(mean[1], mean[0])
    sine = mean[2] / float(np.linalg.norm(mean))
    elevation = math.asin(sine) - pose.elevation_bias_rad
    level = math.cos(elevation)
    x = level * math.cos(azimuth)
    y = level * math.sin(azimuth)
    held: Vec3 = (x, y, math.sin(elevation))

    # From {H} into the room, no more certain than a person's usual pose
    turn = from_yaw(pose.yaw_rad)
    eyes_m = rotate(turn, rays[-1].origin_m)
    covariance = pose.covariance
    place_variance = max(covariance[0], covariance[4], PLACE_SIGMA_M**2)
    heading_variance = max(covariance[8], HEADING_SIGMA_RAD**2)
    return TargetRay(
        target,
        person,
        place,
        origin_m=add(pose.position_m, eyes_m),
        direction=normalized(rotate(turn, held)),
        place_sigma_m=math.sqrt(place_variance),
        heading_sigma_rad=math.sqrt(heading_variance),
    )


def locate(rays: Sequence[TargetRay]) -> dict[str, PointedAt]:
    """Return the targets of `rays` by name.

    Raises:
        RefusedError: If there is no pointing.
    """
    if not rays:
        raise RefusedError("nobody has pointed at anything yet")
    model = PointingModel(rays)
    solution: Any = least_squares(model.residuals, model.start())
    information = solution.jac.T @ solution.jac
    covariance = np.asarray(np.linalg.pinv(information), dtype=np.float64)
    return model.targets(solution.x, solution.fun, covariance)


class PointingModel:
    """Unknowns: three of each target, then two of each person (azimuth, elevation), three of each place."""

    def __init__(
        self,
        rays: Sequence[TargetRay],
        *,
        hold_sigma_rad: float = HOLD_SIGMA_RAD,
        bias_sigma_rad: float = BIAS_SIGMA_RAD,
    ) -> None:
        """Prepare the fit of `rays`, at least one."""
        self._all = rays
        self._hold_sigma_rad = hold_sigma_rad
        self._targets = list(dict.fromkeys(ray.target for ray in rays))
        people = list(dict.fromkeys(ray.person for ray in rays))
        places = {(ray.person, ray.place): ray for ray in rays}
        place_keys = list(places)

        # The first unknown of each ray's target, person and place
        first_person = 3 * len(self._targets)
        first_place = first_person + 2 * len(people)
        target_numbers = [self._targets.index(ray.target) for ray in rays]
        person_numbers = [people.index(ray.person) for ray in rays]
        place_numbers = [place_keys.index((ray.person, ray.place)) for ray in rays]
        self.target = 3 * np.array(target_numbers)
        self.person = first_person + 2 * np.array(person_numbers)
        self.place = first_place + 3 * np.array(place_numbers)
        self.count = first_place + 3 * len(places)
        self.origins = np.array([ray.origin_m for ray in rays])
        self.directions = np.array([ray.direction for ray in rays])
        azimuth_sigmas_rad = [ray.azimuth_sigma_rad or hold_sigma_rad for ray in rays]
        elevation_sigmas_rad = [ray.elevation_sigma_rad or hold_sigma_rad for ray in rays]
        self._azimuth_sigmas_rad = np.array(azimuth_sigmas_rad)
        self._elevation_sigmas_rad = np.array(elevation_sigmas_rad)

        # Targets have no prior. If the rays of a place differ in theirs, the last one counts.
        prior_sigmas = [np.full(2 * len(people), bias_sigma_rad)]
        for ray in places.values():
            place_sigmas = [ray.place_sigma_m, ray.place_sigma_m, ray.heading_sigma_rad]
            prior_sigmas.append(np.array(place_sigmas))
        self._prior_sigmas = np.concatenate(prior_sigmas)

    def start(self) -> Array:
        """Return the points nearest to each target's rays, without errors of people and places."""
        values = np.zeros(self.count)
        directions = self.directions
        outer_products = directions[:, :, None] * directions[:, None, :]
        across = np.eye(3) - outer_products
        for number in range(len(self._targets)):
            is_own = self.target == 3 * number
            origins = self.origins[is_own]
            usual_points = origins + START_M * self.directions[is_own]
            middle = usual_points.mean(axis=0)

            # Parallel rays have no nearest point: the middle counts a little, as a prior.
            matrix = across[is_own].sum(axis=0) + 1e-3 * np.eye(3)
            moment = np.einsum("nij,nj->i", across[is_own], origins)
            moment = moment + 1e-3 * middle
            part = slice(3 * number, 3 * number + 3)
            values[part] = np.linalg.solve(matrix, moment)
        return values

    def residuals(self, values: Array) -> Array:
        """Return weighted residuals: azimuths, elevations, priors."""
        # Angles to the targets from the estimated places
        point = values[self.target[:, None] + np.arange(3)]
        origin = self.origins.copy()
        place_unknowns = self.place[:, None] + np.arange(2)
        origin[:, :2] += values[place_unknowns]
        x, y, z = (point - origin).T
        level_m = np.maximum(np.hypot(x, y), NEAREST_M)
        azimuth = np.arctan2(y, x)
        elevation = np.arctan2(z, level_m)

        # Errors of the measured ones beside them, with those of the person and of the place's heading
        direction_x, direction_y, direction_z = self.directions.T
        measured_azimuth = np.arctan2(direction_y, direction_x)
        measured_elevation = np.arcsin(np.clip(direction_z, -1.0, 1.0))
        azimuth_bias = values[self.person]
        elevation_bias = values[self.person + 1]
        heading_error = values[self.place + 2]
        azimuth_error = azimuth + azimuth_bias + heading_error - measured_azimuth
        azimuth_error = (azimuth_error + np.pi) % (2 * np.pi) - np.pi
        elevation_error = elevation + elevation_bias - measured_elevation

        level = np.cos(measured_elevation)  # an azimuth error of a steep ray is a smaller angle
        across = azimuth_error * level / self._azimuth_sigmas_rad
        upwards = elevation_error / self._elevation_sigmas_rad
        return np.concatenate([across, upwards, self.priors(values)])

    def priors(self, values: Array) -> Array:
        """Return the weighted residuals of the unknowns of people and places."""
        first = self.count - len(self._prior_sigmas)
        return values[first:] / self._prior_sigmas

    def targets(self, values: Array, residuals: Array, covariance: Array) -> dict[str, PointedAt]:
        """Return the targets with their notes."""
        count = len(self._all)
        targets: dict[str, PointedAt] = {}
        for number, name in enumerate(self._targets):
            part = slice(3 * number, 3 * number + 3)
            own = np.flatnonzero(self.target == part.start)
            places = set(self.place[own].tolist())
            position = values[part]
            worst_variance = np.linalg.eigvalsh(covariance[part, part])[-1]
            sigma_m = float(np.sqrt(max(worst_variance, 0.0)))

            # The largest angle between two of its rays, and whether it is behind a person
            sights = position - self.origins[own]
            distances = np.linalg.norm(sights, axis=1, keepdims=True)
            sights /= np.maximum(distances, 1e-9)
            cosines = sights @ sights.T
            angle_rad = float(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
            along_rays = np.sum(sights * self.directions[own], axis=1)
            is_behind = bool(np.any(along_rays < 0))

            # Residuals are all azimuths, then all elevations.
            own_residuals = np.concatenate([residuals[own], residuals[count + own]])
            errors_rad = own_residuals * self._hold_sigma_rad
            rms_rad = float(np.sqrt(np.mean(errors_rad**2)))
            reason = _reason(len(places), angle_rad, rms_rad, is_behind=is_behind)
            targets[name] = PointedAt(vec3(position), sigma_m, len(places), reason)
        return targets


def _reason(places: int, angle_rad: float, residual_rad: float, *, is_behind: bool) -> str:
    if places < 2:
        return "pointed at from one place only: point at it from a second one"
    if is_behind:
        return "the rays do not meet in front of the person: was it another thing? Point at it once more"
    if residual_rad > RESIDUAL * HOLD_SIGMA_RAD:
        return "the rays do not meet: was it another thing? Point at it from a third place"
    if places == 2 and angle_rad < MIN_ANGLE_RAD:
        return (
            f"the two places are {math.degrees(angle_rad):.0f} degrees apart as seen from it, 60 are enough: "
            "point at it from a third place"
        )
    return ""


def box_of(corners: Sequence[Vec3]) -> BoxEntry:
    """Return the upright box through three corners of its top, one after the other, and others below.

    Raises:
        RefusedError: If they span no volume.
    """
    points = np.array(corners, dtype=np.float64).reshape(-1, 3)
    refusal = "these corners span no box: point at three corners of its top, and one at its foot"
    if len(points) < 4:
        raise RefusedError(refusal)

    # Both sides of the top say where it is turned to, up to right angles: the longer one counts more.
    sine = 0.0
    cosine = 0.0
    top = points[:3, :2]
    sides: list[list[float]] = np.diff(top, axis=0).tolist()
    for x, y in sides:
        length = math.hypot(x, y)
        angle = math.atan2(y, x)
        sine += length * math.sin(4.0 * angle)
        cosine += length * math.cos(4.0 * angle)
    yaw = math.atan2(sine, cosine) / 4.0

    # The extent of the corners in the box's frame
    c = math.cos(yaw)
    s = math.sin(yaw)
    turn = np.array([[c, s], [-s, c]])
    turned = points[:, :2] @ turn.T
    heights = points[:, 2]
    low = np.append(turned.min(axis=0), heights.min())
    high = np.append(turned.max(axis=0), heights.max())
    size = high - low
    if float(size.min()) < MIN_SIDE_M:
        raise RefusedError(refusal)
    centre = (low + high) / 2.0
    centre[:2] = centre[:2] @ turn
    entry = {
        "center": _rounded(centre, digits=3),
        "size": _rounded(size, digits=3),
        "yaw_deg": round(math.degrees(yaw), 1),
    }
    return BoxEntry.model_validate(entry)


def _rounded(values: Array, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]


def screen_of(corners: Sequence[Vec3]) -> PlaneEntry:
    """Return the plane through `corners`, three or four of a screen or a table; its normal is up or aside.

    Raises:
        RefusedError: If they are fewer than three or in one line.
    """
    points = np.array(corners, dtype=np.float64).reshape(-1, 3)
    if len(points) < 3:
        raise RefusedError("a screen or table needs three corners or four")
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    centred = points - points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred)
    if sizes[1] < 0.05:
        raise RefusedError("these corners are in one line: point at three corners of it")

    # A table is level and a screen upright, if they nearly are.
    upward = 1.0 if axes[2][2] >= 0 else -1.0
    normal = axes[2] * upward
    x, y, z = normal
    if abs(z) > math.cos(NEARLY_RAD):
        normal = np.array([0.0, 0.0, 1.0])
    elif abs(z) < math.sin(NEARLY_RAD):
        normal = np.array([x, y, 0.0]) / math.hypot(x, y)

    size: list[float] = []
    for axis in plane_axes(vec3(normal)):
        extent = float(np.ptp(points @ np.array(axis)))
        size.append(round(max(extent, 0.01), 3))
    entry = {
        "center": _rounded(middle, digits=3),
        "normal": _rounded(normal, digits=4),
        "size": size,
    }
    return PlaneEntry.model_validate(entry)
