"""Rays and moving targets brought together by the time of their capture, whenever they arrive."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from pointit.schemas import NS_PER_S, PointingRay
from pointit.schemas.base import Vec3
from pointit.services.localizer.estimation import rays as ray_math
from pointit.services.localizer.estimation.angular_residuals import Array
from pointit.services.localizer.estimation.estimator import Pointings, SolverSettings

Stamps = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_GAP_S = 0.5
"""Between two reports of a target further apart in time, its place is not known."""

LEAST_HZ = 3.0
"""Rate of reports that keeps them closer than `MAX_GAP_S`, with some jitter."""

AHEAD_S, BEHIND_S = 0.5, 1.0
"""Reports stamped so much later or earlier than the rays of the same moment: the clocks differ."""

MAX_RAYS = 8192
"""A window holds no more, whatever the rate."""


class RayWindow:
    """The rays of the last `window_s`."""

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._rays: deque[PointingRay] = deque(maxlen=MAX_RAYS)
        self._made: tuple[tuple[int, int], tuple[Stamps, Array, Array]] | None = None

    def __len__(self) -> int:
        """Return the number of rays."""
        return len(self._rays)

    @property
    def newest_ns(self) -> int:
        """Return the newest ray's stamp; -1 when there is none."""
        return self._rays[-1].stamp_ns if self._rays else -1

    def add(self, ray: PointingRay) -> None:
        """Take `ray` unless it is older than one already taken; forget what left the window.

        A whole window back, the clock was set: it begins anew.
        """
        if ray.stamp_ns < self.newest_ns - self._window_ns:
            self._rays.clear()
        if ray.stamp_ns <= self.newest_ns:
            return
        self._rays.append(ray)
        while self._rays[0].stamp_ns < ray.stamp_ns - self._window_ns:
            self._rays.popleft()

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return when the oldest ray was captured, and when the middle one was; -1 when there is none."""
        rays = self._rays
        return (rays[0].stamp_ns, rays[len(rays) // 2].stamp_ns) if rays else (-1, -1)

    def believed(self, trust: SolverSettings) -> SolverSettings:
        """Return `trust` with what a calibration of the person says; see `rays.believed`."""
        return ray_math.believed(trust, self._rays)

    def pointings(self, track: "Track") -> Pointings:
        """Return the rays with the place of `track` at the time of each; those without one are left out."""
        stamps, origins, directions = self._arrays()
        targets, known = track.at(stamps)
        stamps = stamps[known]
        return Pointings(
            (stamps - stamps[:1]).astype(np.float64) / NS_PER_S,
            origins[known],
            directions[known],
            targets[known],
        )

    def _arrays(self) -> tuple[Stamps, Array, Array]:
        """Return stamps (n), origins and directions (n x 3); made once for all tracks."""
        key = (self.newest_ns, len(self._rays))
        if self._made is None or self._made[0] != key:
            stamps = np.array([ray.stamp_ns for ray in self._rays], dtype=np.int64)
            arrays = (stamps, ray_math.origins(self._rays), ray_math.directions(self._rays))
            self._made = (key, arrays)
        return self._made[1]


class Track:
    """Where one target was during the last `window_s`."""

    def __init__(self, window_s: float) -> None:
        self._window_ns = round((window_s + 2.0 * MAX_GAP_S) * NS_PER_S)
        self._places: deque[tuple[int, Vec3]] = deque(maxlen=MAX_RAYS)
        self.latency_sigma_s: float | None = None
        """As the newest report states it; None if it does not."""
        self.is_reported = False
        """Whether a report came since this was last set to False."""

    @property
    def newest_ns(self) -> int:
        """Return the newest report's stamp; -1 when there is none."""
        return self._places[-1][0] if self._places else -1

    def add(self, stamp_ns: int, position_m: Vec3, latency_sigma_s: float | None = None) -> None:
        """Take the place at `stamp_ns` unless it is older than one already taken; see `RayWindow.add`."""
        if stamp_ns < self.newest_ns - self._window_ns:
            self._places.clear()
        if stamp_ns <= self.newest_ns:
            return
        self.is_reported = True
        self._places.append((stamp_ns, position_m))
        self.latency_sigma_s = latency_sigma_s
        while self._places[0][0] < stamp_ns - self._window_ns:
            self._places.popleft()

    def fault(self, robot: str, tracker: str, ray_ns: int) -> str:
        """Return what is wrong with the reports, one sentence, or "" if nothing is.

        Args:
            robot: its id.
            tracker: the tracker's name.
            ray_ns: stamp of the newest ray.
        """
        stamps = [stamp for stamp, _ in self._places]
        gap_s = float(np.median(np.diff(stamps))) / NS_PER_S if len(stamps) > 2 else 0.0
        if gap_s > 0.9 * MAX_GAP_S:
            return (
                f"robot {robot} is reported by tracker {tracker} at {1.0 / gap_s:.1f} Hz and at least "
                f"{LEAST_HZ:g} Hz are needed; set the tracker to a higher rate"
            )
        ahead_s = (self.newest_ns - ray_ns) / NS_PER_S
        if ahead_s > AHEAD_S or (ahead_s < -BEHIND_S and self.is_reported):
            way = "ahead of" if ahead_s > 0.0 else "behind"
            return (
                f"the clock of tracker {tracker} is {abs(ahead_s):.1f} s {way} that of the rays; "
                "set the clocks of both machines by NTP"
            )
        return ""

    def at(self, stamps_ns: Stamps) -> tuple[Array, Bools]:
        """Return the places (n x 3) at `stamps_ns`, and which of them are known.

        Linear between two reports; unknown before the first, after the last and in gaps.
        """
        places = np.zeros((len(stamps_ns), 3))
        if len(self._places) < 2:
            return places, np.zeros(len(stamps_ns), dtype=np.bool_)
        origin_ns = self._places[0][0]  # as differences the nanoseconds fit into floats
        times_s = np.array([stamp - origin_ns for stamp, _ in self._places]) / NS_PER_S
        wanted_s = (stamps_ns - origin_ns) / NS_PER_S
        reports = np.array([place for _, place in self._places])
        for axis in range(3):
            places[:, axis] = np.interp(wanted_s, times_s, reports[:, axis])
        after = np.clip(np.searchsorted(times_s, wanted_s), 1, len(times_s) - 1)
        known = (wanted_s >= times_s[0]) & (wanted_s <= times_s[-1])
        known &= times_s[after] - times_s[after - 1] <= MAX_GAP_S
        return places, known
