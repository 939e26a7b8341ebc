"""Localization by following a moving robot with the finger (paper, §II-B).

Pure: rays, tracked objects and the time go in; progress and poses come out.
"""

import math
from dataclasses import dataclass, replace

from pointit.schemas import NS_PER_S, Candidate, Localization, PointingRay, TrackedObjects
from pointit.services.localizer.estimation.estimator import Refusal, Solution, SolverSettings, solve
from pointit.services.localizer.estimation.mounting import mounting_fault
from pointit.services.localizer.outputs import Floor, Output, Phase, finite_or_none, pose_message
from pointit.services.localizer.procedures.clock_step import ClockStepDetector
from pointit.services.localizer.procedures.target_disambiguation import (
    Fit,
    TargetDisambiguator,
    rank_by_posterior,
)
from pointit.services.localizer.procedures.time_sync import RayWindow, Track

ROBOT = "robot"
"""Kind of the objects that are followed when no id is given."""

LEAST_LATENCY_SIGMA_S = 0.02
"""Least uncertainty of the time between rays and reports: the IMU's radio jitters by 5 to 20 ms."""

AGREEING = 2.37
"""Chi-square of x, y and yaw that half of all differences exceed. Those of a person who follows share rays
and constant errors: on recordings they stay below 1.4. An arm that came late makes 10 to 20."""

WHOLE = 0.9
"""Share of the window that a person must have followed before it may end."""

CHANGED = "the newest rays contradict the ones before; keep following the robot with the arm straight"
CONTRADICTED = (
    "the rays contradict the pose, so they are not pointed at the robot any more; the pose stays. If the "
    "person has moved, localize again"
)

MAX_TRACKS = 256
"""Of more robots, those that were reported last."""


@dataclass(frozen=True, kw_only=True)
class Following:
    """What is followed, and for how long."""

    target_id: str = ""
    """Empty: of all robots the one that the rays fit best."""
    reaction_s: float = 1.5
    """Rays count this long after a robot is known and the wrist heard: until then the arm is on its way."""
    window_s: float = 10.0
    """Older rays are forgotten: the IMU's heading drifts. It ends when nine tenths of a window are accepted:
    in a shorter one an arm that came late makes poses that are wrong and look certain."""
    min_span_s: float = 2.0
    """Time of pointing before the first try."""
    solve_hz: float = 2.0
    give_up_s: float = 30.0
    """Without a whole window until then, it is refused, or ends with what was accepted just then."""
    continuous: bool = False
    """Go on for ever instead of ending; poses of shorter windows are published while it samples."""
    yaw_rate_sigma_radps: float = math.radians(0.5)
    """One sigma of the IMU's yaw drift, by which the pose may change while it is followed on."""


class MovingTarget:
    """One run of the procedure; `start` begins it again."""

    _started_ns: int
    _due_ns: int
    _rays: RayWindow
    _tracks: dict[tuple[str, str], Track]
    """By tracker and id, those that were reported last at the end."""
    _meant: TargetDisambiguator
    _fits: list[Fit]
    """Of the last try, the best first."""
    _solution: Solution | None
    """The last one that was accepted."""
    _surest: tuple[Solution, int] | None
    """The most certain pose of a whole window and the stamp of its newest ray, None before the first.

    New ones are compared with it: with the last one, whose rays they share, they would agree while both go
    astray."""
    _heard_ns: int
    """Stamp of the newest ray, whether it counts or not; -1: none came."""
    _tried_ns: int
    """The same at the last try."""
    _counts_from_ns: int | None
    """Rays count from here. None: no robot is known yet."""
    _span_s: float
    """Time of pointing in the window at the last try."""

    def __init__(
        self,
        following: Following | None = None,
        trust: SolverSettings | None = None,
        *,
        floor: Floor | None = None,
    ) -> None:
        self._following = following if following is not None else Following()
        self._trust = trust if trust is not None else SolverSettings()
        self._floor = floor if floor is not None else Floor()
        self._running = False
        self._clock = ClockStepDetector()
        self._clear(0)

    @property
    def running(self) -> bool:
        """Return True if rays and objects are wanted."""
        return self._running

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return when the first ray of the last try was captured, and when the middle one was; -1: none."""
        return self._rays.times_ns

    def start(self, now_ns: int) -> list[Output]:
        """Forget everything and begin to gather."""
        self._clear(now_ns)
        self._running = True
        return [self._localization(now_ns, "sampling")]

    def on_ray(self, ray: PointingRay) -> None:
        """Keep `ray` if it counts."""
        if not self._running or ray.stamp_ns < self._started_ns:
            return
        self._heard_ns = ray.stamp_ns
        if self._counts_from_ns is None and self._tracks:
            self._counts_from_ns = ray.stamp_ns + round(self._following.reaction_s * NS_PER_S)
        if self._counts_from_ns is not None and ray.stamp_ns >= self._counts_from_ns:
            self._rays.add(ray)

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Keep where the robots of `tracker` are."""
        if not self._running:
            return
        wanted = self._following.target_id
        for item in message.objects:
            if item.id == wanted or (not wanted and item.kind == ROBOT):
                key = (tracker, item.id)
                track = self._tracks.pop(key, None) or Track(self._following.window_s)
                track.add(message.stamp_ns, item.position_m, message.latency_sigma_s)
                self._tracks[key] = track
        self._forget_left(message.stamp_ns, tracker)
        while len(self._tracks) > MAX_TRACKS:
            del self._tracks[next(iter(self._tracks))]

    def step(self, now_ns: int) -> list[Output]:
        """Try again, when it is time; begin anew when the clock was set back."""
        if not self._running:
            return []
        if self._clock.by_ns(now_ns):
            return self.start(now_ns)
        if now_ns < self._due_ns:
            return []
        self._due_ns = now_ns + round(NS_PER_S / self._following.solve_hz)
        result = self._try()
        if isinstance(result, Refusal):
            return self._missed(now_ns, result)
        if self._surest is not None and self._contradicts(result, *self._surest):
            return self._missed(now_ns, Refusal(CONTRADICTED, result.residual_rad))
        self._solution = result
        pose = pose_message(result, "moving_target", self._rays.newest_ns, self._floor)
        if self._surest is None and not (self._is_whole(self._span_s) or self._is_late(now_ns)):
            shown = [pose] if self._following.continuous else []
            return [*shown, self._localization(now_ns, "sampling", residual_rad=result.residual_rad)]
        if self._surest is None or result.position_sigma_m <= self._surest[0].position_sigma_m:
            self._surest = (result, self._rays.newest_ns)
        self._running = self._following.continuous
        return [
            pose,
            self._localization(now_ns, "solved", residual_rad=result.residual_rad, progress=1.0),
        ]

    def cancel(self, now_ns: int, reason: str = "") -> list[Output]:
        """Stop; the last pose stays."""
        if not self._running:
            return []
        self._running = False
        return [self._localization(now_ns, "cancelled", reason=reason)]

    def _clear(self, now_ns: int) -> None:
        self._started_ns = self._due_ns = now_ns
        self._clock.begin(now_ns)
        self._rays = RayWindow(self._following.window_s)
        self._tracks = {}
        self._meant = TargetDisambiguator(self._following.target_id)
        self._fits = []
        self._solution = None
        self._heard_ns = self._tried_ns = -1
        self._counts_from_ns = None
        self._span_s = 0.0
        self._surest = None

    def _try(self) -> Solution | Refusal:
        """Return the pose that fits best of those for each robot."""
        if not self._tracks:
            which = self._following.target_id or "a robot"
            return Refusal(f"nobody says where {which} is; start what tracks it")
        before_ns, self._tried_ns = self._tried_ns, self._heard_ns
        if self._tried_ns == before_ns:
            return Refusal("no rays come; check that the IMU is on and sends")
        self._forget_left(self._heard_ns)
        self._span_s = 0.0
        trust = self._rays.believed(self._trust)
        solved = [(key[1], track, self._solve(key, track, trust)) for key, track in self._tracks.items()]
        if not solved:
            return Refusal("the robot is not tracked any more; see what tracks it")
        independent = 1.0 + trust.independent_hz * self._span_s
        results = [(object_id, each) for object_id, _, each in solved]
        self._fits = rank_by_posterior(results, independent, trust.ray_sigma_rad)
        result = self._meant.choose(self._fits)
        if self._surest is not None:  # who points elsewhere now has no other mounting than before
            return result
        meant = next((track for _, track, each in solved if each is result), None)
        if meant is None:  # refused because two robots move alike, not because of one robot's rays
            return result
        wrong = mounting_fault(self._rays.pointings(meant), result, trust, self._floor.height_m)
        return Refusal(wrong, result.residual_rad) if wrong else result

    def _forget_left(self, now_ns: int, tracker: str | None = None) -> None:
        """Forget what was not reported for a window, of `tracker` or of all; their clocks may differ."""
        oldest_ns = now_ns - self._following.window_s * NS_PER_S
        for key, track in list(self._tracks.items()):
            is_left = not track.is_reported if tracker is None else tracker == key[0]
            if is_left and track.newest_ns < oldest_ns:
                del self._tracks[key]

    def _solve(self, key: tuple[str, str], track: Track, trust: SolverSettings) -> Solution | Refusal:
        tracker, robot = key
        fault = track.fault(robot, tracker, self._heard_ns)
        track.is_reported = False
        if fault:
            return Refusal(fault)
        pointings = self._rays.pointings(track)
        self._span_s = max(self._span_s, pointings.span_s)
        if pointings.span_s < self._following.min_span_s:
            return Refusal("keep following the robot with the arm straight")
        if track.latency_sigma_s is not None:
            trust = replace(trust, latency_sigma_s=max(track.latency_sigma_s, LEAST_LATENCY_SIGMA_S))
        floor_m = self._floor.height_m
        result = solve(pointings, trust, floor_m=floor_m, start=self._solution)
        if isinstance(result, Refusal) or not self._is_whole(pointings.span_s):
            return result
        unlimited = replace(trust, max_position_sigma_m=math.inf, max_yaw_sigma_rad=math.inf)
        middle_s = pointings.stamps_s[-1] - 0.5 * self._following.window_s
        half = solve(pointings.only(pointings.stamps_s >= middle_s), unlimited, floor_m=floor_m, start=result)
        is_steady = isinstance(half, Refusal) or half.differs(result) <= AGREEING
        return result if is_steady else Refusal(CHANGED, result.residual_rad)

    def _is_whole(self, span_s: float) -> bool:
        return span_s >= WHOLE * self._following.window_s

    def _is_late(self, now_ns: int) -> bool:
        return now_ns - self._started_ns >= self._following.give_up_s * NS_PER_S

    def _contradicts(self, solution: Solution, surest: Solution, surest_ns: int) -> bool:
        drift_rad = self._following.yaw_rate_sigma_radps * (self._rays.newest_ns - surest_ns) / NS_PER_S
        return surest.differs(solution, drift_rad) > AGREEING

    def _missed(self, now_ns: int, refusal: Refusal) -> list[Output]:
        phase: Phase = "sampling" if self._surest is None else "solved"
        if self._is_late(now_ns) and not self._following.continuous:
            self._running = False
            phase = "refused"
        return [self._localization(now_ns, phase, residual_rad=refusal.residual_rad, reason=refusal.reason)]

    def _localization(
        self,
        now_ns: int,
        phase: Phase,
        *,
        progress: float | None = None,
        residual_rad: float | None = None,
        reason: str = "",
    ) -> Localization:
        share = min(1.0, self._span_s / self._following.window_s)
        solution = self._solution
        several = [fit for fit in self._fits if fit.probability > 0.0] if len(self._fits) > 1 else []
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            target_id=self._meant.object_id,
            target_count=len(self._tracks),
            samples=len(self._rays),
            since_ns=self._started_ns,
            progress=share if progress is None else progress,
            residual_rad=residual_rad,
            reason=reason,
            position_sigma_m=None if solution is None else finite_or_none(solution.position_sigma_m),
            yaw_sigma_rad=None if solution is None else finite_or_none(solution.yaw_sigma_rad),
            candidates=tuple(
                Candidate(object_id=fit.object_id, probability=fit.probability)
                for fit in sorted(several, key=lambda fit: -fit.probability)
            ),
        )
