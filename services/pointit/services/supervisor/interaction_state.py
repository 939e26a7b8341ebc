"""State of the interaction, and its outputs to the person. Controlled by the life cycle."""

from pointit.schemas import Feedback, Interaction, UserPose
from pointit.schemas.cues import Cue
from pointit.services.supervisor import user_messages
from pointit.services.supervisor.interaction_publisher import InteractionPublisher, State
from pointit.services.supervisor.localization_attempt import LocalizationAttempt, Purpose
from pointit.services.supervisor.outputs import Output
from pointit.services.supervisor.readiness import Readiness


class InteractionStateMachine:
    """Changes state as requested. Returns changed states with their cues."""

    def __init__(
        self,
        readiness: Readiness,
        *,
        localizes: bool,
        follows_robot: bool,
        press_ends: bool,
        unsure_variance: float,
    ) -> None:
        self.state: State = "idle"
        self.search: LocalizationAttempt | None = None
        """Current attempt while localizing."""
        self.pose_ns: int | None = None
        """Stamp of the newest pose, ns. None: no pose is known."""
        self.heard_ns = 0
        """Time of the wrist's last sample, or of the start of listening, ns."""
        self.over_ns = 0
        """Time at which the last attempt ended, ns. Anything that began earlier is over."""
        self.reason = ""
        self._readiness = readiness
        self._localizes = localizes
        self._follows_robot = follows_robot
        self._press_ends = press_ends
        self._unsure_variance = unsure_variance
        self._is_unsure = False
        """True if the yaw of the pose is so uncertain that an anchor is needed."""
        self._runs = 0
        self._publisher = InteractionPublisher()

    def on_pose(self, pose: UserPose) -> None:
        """Set the person's pose."""
        self.pose_ns = pose.stamp_ns
        self._is_unsure = pose.method != "external" and pose.covariance[8] > self._unsure_variance

    def start_attempt(
        self,
        purpose: Purpose,
        reason: str,
        now_ns: int,
        *,
        since_ns: int | None = None,
        then: State | None = None,
        otherwise: State | None = None,
        is_joined: bool = False,
    ) -> LocalizationAttempt:
        """Start an attempt that counts from `since_ns`. It leads to the current state by default."""
        if self.state != "pointing":  # the silence counts from here, as there was no listening before
            self.heard_ns = now_ns
        self._runs += 1
        self.search = LocalizationAttempt(
            self._runs,
            purpose,
            since_ns=now_ns if since_ns is None else since_ns,
            now_ns=now_ns,
            then=then or self.state,
            otherwise=otherwise or self.state,
            is_joined=is_joined,
        )
        self.state = "localizing"
        self.reason = reason
        return self.search

    def restart_attempt(self, search: LocalizationAttempt, reason: str) -> None:
        """Restart an attempt, keeping its times."""
        self._runs += 1
        self.reason = reason
        search.restart(self._runs)

    def point(self, now_ns: int, reason: str, *, was_heard: bool = False) -> list[Output]:
        """Start pointing. `was_heard`: True if the wrist was listened to until now."""
        if not was_heard:
            self.heard_ns = now_ns  # the silence counts from here
        self._enter("pointing", now_ns, reason)
        return [*self.show(now_ns), self.cue(now_ns, "started", self._pointing)]

    def rest(self, now_ns: int, cue: Cue, reason: str) -> list[Output]:
        """Stop pointing."""
        self._enter("idle", now_ns, reason)
        return [*self.show(now_ns), self.cue(now_ns, cue, reason)]

    def show(self, now_ns: int) -> list[Interaction]:
        """Return the state and the next step of the person, if changed."""
        ahead = self.search.ahead if self.search is not None else ()
        is_unsure = self.state == "pointing" and self._is_unsure
        return self._publisher.show(
            now_ns, self.state, self.reason, self._next_step(), ahead, is_unsure=is_unsure
        )

    def cue(self, now_ns: int, cue: Cue, text: str, target_id: str = "", *, waits: bool = False) -> Feedback:
        """Return a cue."""
        return self._publisher.cue(now_ns, cue, text, target_id, waits=waits)

    def wait_cue(self, now_ns: int) -> Feedback:
        """Return the cue that an attempt started and its target will follow."""
        return self.cue(now_ns, "started", user_messages.WAIT, waits=True)

    def _enter(self, state: State, now_ns: int, reason: str) -> None:
        if self.search is not None:
            self.search = None
            self.over_ns = now_ns
        self.state = state
        self.reason = reason

    def _next_step(self) -> str:
        if self.search is not None:
            return self.search.next_step
        if self.state == "pointing":
            return user_messages.POINT_AT_LAMP if self._is_unsure else self._pointing
        return user_messages.rest(
            localizes=self._localizes,
            is_place_known=self.pose_ns is not None,
            follows_robot=self._follows_robot,
            is_eager=self._readiness.is_eager,
        )

    @property
    def _pointing(self) -> str:
        return user_messages.POINT if self._press_ends else user_messages.POINT_AND_CONFIRM
