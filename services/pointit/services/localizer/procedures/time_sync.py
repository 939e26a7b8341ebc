"""Rays and moving targets matched by the time of their capture, whenever they arrive."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from pointit.schemas import NS_PER_S, PointingRay
from pointit.schemas.base import Vec3
from pointit.schemas.text import round_beyond
from pointit.services.localizer.estimation import rays as ray_math
from pointit.services.localizer.estimation.angular_residuals import Array
from pointit.services.localizer.estimation.estimator import Pointings, SolverSettings

Stamps = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_GAP_S = 0.5
"""Longest time between two reports of a target over which its position is interpolated."""

MIN_HZ = 3.0
"""Rate of reports that keeps them closer than `MAX_GAP_S`, with some jitter."""

AHEAD_S, BEHIND_S = 0.5, 1.0
"""Largest differences of the stamps of reports and rays of the same moment: beyond them the clocks differ."""

MAX_RAYS = 8192
"""Largest number of rays in a window, whatever the rate."""


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
        """Return the newest ray's stamp, or -1 if there is none."""
        return self._rays[-1].stamp_ns if self._rays else -1

    def add(self, ray: PointingRay) -> None:
        """Add `ray` unless it is not newer than the last one; drop rays that have left the window."""
        if ray.stamp_ns <= self.newest_ns:
            return
        self._rays.append(ray)
        while self._rays[0].stamp_ns < ray.stamp_ns - self._window_ns:
            self._rays.popleft()

    def forget_older_half(self) -> None:
        """Drop the rays of the first half of the time."""
        if self._rays:
            middle_ns = self._rays[0].stamp_ns + (self.newest_ns - self._rays[0].stamp_ns) // 2
            while self._rays[0].stamp_ns < middle_ns:
                self._rays.popleft()

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return the stamps of the oldest and the middle ray, -1 if there are none."""
        rays = self._rays
        return (rays[0].stamp_ns, rays[len(rays) // 2].stamp_ns) if rays else (-1, -1)

    def believed(self, settings: SolverSettings) -> SolverSettings:
        """Return `settings` with the person's calibration; see `rays.believed`."""
        return ray_math.believed(settings, self._rays)

    def pointings(self, track: "Track") -> Pointings:
        """Return the rays with the position of `track` at each one's time; rays without one are left out."""
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
        """Return stamps (n), origins and directions (n x 3), cached for all tracks."""
        key = (self.newest_ns, len(self._rays))
        if self._made is None or self._made[0] != key:
            stamps = np.array([ray.stamp_ns for ray in self._rays], dtype=np.int64)
            arrays = (stamps, ray_math.origins(self._rays), ray_math.directions(self._rays))
            self._made = (key, arrays)
        return self._made[1]


class Track:
    """Positions of one target during the last `window_s`."""

    def __init__(self, window_s: float) -> None:
        self._window_ns = round((window_s + 2.0 * MAX_GAP_S) * NS_PER_S)
        self._places: deque[tuple[int, Vec3]] = deque(maxlen=MAX_RAYS)
        self.latency_sigma_s: float | None = None
        """As the newest report states it. None if it does not."""
        self.is_reported = False
        """True if a report came since this was last set to False."""

    @property
    def newest_ns(self) -> int:
        """Return the newest report's stamp, or -1 if there is none."""
        return self._places[-1][0] if self._places else -1

    def add(self, stamp_ns: int, position_m: Vec3, latency_sigma_s: float | None = None) -> None:
        """Add the position at `stamp_ns` unless it is not newer than the last one.

        A step back by more than a window clears the track: the tracker's clock was set.
        """
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
        """Return a problem of the reports, or `""`; `ray_ns` is the stamp of the newest ray."""
        stamps = [stamp for stamp, _ in self._places]
        gap_s = float(np.median(np.diff(stamps))) / NS_PER_S if len(stamps) > 2 else 0.0
        if gap_s > 0.9 * MAX_GAP_S:
            return (
                f"robot {robot} is reported by tracker {tracker} at {round_beyond(1.0 / gap_s, MIN_HZ)} "
                "Hz and at least "
                f"{MIN_HZ:g} Hz are needed; set the tracker to a higher rate"
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
        """Return the positions (n x 3) at `stamps_ns`, and which of them are known.

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
