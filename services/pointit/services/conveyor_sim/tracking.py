"""What a real tracker makes of the truth: noise, packages missed, reports lost in bursts, all of it late."""

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from pointit.geometry.polyline import Polyline
from pointit.schemas import NS_PER_S, TrackedObject, TrackedObjects
from pointit.services.conveyor_sim.config import TrackingConfig


class Tracker:
    """Turns exact reports into those of a tracker with the faults of its configuration, by a seed."""

    def __init__(self, config: TrackingConfig, lines: Mapping[str, Polyline], *, seed: int) -> None:
        """Know `lines` by the `surface_id` of what is on them."""
        self._config = config
        self._lines = lines
        self._random = np.random.default_rng([seed, 0x7261C])
        self._late: deque[TrackedObjects] = deque()
        self._is_lost = False
        self._seen_ns: int | None = None

    def report(self, exact: TrackedObjects) -> TrackedObjects | None:
        """Return what the tracker says when `exact` is so, with the stamp of what it says; none: nothing."""
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
        """Return True if this report is lost; bursts begin and end at random, the share is kept."""
        config = self._config
        chance = self._random.random()
        if self._seen_ns is None:
            self._is_lost = chance < config.dropout_share
        else:
            elapsed_s = max(0, now_ns - self._seen_ns) / NS_PER_S
            mixed = -math.expm1(-elapsed_s / (config.dropout_s * (1.0 - config.dropout_share)))
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
            update={
                "position_m": (x, y, z),
                "surface_position_m": tracked.surface_position_m + error_m,
            }
        )
