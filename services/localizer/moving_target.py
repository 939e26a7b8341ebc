"""Localization by following a moving robot with the finger (paper, §II-B), matched by the time of capture.

Pure: rays, tracked objects and the time go in; progress and poses come out.
"""

import math
from collections import deque
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.geometry.floor_sigma import place_sigma_m
from pointit.schemas import NS_PER_S, Candidate, PointingRay, TrackedObjects
from pointit.schemas.base import Vec3
from pointit.schemas.text import round_beyond
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import unfiltered_rays
from pointit.services.localizer.estimation.bias_memory import BiasMemory
from pointit.services.localizer.estimation.estimator import (
    SAME_PLACE_M,
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
)
from pointit.services.localizer.estimation.mounting import mounting_fault
from pointit.services.localizer.outputs import Output, Phase, pose_message
from pointit.services.localizer.procedure import Procedure
from pointit.services.localizer.target_disambiguator import RobotFit, TargetDisambiguator, rank_by_posterior
from pointit.services.localizer.verification import (
    CHANGED,
    FOLLOWING_AGREEING,
    UNSETTLED,
    followed,
    has_settled,
    without_spikes,
)

Stamps = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_GAP_S = 0.5
"""Longest time between two reports of a target over which its position is interpolated."""

MIN_HZ = 3.0
"""Rate of reports that keeps them closer than `MAX_GAP_S`, with some jitter."""

AHEAD_S = 0.5
"""Largest time by which a report's stamp is ahead of a ray of the same moment: else clocks differ."""
BEHIND_S = 1.0
"""Largest time by which it is behind."""

MAX_RAYS = 8192
"""Largest number of rays in a window, whatever the rate."""

ROBOT = "robot"
"""Kind of the objects that are followed if no id is given."""

WRIST_SIGMA_S = 0.02
"""1 sigma of the time of rays whose wrist does not state it: the IMU's radio jitters by 5 to 20 ms."""

CONTRADICTED = (
    "the rays contradict the pose, so they are not pointed at the robot any more; the pose stays. If the "
    "person has moved, localize again"
)

MAX_TRACKS = 256
"""Largest number of robots; those reported last are kept."""

MIN_SPAN_S = 1.5
"""Time of pointing before the first solution."""

SOLVE_HZ = 2.0
"""Rate of solutions once there is a pose."""

SEARCH_HZ = 4.0
"""Rate of solutions before."""


class RayWindow:
    """The rays of the last `window_s`."""

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._rays: deque[PointingRay] = deque(maxlen=MAX_RAYS)
        self._cached: tuple[tuple[int, int], tuple[Stamps, Array, Array]] | None = None
        """Newest stamp and number of rays, and their arrays."""

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
        if not self._rays:
            return
        oldest_ns = self._rays[0].stamp_ns
        middle_ns = oldest_ns + (self.newest_ns - oldest_ns) // 2
        while self._rays[0].stamp_ns < middle_ns:
            self._rays.popleft()

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return the stamps of the oldest and the middle ray, -1 if there are none."""
        rays = self._rays
        if not rays:
            return -1, -1
        middle = rays[len(rays) // 2]
        return rays[0].stamp_ns, middle.stamp_ns

    def believed(self, settings: SolverSettings) -> SolverSettings:
        """Return `settings` with the person's calibration; see `rays.believed`."""
        return unfiltered_rays.believed(settings, self._rays)

    def pointings(self, track: "Track") -> Pointings:
        """Return the rays with the position of `track` at each one's time; rays without one are left out."""
        stamps_ns, origins, directions = self._arrays()
        targets, is_known = track.at(stamps_ns)
        stamps_ns = stamps_ns[is_known]
        since_first_ns = (stamps_ns - stamps_ns[:1]).astype(np.float64)
        return Pointings(
            since_first_ns / NS_PER_S, origins[is_known], directions[is_known], targets[is_known]
        )

    def _arrays(self) -> tuple[Stamps, Array, Array]:
        """Return stamps (n), origins and directions (n x 3), cached for all tracks."""
        key = (self.newest_ns, len(self._rays))
        if self._cached is not None and self._cached[0] == key:
            return self._cached[1]
        stamps_ns = np.array([ray.stamp_ns for ray in self._rays], dtype=np.int64)
        origins = unfiltered_rays.origins(self._rays)
        directions = unfiltered_rays.directions(self._rays)
        arrays = (stamps_ns, origins, directions)
        self._cached = (key, arrays)
        return arrays


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
        gap_s = 0.0
        if len(self._places) > 2:
            stamps_ns = [stamp_ns for stamp_ns, _ in self._places]
            gap_s = float(np.median(np.diff(stamps_ns))) / NS_PER_S
        if gap_s > 0.9 * MAX_GAP_S:
            rate_hz = round_beyond(1.0 / gap_s, MIN_HZ)
            return (
                f"robot {robot} is reported by tracker {tracker} at {rate_hz} Hz and at least "
                f"{MIN_HZ:g} Hz are needed; set the tracker to a higher rate"
            )

        # Reports that have ended fall behind, too, which says nothing about the clock
        ahead_s = (self.newest_ns - ray_ns) / NS_PER_S
        is_behind = ahead_s < -BEHIND_S and self.is_reported
        if ahead_s > AHEAD_S or is_behind:
            side = "ahead of" if ahead_s > 0.0 else "behind"
            return (
                f"the clock of tracker {tracker} is {abs(ahead_s):.1f} s {side} that of the rays; "
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

        # Since the first report: as differences the nanoseconds fit into floats
        origin_ns, _ = self._places[0]
        report_times_ns = [stamp_ns - origin_ns for stamp_ns, _ in self._places]
        report_times_s = np.array(report_times_ns) / NS_PER_S
        times_s = (stamps_ns - origin_ns) / NS_PER_S
        reports_m = np.array([position_m for _, position_m in self._places])
        for axis in range(3):
            places[:, axis] = np.interp(times_s, report_times_s, reports_m[:, axis])

        # `interp` extends the ends and bridges the gaps, where nothing is known
        after = np.searchsorted(report_times_s, times_s)
        after = np.clip(after, 1, len(report_times_s) - 1)
        is_known = (times_s >= report_times_s[0]) & (times_s <= report_times_s[-1])
        is_known &= report_times_s[after] - report_times_s[after - 1] <= MAX_GAP_S
        return places, is_known


class MovingTarget(Procedure):
    """One run of the procedure.

    It ends as soon as a pose is accepted. With `autostart` it continues, and refines the pose.
    """

    _due_ns: int
    _rays: RayWindow
    _tracks: dict[tuple[str, str], Track]
    """By tracker and id; those reported last are at the end."""
    _disambiguator: TargetDisambiguator
    _fits: list[RobotFit]
    """Result of the last solution, the best first."""
    _surest: tuple[Solution, int] | None
    """The most certain pose of a whole window and the stamp of its newest ray, None before the first.

    New poses are compared with it. The last one shares rays with them, so both could drift off together.
    """
    _newest_ray_ns: int
    """Stamp of the newest ray, whether it counts or not; -1: none came."""
    _tried_ns: int
    """`_newest_ray_ns` at the last solution."""
    _counts_from_ns: int | None
    """Time from which rays count. None while no robot is known."""
    _span_s: float
    """Time of pointing in the window at the last solution."""

    def __init__(self, config: LocalizerConfig, memory: BiasMemory | None = None) -> None:
        """Create; `memory` of the person's bias is used, and learns from the pose that is accepted first."""
        super().__init__(config)
        self._memory = memory or BiasMemory()
        self.wrist_sigma_s: float | None = None
        """1 sigma of the time of the rays, as the wrist states it. None if it does not."""
        self._settings = config.believed()
        self._clear(0)

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return the stamps of the first and the middle ray of the last solution, -1 if there are none."""
        return self._rays.times_ns

    def on_yaw_origin_changed(self, now_ns: int, reason: str) -> list[Output]:
        """Start again, since rays of two yaw origins cannot be combined."""
        del reason
        return self.start(now_ns)

    def on_ray(self, ray: PointingRay) -> None:
        """Add `ray` if it counts."""
        if not self._running or ray.stamp_ns < self.since_ns:
            return
        self._newest_ray_ns = ray.stamp_ns
        if self._counts_from_ns is None and self._tracks:
            self._counts_from_ns = ray.stamp_ns + round(self._config.reaction_s * NS_PER_S)
        if self._counts_from_ns is not None and ray.stamp_ns >= self._counts_from_ns:
            self._rays.add(ray)

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Store the positions of the robots of `tracker`."""
        if not self._running:
            return
        robot_id = self._config.robot_id
        for item in message.objects:
            is_any_robot = not robot_id and item.kind == ROBOT
            if item.id != robot_id and not is_any_robot:
                continue

            # Popped and stored again, so that the robots reported last are at the end
            key = (tracker, item.id)
            track = self._tracks.pop(key, None) or Track(self._config.window_s)
            track.add(message.stamp_ns, item.position_m, message.latency_sigma_s)
            self._tracks[key] = track
        self._forget_unreported(message.stamp_ns, tracker)
        while len(self._tracks) > MAX_TRACKS:
            del self._tracks[next(iter(self._tracks))]

    def _begin(self, now_ns: int) -> list[Output]:
        self._clear(now_ns)
        return [self._localization(now_ns, "sampling")]

    def _continue(self, now_ns: int) -> list[Output]:
        if now_ns < self._due_ns:
            return []
        result = self._solve_tracks()
        rate_hz = SEARCH_HZ if isinstance(result, Refusal) else SOLVE_HZ
        self._due_ns = now_ns + round(NS_PER_S / rate_hz)
        if self._surest is not None:
            surest, surest_ns = self._surest
            if self._contradicts(result, surest, surest_ns):
                result = Refusal(CONTRADICTED, result.residual_rad)
        if isinstance(result, Refusal):
            return self._report_refusal(now_ns, result)

        # The pose counts as the surest only after it was compared with the one before
        self._solution = result
        pose = pose_message(result, "moving_target", self._rays.newest_ns, self._config)
        if self._surest is None or result.position_sigma_m <= self._surest[0].position_sigma_m:
            self._surest = (result, self._rays.newest_ns)
        self._running = self._config.autostart
        return [pose, self._localization(now_ns, "solved", residual_rad=result.residual_rad, progress=1.0)]

    def _clear(self, now_ns: int) -> None:
        self._due_ns = now_ns
        self._rays = RayWindow(self._config.window_s)
        self._tracks = {}
        self._disambiguator = TargetDisambiguator(self._config.robot_id)
        self._fits = []
        self._solution = None
        self._newest_ray_ns = self._tried_ns = -1
        self._counts_from_ns = None
        self._span_s = 0.0
        self._surest = None
        self._expected = copy(self._memory)  # without these rays, which would count twice

    def _solve_tracks(self) -> Solution | Refusal:
        """Return the pose by the robot that is meant, or the refusal."""
        if not self._tracks:
            robot = self._config.robot_id or "a robot"
            return Refusal(f"no tracker reports {robot}; start its tracker")
        previous_ns = self._tried_ns
        self._tried_ns = self._newest_ray_ns
        if self._tried_ns == previous_ns:
            return Refusal("no rays come; check that the IMU is on and sends")

        # One result for each robot. `_solve` also sets `_span_s`.
        self._forget_unreported(self._newest_ray_ns)
        self._span_s = 0.0
        settings = self._rays.believed(self._settings)
        results: list[tuple[str, Solution | Refusal]] = []
        tracks: list[Track] = []
        for key, track in self._tracks.items():
            _, object_id = key
            results.append((object_id, self._solve(key, track, settings)))
            tracks.append(track)
        if not results:
            return Refusal("the robot is not tracked any more; check its tracker")

        # The robot that is meant
        independent = 1.0 + settings.independent_hz * self._span_s
        self._fits = rank_by_posterior(results, independent, settings.ray_sigma_rad)
        result = self._disambiguator.choose(self._fits)
        if self._surest is not None:  # a person who points elsewhere now has the same mounting as before
            return result
        for (_, robot_result), track in zip(results, tracks, strict=True):
            if robot_result is result:
                return self._check_first_pose(result, track, settings)
        return result  # refused because two robots move in the same way, not because of one robot's rays

    def _check_first_pose(
        self, result: Solution | Refusal, track: Track, settings: SolverSettings
    ) -> Solution | Refusal:
        """Return `result`, or the refusal of a wrong mounting or of too uncertain a pose.

        An accepted pose is remembered for the bias.
        """
        # An arm that came late has just settled: without the older half the next solution may be accepted
        pointings = self._rays.pointings(track)
        floor_m = self._config.floor_m
        if isinstance(result, Refusal) and has_settled(pointings, result, settings, floor_m=floor_m):
            self._rays.forget_older_half()
            return result

        problem = mounting_fault(pointings, result, settings, floor_m)
        if not problem and isinstance(result, Solution):
            problem = self._uncertainty_problem(pointings, result)
        if problem:
            return Refusal(problem, result.residual_rad)

        # A calibration leaves no bias to remember
        if isinstance(result, Solution) and settings is self._settings:
            self._memory.learn(without_spikes(pointings), self._timed(settings, track), floor_m)
        return result

    def _uncertainty_problem(self, pointings: Pointings, solution: Solution) -> str:
        """Return the reason to refuse a pose by which places at the robot are too uncertain, or `""`."""
        x_m, y_m, _ = pointings.targets_m.mean(axis=0).tolist()
        floor_m = self._config.floor_m
        place_m = (x_m, y_m, floor_m)
        feet_m = (solution.x_m, solution.y_m, floor_m)
        covariance = solution.covariance.ravel().tolist()
        sigma_m = place_sigma_m(place_m, feet_m, covariance, feet_m, 0.0)
        limit_m = self._config.max_place_sigma_m
        if sigma_m <= limit_m:
            return ""
        certainty = f"sure to {round_beyond(sigma_m, limit_m, 2)} m only, limit {limit_m:g} m"
        return f"a place at the robot is {certainty}: follow on, with the arm straight"

    def _forget_unreported(self, now_ns: int, tracker: str | None = None) -> None:
        """Drop targets not reported for a window, of `tracker` or of all; their clocks may differ."""
        oldest_ns = now_ns - self._config.window_s * NS_PER_S
        for key, track in list(self._tracks.items()):
            may_be_dropped = not track.is_reported if tracker is None else tracker == key[0]
            if may_be_dropped and track.newest_ns < oldest_ns:
                del self._tracks[key]

    def _solve(self, key: tuple[str, str], track: Track, settings: SolverSettings) -> Solution | Refusal:
        tracker, robot = key
        fault = track.fault(robot, tracker, self._newest_ray_ns)
        track.is_reported = False
        if fault:
            return Refusal(fault)
        pointings = self._rays.pointings(track)
        self._span_s = max(self._span_s, pointings.span_s)
        if pointings.span_s < MIN_SPAN_S:
            return Refusal("keep following the robot with the arm straight")
        if float(np.ptp(pointings.targets_m, axis=0).max()) < SAME_PLACE_M:
            return Refusal(f"{robot} stands still: follow it with the arm as soon as it moves")
        floor_m = self._config.floor_m
        timed = self._timed(settings, track)
        if settings is self._settings:  # a calibration leaves no bias to remember
            timed = self._expected.believed(without_spikes(pointings), timed, floor_m)
        return followed(pointings, timed, floor_m=floor_m, start=self._solution)

    def _timed(self, settings: SolverSettings, track: Track) -> SolverSettings:
        """Return `settings` with the uncertainty of the times of the rays and of `track`."""
        tracker_s = settings.latency_sigma_s if track.latency_sigma_s is None else track.latency_sigma_s
        wrist_s = WRIST_SIGMA_S if self.wrist_sigma_s is None else self.wrist_sigma_s
        return replace(settings, latency_sigma_s=math.hypot(tracker_s, wrist_s))

    def _is_late(self, now_ns: int) -> bool:
        return now_ns - self.since_ns >= self._config.give_up_s * NS_PER_S

    def _contradicts(self, solution: Solution | Refusal, surest: Solution, surest_ns: int) -> bool:
        if isinstance(solution, Refusal):
            return solution.reason in {CHANGED, UNSETTLED}
        rate_radps = math.radians(self._config.drift.rate_sigma_degps)
        drift_rad = rate_radps * (self._rays.newest_ns - surest_ns) / NS_PER_S
        return surest.differs(solution, drift_rad) > FOLLOWING_AGREEING

    def _report_refusal(self, now_ns: int, refusal: Refusal) -> list[Output]:
        phase: Phase = "sampling" if self._surest is None else "solved"
        if self._is_late(now_ns) and not self._config.autostart:
            self._running = False
            phase = "refused"
        return [self._localization(now_ns, phase, residual_rad=refusal.residual_rad, reason=refusal.reason)]

    def _share(self, now_ns: int, phase: Phase) -> float:
        del now_ns, phase
        return min(1.0, self._span_s / self._config.window_s)

    def _details(self, phase: Phase) -> dict[str, Any]:
        del phase
        candidates: list[Candidate] = []
        if len(self._fits) > 1:
            for fit in sorted(self._fits, key=lambda fit: -fit.probability):
                if fit.probability > 0.0:
                    candidates.append(Candidate(object_id=fit.object_id, probability=fit.probability))
        return {
            "target_id": self._disambiguator.object_id,
            "target_count": len(self._tracks),
            "samples": len(self._rays),
            "candidates": tuple(candidates),
        }
