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


@dataclass(frozen=True)
class TargetRay:
    """A ray to a target, {W}.

    Attributes:
        target: name of what is pointed at. Corners of one thing have names of their own.
        person, place: names; the same for rays that share their errors.
        origin_m, direction: from the eyes, unit.
        place_sigma_m, heading_sigma_rad: of the person's pose.
    """

    target: str
    person: str
    place: str
    origin_m: Vec3
    direction: Vec3
    place_sigma_m: float = PLACE_SIGMA_M
    heading_sigma_rad: float = HEADING_SIGMA_RAD


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
    turn = from_yaw(pose.yaw_rad)
    mean = np.mean([ray.direction for ray in rays], axis=0)
    azimuth = math.atan2(mean[1], mean[0])
    elevation = math.asin(mean[2] / float(np.linalg.norm(mean)))
    elevation -= pose.elevation_bias_rad
    level = math.cos(elevation)
    held: Vec3 = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
    covariance = pose.covariance
    return TargetRay(
        target,
        person,
        place,
        add(pose.position_m, rotate(turn, rays[-1].origin_m)),
        normalized(rotate(turn, held)),
        math.sqrt(max(covariance[0], covariance[4], PLACE_SIGMA_M**2)),
        math.sqrt(max(covariance[8], HEADING_SIGMA_RAD**2)),
    )


def locate(rays: Sequence[TargetRay]) -> dict[str, PointedAt]:
    """Return the targets of `rays` by name.

    Raises:
        RefusedError: If there is no pointing.
    """
    if not rays:
        raise RefusedError("nobody has pointed at anything yet")
    model = PointingModel(rays)
    found: Any = least_squares(model.residuals, model.start())
    covariance = np.asarray(np.linalg.pinv(found.jac.T @ found.jac), dtype=np.float64)
    return model.targets(found.x, found.fun, covariance)


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
        self._targets = list(dict.fromkeys(each.target for each in rays))
        self._people = list(dict.fromkeys(each.person for each in rays))
        self._places = {(each.person, each.place): each for each in rays}
        keys = list(self._places)
        base = 3 * len(self._targets)
        self.target = np.array([3 * self._targets.index(each.target) for each in rays])
        self.person = np.array([base + 2 * self._people.index(each.person) for each in rays])
        base += 2 * len(self._people)
        self.place = np.array([base + 3 * keys.index((each.person, each.place)) for each in rays])
        self.count = base + 3 * len(keys)
        self.origins = np.array([each.origin_m for each in rays])
        self.directions = np.array([each.direction for each in rays])
        sigmas = [np.full(2 * len(self._people), bias_sigma_rad)]
        sigmas += [
            np.array([each.place_sigma_m, each.place_sigma_m, each.heading_sigma_rad])
            for each in self._places.values()
        ]
        self._prior_sigmas = np.concatenate(sigmas)

    def start(self) -> Array:
        """Return the points nearest to each target's rays, without errors of people and places."""
        values = np.zeros(self.count)
        across = np.eye(3) - self.directions[:, :, None] * self.directions[:, None, :]
        for number in range(len(self._targets)):
            own = self.target == 3 * number
            middle = (self.origins[own] + START_M * self.directions[own]).mean(axis=0)
            matrix = across[own].sum(axis=0) + 1e-3 * np.eye(3)
            moment = np.einsum("nij,nj->i", across[own], self.origins[own]) + 1e-3 * middle
            values[3 * number : 3 * number + 3] = np.linalg.solve(matrix, moment)
        return values

    def residuals(self, values: Array) -> Array:
        """Return weighted residuals: azimuths, elevations, priors."""
        point = values[self.target[:, None] + np.arange(3)]
        origin = self.origins.copy()
        origin[:, :2] += values[self.place[:, None] + np.arange(2)]
        x, y, z = (point - origin).T
        measured_az = np.arctan2(self.directions[:, 1], self.directions[:, 0])
        measured_el = np.arcsin(np.clip(self.directions[:, 2], -1.0, 1.0))
        off_az = np.arctan2(y, x) + values[self.person] + values[self.place + 2] - measured_az
        off_az = (off_az + np.pi) % (2 * np.pi) - np.pi
        off_el = np.arctan2(z, np.maximum(np.hypot(x, y), NEAREST_M)) + values[self.person + 1] - measured_el
        level = np.cos(measured_el)  # an azimuth error of a steep ray is a smaller angle
        sigma_rad = self._hold_sigma_rad
        return np.concatenate([off_az * level / sigma_rad, off_el / sigma_rad, self.priors(values)])

    def priors(self, values: Array) -> Array:
        """Return the weighted residuals of the unknowns of people and places."""
        return values[self.count - len(self._prior_sigmas) :] / self._prior_sigmas

    def targets(self, values: Array, residuals: Array, covariance: Array) -> dict[str, PointedAt]:
        """Return the targets with their notes."""
        count = len(self._all)
        targets: dict[str, PointedAt] = {}
        for number, name in enumerate(self._targets):
            part = slice(3 * number, 3 * number + 3)
            own = np.flatnonzero(self.target == part.start)
            position = values[part]
            sights = position - self.origins[own]
            sights /= np.maximum(np.linalg.norm(sights, axis=1, keepdims=True), 1e-9)
            angle = float(np.arccos(np.clip((sights @ sights.T).min(), -1.0, 1.0)))
            left = np.concatenate([residuals[own], residuals[count + own]]) * self._hold_sigma_rad
            sigma_m = float(np.sqrt(max(np.linalg.eigvalsh(covariance[part, part])[-1], 0.0)))
            places = len(set(self.place[own].tolist()))
            behind = bool(np.any(np.sum(sights * self.directions[own], axis=1) < 0))
            reason = _reason(places, angle, float(np.sqrt(np.mean(left**2))), is_behind=behind)
            targets[name] = PointedAt(vec3(position), sigma_m, places, reason)
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
    (ax, ay), (bx, by) = np.diff(points[:3, :2], axis=0).tolist()
    first = math.atan2(ay, ax)
    second = math.atan2(by, bx)
    # both sides of the top say where it is turned to, up to right angles: the longer one counts more
    sides = ((math.hypot(ax, ay), first), (math.hypot(bx, by), second))
    sine = sum(length * math.sin(4.0 * angle) for length, angle in sides)
    yaw = math.atan2(sine, sum(length * math.cos(4.0 * angle) for length, angle in sides)) / 4.0
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    turned = points[:, :2] @ turn.T
    low = np.append(turned.min(axis=0), points[:, 2].min())
    high = np.append(turned.max(axis=0), points[:, 2].max())
    if float((high - low).min()) < MIN_SIDE_M:
        raise RefusedError(refusal)
    centre = (low + high) / 2.0
    centre[:2] = centre[:2] @ turn
    return BoxEntry.model_validate(
        {
            "center": [round(float(v), 3) for v in centre],
            "size": [round(float(v), 3) for v in high - low],
            "yaw_deg": round(math.degrees(yaw), 1),
        }
    )


def screen_of(corners: Sequence[Vec3]) -> PlaneEntry:
    """Return the plane through `corners`, three or four of a screen or a table; its normal is up or aside.

    Raises:
        RefusedError: If they are fewer than three or in one line.
    """
    points = np.array(corners, dtype=np.float64).reshape(-1, 3)
    if len(points) < 3:
        raise RefusedError("a screen or table needs three corners or four")
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    _, sizes, axes = np.linalg.svd(points - points.mean(axis=0))
    if sizes[1] < 0.05:
        raise RefusedError("these corners are in one line: point at three corners of it")

    # A table is level and a screen upright, if they nearly are.
    upward = 1.0 if axes[2][2] >= 0 else -1.0
    normal = axes[2] * upward
    if abs(normal[2]) > math.cos(math.radians(20.0)):
        normal = np.array([0.0, 0.0, 1.0])
    elif abs(normal[2]) < math.sin(math.radians(20.0)):
        normal = np.array([normal[0], normal[1], 0.0]) / math.hypot(normal[0], normal[1])
    extents = [float(np.ptp(points @ np.array(axis))) for axis in plane_axes(vec3(normal))]
    center = [round(float(coordinate), 3) for coordinate in middle]
    rounded_normal = [round(float(coordinate), 4) for coordinate in normal]
    size = [round(max(extent, 0.01), 3) for extent in extents]
    return PlaneEntry.model_validate({"center": center, "normal": rounded_normal, "size": size})
