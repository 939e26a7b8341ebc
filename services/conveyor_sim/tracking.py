"""Packages as a perfect tracker reports them, and as one with latency does."""

from collections import deque
from collections.abc import Callable

import numpy as np

from pointit.schemas import FARTHEST, NS_PER_S, TrackedObject, TrackedObjects
from pointit.services.conveyor_sim.config import TrackingConfig
from pointit.services.conveyor_sim.traffic import Package, Traffic


class PackageTracker:
    """Delays exact reports as configured."""

    def __init__(self, config: TrackingConfig) -> None:
        self._latency_ns = round(config.latency_s * NS_PER_S)
        self._late: deque[TrackedObjects] = deque()

    def report(self, exact: TrackedObjects) -> TrackedObjects | None:
        """Return the tracker's report when `exact` is the truth, with its stamp, or None if there is none."""
        self._late.append(exact)
        report: TrackedObjects | None = None
        while self._late and self._late[0].stamp_ns <= exact.stamp_ns - self._latency_ns:
            report = self._late.popleft()
        return report


def ground_truth_objects(traffic: Traffic, until_ns: Callable[[Package], int | None]) -> list[TrackedObject]:
    """Return every package of `traffic`, belt by belt, with exact positions and speeds.

    `until_ns` returns the time until which the bay of a package can be changed, None without limit.
    """
    objects: list[TrackedObject] = []
    for parts in traffic.network.parts:
        packages: list[Package] = []
        for part in parts:
            packages += traffic.held[part.index]
        if not packages:
            continue

        # Positions and velocities of all packages of a section together
        piece = parts[0]  # lines and positions are those of the whole section
        line = piece.line
        along_m = np.array([piece.start_m + package.offset_m for package in packages])
        segments = np.searchsorted(line.starts_m, along_m, side="right") - 1
        segments = np.clip(segments, 0, len(line.tangents) - 1)
        speeds_mps = np.array([package.speed_mps for package in packages])
        velocities = (line.tangents[segments] * speeds_mps[:, None]).tolist()
        points = np.clip(line.points_at(along_m), -FARTHEST, FARTHEST).tolist()  # against rounding

        # On a bridge they belong to one of its belts, or to none
        for package, (x, y, z), (vx, vy, vz) in zip(packages, points, velocities, strict=True):
            belt, position_m = piece.place(package.offset_m)
            tracked_object = TrackedObject(
                id=package.id,
                kind=package.kind,
                position_m=(x, y, z),
                velocity_mps=(vx, vy, vz),
                length_m=package.length_m,
                surface=traffic.network.surface if belt else "none",
                surface_id=belt,
                surface_position_m=position_m,
                surface_speed_mps=package.speed_mps,
                bay=package.bay,
                bay_until_ns=until_ns(package),
            )
            objects.append(tracked_object)
    return objects
