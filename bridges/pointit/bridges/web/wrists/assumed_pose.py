"""A person's pose while none is known: configured, or near the middle of the map."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from pointit.bridges.web.config import Place
from pointit.geometry.vector import Vec3
from pointit.schemas import Environment, Localization, UserPose

Stand = tuple[Vec3, float]
"""Feet in {W}, m, and the azimuth of {H}'s x axis in {W}, rad."""

CLEAR_M = 2.0
"""Distance from the nearest object for a person placed automatically, m."""
_STEP_M = 0.25
_TOO_NEAR = 3.0
"""Weight: a metre too close to an object counts as this many metres away from the middle."""


def places(room: Environment) -> NDArray[np.float64]:
    """Return points on all things of `room`, n x 3, {W}, m: vertices of lines, middles of solids."""
    lines = [*(strip.line_m for strip in room.strips), *(belt.line_m for belt in room.belts)]
    found = [point for line in lines for point in _along(line)]
    found += [lamp.position_m for lamp in room.lamps]
    found += [box.center_m for box in (*room.boxes, *room.fixed_things)]
    found += [cylinder.center_m for cylinder in room.cylinders]
    found += [sphere.center_m for sphere in room.spheres]
    found += [plane.center_m for plane in room.planes if plane.size_m is not None]
    found += [corner for cloud in room.clouds for corner in (cloud.low_m, cloud.high_m)]
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def middle(room: Environment) -> Vec3:
    """Return the middle of all things, {W}, m. In an empty room: 2 m ahead of the origin."""
    points = places(room)
    if not len(points):
        return (CLEAR_M, 0.0, 1.0)
    x, y, z = ((points.min(axis=0) + points.max(axis=0)) / 2.0).tolist()
    return (x, y, z)


def choose_pose(room: Environment) -> Stand:
    """Return a pose near the middle of `room`, `CLEAR_M` away from its objects, facing the middle.

    In a room too small for both, the position moves towards the middle, not through the walls.
    """
    points = places(room)[:, :2]
    if not len(points):
        return ((0.0, 0.0, 0.0), 0.0)
    low, high = points.min(axis=0), points.max(axis=0)
    center = (low + high) / 2.0
    columns, rows = (
        np.arange(a - CLEAR_M - 0.5, b + CLEAR_M + 0.75, _spacing(low, high))
        for a, b in zip(low, high, strict=True)
    )
    grid = np.vstack([center, np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)])
    clear_m = [_clear_m(points, center[:1], center[1:]), _clear_m(points, columns, rows)]
    too_near_m = CLEAR_M - np.concatenate([each.ravel() for each in clear_m])
    cost = np.hypot(*(grid - center).T) + _TOO_NEAR * too_near_m
    x, y = grid[int(np.argmin(cost))].tolist()
    ahead = (center - (x, y)).tolist()
    yaw_rad = math.atan2(ahead[1], ahead[0]) if math.hypot(*ahead) > 0.1 else 0.0
    return ((x, y, 0.0), yaw_rad)


class AssumedPose:
    """One person's pose, from messages on the bus."""

    def __init__(self, place: Place | None = None) -> None:
        """Use `place` of the configuration while no pose is known."""
        self._place = None if place is None else (place.position_m, math.radians(place.yaw_deg))
        self._in_room: Stand = ((0.0, 0.0, 0.0), 0.0)
        self._pose: Stand | None = None
        self._truth: Stand | None = None
        """Pose when the localization began, or None outside a localization."""

    @property
    def at(self) -> Stand:
        """Return the person's true pose.

        During a localization that is the pose when it began, so that a localization by the mouse has a true
        value to find. Otherwise it is the newest pose.
        """
        return self._truth or self._known

    @property
    def assumed(self) -> Stand | None:
        """Return the configured pose while no pose is known, else None."""
        return self._place if self._pose is None else None

    def room(self, stand: Stand) -> None:
        """Set the pose of a person without any other, see `choose_pose`."""
        self._in_room = stand

    def pose(self, pose: UserPose) -> None:
        """Update from a pose."""
        self._pose = (pose.position_m, pose.yaw_rad)

    def localization(self, progress: Localization) -> None:
        """Update from the progress of a localization."""
        if progress.phase != "sampling" or progress.purpose != "pose":
            self._truth = None
        elif self._truth is None:
            self._truth = self._known

    @property
    def _known(self) -> Stand:
        return self._pose or self._place or self._in_room


def _along(line: tuple[Vec3, ...]) -> list[Vec3]:
    """Return the vertices of `line` and, in long segments, points in between."""
    found = [line[0]]
    for a, b in itertools.pairwise(line):
        parts = min(64, max(1, math.ceil(math.dist(a, b) / 0.5)))
        for k in range(1, parts + 1):
            s = k / parts
            found.append((a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2])))
    return found


def _clear_m(
    points: NDArray[np.float64], columns: NDArray[np.float64], rows: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance of each grid point to the nearest point, `CLEAR_M` at most, rows x columns, m.

    Not SciPy's k-d tree: loading it takes as long as loading the rest of the page.
    """
    clear_m = np.full((len(rows), len(columns)), CLEAR_M)
    reach_m = (-CLEAR_M, CLEAR_M)
    lefts_rights = np.searchsorted(columns, points[:, :1] + reach_m).tolist()
    lows_highs = np.searchsorted(rows, points[:, 1:] + reach_m).tolist()
    for (x, y), (left, right), (low, high) in zip(points.tolist(), lefts_rights, lows_highs, strict=True):
        near = clear_m[low:high, left:right]
        np.minimum(near, np.hypot(columns[left:right] - x, rows[low:high, np.newaxis] - y), out=near)
    return clear_m


def _spacing(low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Return the grid's step, m; coarser in a huge room."""
    return max(_STEP_M, float((high - low).max()) / 100.0)
