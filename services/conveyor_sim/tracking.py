"""Packages as a perfect tracker reports them, and as one does with noise, misses, lost reports, latency."""

import math
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

from pointit.geometry.polyline import Polyline
from pointit.schemas import FARTHEST, NS_PER_S, TrackedObject, TrackedObjects
from pointit.services.conveyor_sim.config import TrackingConfig
from pointit.services.conveyor_sim.traffic import Package, Traffic

DROPOUT_S = 0.4
"""Mean length of a burst of lost reports, s."""


class PackageTracker:
    """Adds the configured faults to exact reports, reproducibly by a seed."""

    def __init__(self, config: TrackingConfig, lines: Mapping[str, Polyline], *, seed: int) -> None:
        """Create a tracker of objects on `lines`, which are named by `surface_id`."""
        self._config = config
        self._lines = lines
        self._random = np.random.default_rng([seed, 0x7261C])
        self._late: deque[TrackedObjects] = deque()
        self._is_lost = False
        self._seen_ns: int | None = None

    def report(self, exact: TrackedObjects) -> TrackedObjects | None:
        """Return the tracker's report for the exact one, with its stamp, or None if there is none."""
        config = self._config
        report: TrackedObjects | None = exact
        if config.latency_s:
            self._late.append(exact)
            report = None
            while self._late and self._late[0].stamp_ns <= exact.stamp_ns - config.latency_s * NS_PER_S:
                report = self._late.popleft()
        if config.dropout_share and self._loses(exact.stamp_ns):
            return None
        if report is None or not (config.noise_m or config.missed_share):
            return report
        seen = self._random.random(len(report.objects)) >= config.missed_share
        errors_m = self._random.normal(0.0, config.noise_m, len(report.objects)).tolist()
        objects = tuple(
            self._displaced(tracked, error_m) if config.noise_m else tracked
            for tracked, is_seen, error_m in zip(report.objects, seen, errors_m, strict=True)
            if is_seen
        )
        return report.model_copy(update={"objects": objects})

    def _loses(self, now_ns: int) -> bool:
        """Return True if this report is lost; bursts begin and end at random with the configured share."""
        config = self._config
        chance = self._random.random()
        if self._seen_ns is None:
            self._is_lost = chance < config.dropout_share
        else:
            elapsed_s = max(0, now_ns - self._seen_ns) / NS_PER_S
            mixed = -math.expm1(-elapsed_s / (DROPOUT_S * (1.0 - config.dropout_share)))
            stays = self._is_lost and chance >= mixed
            self._is_lost = stays or (
                self._random.random() < config.dropout_share if chance < mixed else self._is_lost
            )
        self._seen_ns = now_ns
        return self._is_lost

    def _displaced(self, tracked: TrackedObject, error_m: float) -> TrackedObject:
        line = self._lines.get(tracked.surface_id)
        if line is None:
            return tracked
        along = line.tangent_at(min(max(tracked.surface_position_m, 0.0), line.length_m))
        x, y, z = (p + error_m * direction for p, direction in zip(tracked.position_m, along, strict=True))
        return tracked.model_copy(
            update={"position_m": (x, y, z), "surface_position_m": tracked.surface_position_m + error_m}
        )


def ground_truth_objects(traffic: Traffic, until_ns: Callable[[Package], int | None]) -> list[TrackedObject]:
    """Return every package of `traffic`, belt by belt, with exact positions and speeds.

    `until_ns` returns the time until which the bay of a package can be changed, None without limit.
    """
    objects: list[TrackedObject] = []
    for parts in traffic.network.parts:
        held = [package for part in parts for package in traffic.held[part.index]]
        if not held:
            continue
        piece = parts[0]  # lines and positions are those of the whole section
        line = piece.line
        along_m = np.array([piece.start_m + package.offset_m for package in held])
        segments = np.clip(
            np.searchsorted(line.starts_m, along_m, side="right") - 1, 0, len(line.tangents) - 1
        )
        speeds_mps = np.array([package.speed_mps for package in held])
        velocities = (line.tangents[segments] * speeds_mps[:, None]).tolist()
        points = np.clip(line.points_at(along_m), -FARTHEST, FARTHEST).tolist()  # against rounding
        for package, point, velocity in zip(held, points, velocities, strict=True):
            belt, position_m = piece.place(package.offset_m)
            objects.append(
                TrackedObject(
                    id=package.id,
                    kind=package.kind,
                    position_m=(point[0], point[1], point[2]),
                    velocity_mps=(velocity[0], velocity[1], velocity[2]),
                    length_m=package.length_m,
                    surface=traffic.network.surface if belt else "none",
                    surface_id=belt,
                    surface_position_m=position_m,
                    surface_speed_mps=package.speed_mps,
                    bay=package.bay,
                    bay_until_ns=until_ns(package),
                )
            )
    return objects
