"""Localization by following a moving robot with the finger (paper, §II-B).

Pure: rays, tracked objects and the time go in; progress and poses come out.
"""

from dataclasses import dataclass

from pointit.schemas import NS_PER_S, Localization, PointingRay, TrackedObjects
from pointit.services.localizer.estimator import AMBIGUOUS_COST, Refusal, Solution, Trust, solve
from pointit.services.localizer.outputs import Output, Phase, pose_message
from pointit.services.localizer.pairing import RayWindow, Track

ALIKE = 1.2
"""The residual of the robot that fits next best must be larger by this, or nobody knows which is meant."""

ROBOT = "robot"
"""Kind of the objects that are followed when no id is given."""


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
    """By tracker and id."""
    _target_id: str
    _tried_ns: int
    """Stamp of the newest ray at the last try."""
    _span_s: float
    """Time of pointing in the window at the last try."""
    _accepted: bool

    def __init__(
        self, following: Following | None = None, trust: Trust | None = None, *, floor_m: float = 0.0
    ) -> None:
        self._following = following if following is not None else Following()
        self._trust = trust if trust is not None else Trust()
        self._floor_m = floor_m
        self._running = False
        self._clear(0)

    @property
    def running(self) -> bool:
        """Return whether rays and objects are wanted."""
        return self._running

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
                track = self._tracks.setdefault((tracker, item.id), Track(self._following.window_s))
                track.add(message.stamp_ns, item.position_m)

    def step(self, now_ns: int) -> list[Output]:
        """Try again, when it is time."""
        if not self._running or now_ns < self._due_ns:
            return []
        self._due_ns = now_ns + round(NS_PER_S / self._following.solve_hz)
        result = self._try()
        if isinstance(result, Refusal):
            return self._missed(now_ns, result)
        self._accepted = True
        done = self._span_s >= 0.9 * self._following.window_s and not self._following.continuous
        self._running = not done
        return [
            pose_message(result, "moving_target", self._rays.newest_ns, self._floor_m),
            self._localization(
                now_ns, "solved", residual_rad=result.residual_rad, progress=1.0 if done else None
            ),
        ]

    def cancel(self, now_ns: int) -> list[Output]:
        """Stop; the last pose stays."""
        if not self._running:
            return []
        self._running = False
        return [self._localization(now_ns, "cancelled")]

    def _clear(self, now_ns: int) -> None:
        self._started_ns = self._due_ns = now_ns
        self._rays = RayWindow(self._following.window_s)
        self._tracks = {}
        self._target_id = self._following.target_id
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
        for name, track in list(self._tracks.items()):  # those that left
            if track.newest_ns < self._rays.newest_ns - self._following.window_s * NS_PER_S:
                del self._tracks[name]
        self._span_s = 0.0
        results = [(self._solve(track), track_id) for (_, track_id), track in self._tracks.items()]
        if not results:
            return Refusal("the robot is not tracked any more; see what tracks it")
        results.sort(key=_worth)
        result, self._target_id = results[0]
        rival = next((other for other in results[1:] if self._is_rival(result, *other)), None)
        if rival is None:
            return result
        return Refusal(
            f"two robots move alike, {self._target_id} and {rival[1]}: have one of them move otherwise, "
            "or set robot_id",
            result.residual_rad,
        )

    def _is_rival(self, best: Solution | Refusal, other: Solution | Refusal, other_id: str) -> bool:
        """Return whether the rays fit another robot as well, from another place."""
        if isinstance(best, Refusal) or isinstance(other, Refusal) or other_id == self._target_id:
            return False
        if best.is_near(other):
            return False
        square = other.residual_rad**2 - best.residual_rad**2
        independent = 1.0 + self._trust.independent_hz * self._span_s
        unlikelier = 0.5 * independent * square / self._trust.ray_sigma_rad**2
        return unlikelier < AMBIGUOUS_COST or other.residual_rad < ALIKE * best.residual_rad

    def _solve(self, track: Track) -> Solution | Refusal:
        pointings = self._rays.pointings(track)
        self._span_s = max(self._span_s, pointings.span_s)
        if pointings.span_s < self._following.min_span_s:
            return Refusal("keep following the robot with the arm straight")
        return solve(pointings, self._trust, floor_m=self._floor_m)

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
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            target_id=self._target_id,
            target_count=len(self._tracks),
            samples=len(self._rays),
            since_ns=self._started_ns,
            progress=share if progress is None else progress,
            residual_rad=residual_rad,
            reason=reason,
        )


def _worth(candidate: tuple[Solution | Refusal, str]) -> tuple[bool, float]:
    """Order solutions before refusals, small residuals first."""
    result, _ = candidate
    residual_rad = result.residual_rad
    return isinstance(result, Refusal), float("inf") if residual_rad is None else residual_rad
