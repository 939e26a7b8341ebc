"""Localization by following a moving robot with the finger (paper, §II-B).

Pure: rays, tracked objects and the time go in; progress and poses come out.
"""

from dataclasses import dataclass

from pointit.schemas import NS_PER_S, Candidate, Localization, PointingRay, TrackedObjects
from pointit.services.localizer.estimator import Refusal, Solution, Trust, solve
from pointit.services.localizer.meant import Fit, Meant, probable
from pointit.services.localizer.outputs import Floor, Output, Phase, extent, pose_message
from pointit.services.localizer.pairing import RayWindow, Track
from pointit.services.localizer.set_back import SetBack

ROBOT = "robot"
"""Kind of the objects that are followed when no id is given."""

MAX_TRACKS = 256
"""Of more robots, those that were reported last."""


@dataclass(frozen=True, kw_only=True)
class Following:
    """What is followed, and for how long."""

    target_id: str = ""
    """Empty: of all robots the one that the rays fit best."""
    window_s: float = 10.0
    """Older rays are forgotten: the IMU's heading drifts."""
    min_span_s: float = 2.0
    """Time of pointing before the first try."""
    solve_hz: float = 2.0
    give_up_s: float = 30.0
    """When nothing was accepted until then, it is refused."""
    continuous: bool = False
    """Go on for ever instead of ending when a whole window is accepted."""


class MovingTarget:
    """One run of the procedure; `start` begins it again."""

    _started_ns: int
    _due_ns: int
    _rays: RayWindow
    _tracks: dict[tuple[str, str], Track]
    """By tracker and id, those that were reported last at the end."""
    _meant: Meant
    _fits: list[Fit]
    """Of the last try, the best first."""
    _solution: Solution | None
    """The last one that was accepted."""
    _tried_ns: int
    """Stamp of the newest ray at the last try."""
    _span_s: float
    """Time of pointing in the window at the last try."""
    _accepted: bool

    def __init__(
        self, following: Following | None = None, trust: Trust | None = None, *, floor: Floor | None = None
    ) -> None:
        self._following = following if following is not None else Following()
        self._trust = trust if trust is not None else Trust()
        self._floor = floor if floor is not None else Floor()
        self._running = False
        self._clock = SetBack()
        self._clear(0)

    @property
    def running(self) -> bool:
        """Return whether rays and objects are wanted."""
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
        """Keep `ray`."""
        if self._running and ray.stamp_ns >= self._started_ns:
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
                track.add(message.stamp_ns, item.position_m)
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
        self._accepted = True
        self._solution = result
        done = self._span_s >= 0.9 * self._following.window_s and not self._following.continuous
        self._running = not done
        return [
            pose_message(result, "moving_target", self._rays.newest_ns, self._floor),
            self._localization(
                now_ns, "solved", residual_rad=result.residual_rad, progress=1.0 if done else None
            ),
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
        self._meant = Meant(self._following.target_id)
        self._fits = []
        self._solution = None
        self._tried_ns = -1
        self._span_s = 0.0
        self._accepted = False

    def _try(self) -> Solution | Refusal:
        """Return the pose that fits best of those for each robot."""
        if not self._tracks:
            which = self._following.target_id or "a robot"
            return Refusal(f"nobody says where {which} is; start what tracks it")
        before_ns, self._tried_ns = self._tried_ns, self._rays.newest_ns
        if self._tried_ns == before_ns:
            return Refusal("no rays come; check that the IMU is on and sends")
        self._forget_left(self._rays.newest_ns)
        self._span_s = 0.0
        trust = self._rays.believed(self._trust)
        results = [(track_id, self._solve(track, trust)) for (_, track_id), track in self._tracks.items()]
        if not results:
            return Refusal("the robot is not tracked any more; see what tracks it")
        independent = 1.0 + trust.independent_hz * self._span_s
        self._fits = probable(results, independent, trust.ray_sigma_rad)
        return self._meant.choose(self._fits)

    def _forget_left(self, now_ns: int, tracker: str | None = None) -> None:
        """Forget what was not reported for a window, of `tracker` or of all; their clocks may differ."""
        oldest_ns = now_ns - self._following.window_s * NS_PER_S
        for key, track in list(self._tracks.items()):
            if tracker in (None, key[0]) and track.newest_ns < oldest_ns:
                del self._tracks[key]

    def _solve(self, track: Track, trust: Trust) -> Solution | Refusal:
        pointings = self._rays.pointings(track)
        self._span_s = max(self._span_s, pointings.span_s)
        if pointings.span_s < self._following.min_span_s:
            return Refusal("keep following the robot with the arm straight")
        return solve(pointings, trust, floor_m=self._floor.height_m, start=self._solution)

    def _missed(self, now_ns: int, refusal: Refusal) -> list[Output]:
        late = now_ns - self._started_ns >= self._following.give_up_s * NS_PER_S
        phase: Phase = "solved" if self._accepted else "sampling"
        if late and not self._following.continuous:
            self._running = False
            phase = "solved" if self._accepted else "refused"
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
            position_sigma_m=None if solution is None else extent(solution.position_sigma_m),
            yaw_sigma_rad=None if solution is None else extent(solution.yaw_sigma_rad),
            candidates=tuple(
                Candidate(object_id=fit.object_id, probability=fit.probability)
                for fit in sorted(several, key=lambda fit: -fit.probability)
            ),
        )
