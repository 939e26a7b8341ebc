"""The life cycle of a pointing-based interaction (paper, §II-D), for one person.

idle --press--> localizing --solved--> pointing --press--> idle
idle --press--> pointing                         if the person's pose is known
localizing --any gesture, refusal, timeout, silent wrist--> idle
pointing --silent wrist--> idle                  and back if it sends again soon
pointing, idle --double press, or a request of another client--> localizing --in any case--> previous state,
    or idle if the wrist is silent: pointing at one lamp corrects the pose (an anchor), or the person is
    localized for the other client. No cursor is shown in the meantime
any state --hold--> idle, and from idle it localizes again, if the person localizes at all

With `autostart` a sample of the wrist acts like a press in idle, unless a gesture led there.

The cues alone are sufficient instructions: while a cue `waits`, wait; `started`: continue; `target`: point at
what it names; `stopped` and `refused`: rest. `localized`, and a `refused` or `stopped` anchor, are followed
by
`started` if pointing continues.
"""

import math
from typing import Literal

from pointit.schemas import NS_PER_S, ButtonEvent, ImuSample, Interaction, Localization, UserPose
from pointit.schemas.cues import Cue
from pointit.services.supervisor import user_messages
from pointit.services.supervisor.interaction_publisher import State
from pointit.services.supervisor.interaction_state import InteractionStateMachine
from pointit.services.supervisor.localization_attempt import LocalizationAttempt
from pointit.services.supervisor.outputs import Cancel, Output, Start, StartAnchor
from pointit.services.supervisor.readiness import InteractionResume, Readiness

SETTLE_NS = NS_PER_S
"""Time after the start for a known pose to arrive before autostart localizes the person, ns."""


class LifeCycle:
    """Processes events with their time, and returns messages and requests.

    Repeated events have no effect. Every state but idle has a deadline, at which `tick` must be called.
    """

    def __init__(
        self,
        *,
        localize: bool = False,
        relocalize_each_time: bool = False,
        follows_robot: bool = False,
        localization_timeout_s: float = 60.0,
        imu_timeout_s: float = 3.0,
        autostart: bool = False,
        retry_s: float = 5.0,
        resume_s: float = 30.0,
        press_while_pointing: Literal["ends", "confirms"] = "ends",
        unsure_rad: float = math.radians(15.0),
    ) -> None:
        self._localizes = localize
        self._each_time = localize and relocalize_each_time
        self._timeout_s = localization_timeout_s
        self._silence_s = imu_timeout_s
        self._readiness = Readiness(autostart=autostart, retry_s=retry_s, resume_s=resume_s)
        self._press_ends = press_while_pointing == "ends"
        self._machine = InteractionStateMachine(
            self._readiness,
            localizes=localize,
            follows_robot=follows_robot,
            press_ends=self._press_ends,
            unsure_variance=unsure_rad**2,
        )
        self._before = InteractionResume()
        self._button: ButtonEvent | None = None
        self._pending_cancels = 0
        """Number of requests to cancel without reply."""

    @property
    def state(self) -> State:
        """Return the state of the interaction."""
        return self._machine.state

    @property
    def run(self) -> int:
        """Return the number of the current localization, or 0 if there is none."""
        return self._machine.search.run if self._machine.search is not None else 0

    @property
    def deadline_ns(self) -> int | None:
        """Return the latest time of the next `tick`, ns. None while idle."""
        if self._machine.state == "idle":
            return None
        silent_ns = self._machine.heard_ns + round(self._silence_s * NS_PER_S)
        if self._machine.search is None:
            return silent_ns
        return min(silent_ns, self._machine.search.counted_ns + round(self._timeout_s * NS_PER_S))

    def begin(self, now_ns: int) -> list[Output]:
        """Return the first state."""
        self._readiness.wait(now_ns + SETTLE_NS if self._localizes else now_ns)
        return [*self._machine.show(now_ns)]

    def resume_from(self, before: Interaction, now_ns: int) -> None:
        """Set the last state of an earlier supervisor. It may continue if the localizer is the same."""
        if self._machine.state == "idle" and self._button is None:
            self._before.take(before, now_ns)

    def button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Process a gesture as described above. After one that ends, there is no automatic start."""
        if self._button is not None and _is_same(event, self._button):
            return []
        self._button = event
        gesture = event.gesture
        self._before.forget()
        if self._machine.search is not None:
            return self._abort(self._machine.search, now_ns, is_for_good=gesture == "hold")
        if gesture == "double":
            return self._ask_anchor(now_ns)
        if self._machine.state == "pointing":
            if gesture == "press" and not self._press_ends:
                return []
            self._readiness.gesture(ends=True)
            return self._machine.rest(now_ns, "stopped", user_messages.STOPPED)
        self._readiness.gesture(ends=False)
        if gesture == "hold" and self._localizes:
            return self._localize(now_ns)
        if self._machine.pose_ns is None and not self._localizes:
            return self._machine.rest(now_ns, "refused", user_messages.NO_POSE)
        return self._start(now_ns)

    def imu(self, sample: ImuSample, now_ns: int) -> list[Output]:
        """Record a sample of the wrist. A timely one may start pointing, or resume it."""
        self._machine.heard_ns = now_ns
        if self._machine.state != "idle":
            return []
        resumes = self._readiness.may_resume(now_ns) and self._is_place_known
        begins = self._readiness.may_begin(now_ns) and (self._machine.pose_ns is not None or self._localizes)
        is_timely = abs(now_ns - sample.stamp_ns) <= self._silence_s * NS_PER_S
        if not is_timely or not (resumes or begins):
            return []
        return self._machine.point(now_ns, user_messages.RESUMED) if resumes else self._start(now_ns)

    def pose(self, pose: UserPose, now_ns: int) -> list[Output]:
        """Set the person's pose."""
        self._machine.on_pose(pose)
        return [*self._machine.show(now_ns)]

    def localization(self, news: Localization, now_ns: int) -> list[Output]:
        """Process the localizer's progress. Messages older than the current localization are ignored."""
        search = self._machine.search
        if search is None:
            return self._join(news, now_ns)
        match search.classify(news, self._machine.pose_ns):
            case "nothing":
                return []
            case "aim":
                return self._aim(search, news, now_ns)
            case "found":
                return self._over(news, self._found(search, now_ns))
            case "refused" | "cancelled" | "lost" as end:
                cue: Cue = "stopped" if end == "cancelled" else "refused"
                return self._over(
                    news, self._fail(search, now_ns, cue, search.failure_reason(end, news.reason))
                )
            case "restarted":
                self._machine.restart_attempt(search, user_messages.AGAIN)
                return [Start(search.run), *self._machine.show(now_ns)]

    def on_start_accepted(self, run: int) -> list[Output]:
        """Process the reply to a `Start`. It is cancelled if the person rests again."""
        if self._machine.state == "idle":
            return [self._cancel()]
        if self._machine.search is not None and run == self._machine.search.run:
            self._machine.search.is_answered = True
        return []

    def on_cancel_reply(self, now_ns: int) -> None:
        """Process the reply to a `Cancel`, successful or not."""
        self._pending_cancels = max(0, self._pending_cancels - 1)
        if self._machine.search is None:
            self._machine.over_ns = max(self._machine.over_ns, now_ns)

    def on_start_failed(self, run: int, reason: str, now_ns: int) -> list[Output]:
        """Process the failure of a `Start`."""
        search = self._machine.search
        return [] if search is None or run != search.run else self._fail(search, now_ns, "refused", reason)

    def tick(self, now_ns: int) -> list[Output]:
        """Advance to `now_ns` and end what has timed out."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        search = self._machine.search
        cancel: list[Output] = [] if search is None or search.is_owned_by_requester else [self._cancel()]
        if now_ns >= self._machine.heard_ns + round(self._silence_s * NS_PER_S):
            if self._machine.state == "pointing" or (
                search is not None and search.state_on_failure == "pointing"
            ):
                self._readiness.on_interrupted(now_ns)
            cue: Cue = "stopped" if search is None else "refused"
            return [*cancel, *self._machine.rest(now_ns, cue, user_messages.silent(self._silence_s))]
        if search is None:
            return []
        return [*cancel, *self._fail(search, now_ns, "refused", user_messages.too_long(self._timeout_s))]

    @property
    def _is_place_known(self) -> bool:
        return self._machine.pose_ns is not None and not self._each_time

    def _start(self, now_ns: int) -> list[Output]:
        if self._localizes and not self._is_place_known:
            return self._localize(now_ns)
        return self._machine.point(now_ns, user_messages.PLACE_KNOWN)

    def _localize(self, now_ns: int) -> list[Output]:
        stage = self._machine
        search = stage.start_attempt("pose", user_messages.ASKED, now_ns, then="pointing", otherwise="idle")
        return [Start(search.run), *stage.show(now_ns), stage.wait_cue(now_ns)]

    def _ask_anchor(self, now_ns: int) -> list[Output]:
        stage = self._machine
        if stage.pose_ns is None:
            return stage.rest(now_ns, "refused", user_messages.NO_POSE_TO_ANCHOR)
        search = stage.start_attempt("anchor", user_messages.ANCHOR_ASKED, now_ns)
        return [StartAnchor(search.run), *stage.show(now_ns), stage.wait_cue(now_ns)]

    def _join(self, news: Localization, now_ns: int) -> list[Output]:
        """Follow an attempt requested by another client, once it has a target."""
        stage = self._machine
        before = self._before.resumable_activity(news) if stage.state == "idle" else ""
        if before == "pointing":
            self._readiness.on_interrupted(now_ns)
            return []
        since_ns = min(news.stamp_ns, now_ns)
        if before == "localizing":  # the person's own attempt
            search = stage.start_attempt(
                "pose", user_messages.RESUMED, now_ns, since_ns=since_ns, then="pointing", otherwise="idle"
            )
            search.is_answered = True
            return self._aim(search, news, now_ns)
        began_ns = news.since_ns or news.stamp_ns
        is_new = news.phase == "sampling" and began_ns >= stage.over_ns and not self._pending_cancels
        if not is_new or not news.target_id:
            return []
        is_anchor = news.purpose == "anchor"
        reason = user_messages.ANCHOR_ASKED_FOR if is_anchor else user_messages.POSE_ASKED_FOR
        search = stage.start_attempt(news.purpose, reason, now_ns, since_ns=since_ns, is_joined=True)
        return self._aim(search, news, now_ns)

    def _aim(self, search: LocalizationAttempt, news: Localization, now_ns: int) -> list[Output]:
        is_news = search.follow(news, now_ns)
        shown = self._machine.show(now_ns)
        if not is_news:
            return [*shown]
        target = search.target_id
        return [*shown, self._machine.cue(now_ns, "target", search.next_step, target, waits=not target)]

    def _found(self, search: LocalizationAttempt, now_ns: int) -> list[Output]:
        stage = self._machine
        reason = user_messages.ANCHORED if search.purpose == "anchor" else user_messages.LOCALIZED
        cue = stage.cue(now_ns, "localized", reason)
        if search.state_on_success == "pointing":
            return [cue, *stage.point(now_ns, reason, was_heard=search.state_on_failure == "pointing")]
        return [cue, *stage.rest(now_ns, "stopped", reason)]

    def _fail(self, search: LocalizationAttempt, now_ns: int, cue: Cue, reason: str) -> list[Output]:
        """End a failed attempt."""
        if search.state_on_failure == "pointing":
            return [
                self._machine.cue(now_ns, cue, reason),
                *self._machine.point(now_ns, reason, was_heard=True),
            ]
        if search.purpose == "pose" and not search.is_joined:
            self._readiness.fail(now_ns)
        return self._machine.rest(now_ns, cue, reason)

    def _abort(self, search: LocalizationAttempt, now_ns: int, *, is_for_good: bool) -> list[Output]:
        """End an attempt on request of the person."""
        reason = search.failure_reason("cancelled")
        if is_for_good or (search.purpose == "pose" and not search.is_joined):
            self._readiness.gesture(ends=True)
            return [self._cancel(), *self._machine.rest(now_ns, "stopped", reason)]
        return [self._cancel(), *self._fail(search, now_ns, "stopped", reason)]

    def _over(self, news: Localization, outputs: list[Output]) -> list[Output]:
        """Use the localizer's time of the end, as the next one may have begun right then."""
        self._machine.over_ns = min(self._machine.over_ns, news.stamp_ns)
        return outputs

    def _cancel(self) -> Cancel:
        self._pending_cancels += 1
        return Cancel()


def _is_same(a: ButtonEvent, b: ButtonEvent) -> bool:
    return (a.stamp_ns, a.seq, a.source, a.gesture) == (b.stamp_ns, b.seq, b.source, b.gesture)
