"""The life cycle of a pointing-based interaction (paper, §II-D), for one person.

idle --press--> localizing --solved--> pointing --press--> idle
idle --press--> pointing                         when the person's place is known
localizing --any gesture, refusal, time-out, silent wrist--> idle
pointing --silent wrist--> idle                  and back when it is heard again soon
pointing, idle --double press, or somebody else's request--> localizing --in any case--> back where it was,
    or idle when the wrist is silent: pointing at one lamp sets the pose right (an anchor), or their place is
    found for somebody else; meanwhile no cursor is shown
anything --hold--> idle, and from idle it localizes anew, where the person localizes at all

With `autostart` a sample of the wrist does in idle what a press does, unless a gesture led there.

Who only hears the cues knows what to do: whatever the cue, wait while it `waits`; `started` go on, `target`
point at what it names, `stopped` and `refused` rest; `localized`
and a `refused` or `stopped` anchor are followed by `started` where pointing goes on.
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
"""After the begin, how long the person's place may take to come before they are localized unasked."""


class LifeCycle:
    """Takes what happens, with the time, and gives what to say and to ask for.

    Whatever is told twice changes nothing the second time. Every state but idle has a deadline; call
    `tick` when it is reached.
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
        self._stage = InteractionStateMachine(
            self._readiness,
            localizes=localize,
            follows_robot=follows_robot,
            press_ends=self._press_ends,
            unsure_variance=unsure_rad**2,
        )
        self._before = InteractionResume()
        self._button: ButtonEvent | None = None
        self._calling_off = 0
        """Requests to cancel that are not answered yet."""
        self._now_ns = 0

    @property
    def state(self) -> State:
        """Return where the person is."""
        return self._stage.state

    @property
    def run(self) -> int:
        """Return the number of the current localization, or 0 when there is none."""
        return self._stage.search.run if self._stage.search is not None else 0

    @property
    def deadline_ns(self) -> int | None:
        """Return when `tick` must be called at the latest; none while idle."""
        if self._stage.state == "idle":
            return None
        silent_ns = self._stage.heard_ns + round(self._silence_s * NS_PER_S)
        if self._stage.search is None:
            return silent_ns
        return min(silent_ns, self._stage.search.counted_ns + round(self._timeout_s * NS_PER_S))

    def begin(self, now_ns: int) -> list[Output]:
        """Say the first state."""
        self._readiness.wait(now_ns + SETTLE_NS if self._localizes else now_ns)
        return [*self._stage.show(now_ns)]

    def resume_from(self, before: Interaction, now_ns: int) -> None:
        """Take what a supervisor said that was here before: it may go on, if the localizer is the same."""
        if self._stage.state == "idle" and self._button is None:
            self._before.take(before, now_ns)

    def button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Take a gesture: see above. Nothing begins by itself after one that ends."""
        self._mind_clock(now_ns)
        if self._button is not None and _is_same(event, self._button):
            return []
        self._button = event
        gesture = event.gesture
        self._before.forget()
        if self._stage.search is not None:
            return self._call_off(self._stage.search, now_ns, is_for_good=gesture == "hold")
        if gesture == "double":
            return self._ask_anchor(now_ns)
        if self._stage.state == "pointing":
            if gesture == "press" and not self._press_ends:
                return []
            self._readiness.gesture(ends=True)
            return self._stage.rest(now_ns, "stopped", user_messages.STOPPED)
        self._readiness.gesture(ends=False)
        if gesture == "hold" and self._localizes:
            return self._localize(now_ns)
        if self._stage.pose_ns is None and not self._localizes:
            return self._stage.rest(now_ns, "refused", user_messages.NO_POSE)
        return self._start(now_ns)

    def imu(self, sample: ImuSample, now_ns: int) -> list[Output]:
        """Take note that the wrist is heard; a timely sample may begin, or go on with what was broken off."""
        self._mind_clock(now_ns)
        self._stage.heard_ns = now_ns
        if self._stage.state != "idle":
            return []
        resumes = self._readiness.may_resume(now_ns) and self._is_place_known
        begins = self._readiness.may_begin(now_ns) and (self._stage.pose_ns is not None or self._localizes)
        is_timely = abs(now_ns - sample.stamp_ns) <= self._silence_s * NS_PER_S
        if not is_timely or not (resumes or begins):
            return []
        return self._stage.point(now_ns, user_messages.RESUMED) if resumes else self._start(now_ns)

    def pose(self, pose: UserPose, now_ns: int) -> list[Output]:
        """Take the person's place."""
        self._stage.take_pose(pose)
        return [*self._stage.show(now_ns)]

    def localization(self, news: Localization, now_ns: int) -> list[Output]:
        """Take the localizer's progress; what is older than the current localization is left out."""
        self._mind_clock(now_ns)
        search = self._stage.search
        if search is None:
            return self._join(news, now_ns)
        match search.classify(news, self._stage.pose_ns):
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
                self._stage.seek_again(search, user_messages.AGAIN)
                return [Start(search.run), *self._stage.show(now_ns)]

    def on_start_accepted(self, run: int) -> list[Output]:
        """Take the localizer's consent to a `Start`; it is called off when the person rests again."""
        if self._stage.state == "idle":
            return [self._cancel()]
        if self._stage.search is not None and run == self._stage.search.run:
            self._stage.search.is_answered = True
        return []

    def on_cancel_reply(self, now_ns: int) -> None:
        """Take the answer to a `Cancel`, whatever it is."""
        self._calling_off = max(0, self._calling_off - 1)
        if self._stage.search is None:
            self._stage.over_ns = max(self._stage.over_ns, now_ns)

    def on_start_failed(self, run: int, reason: str, now_ns: int) -> list[Output]:
        """Take why a `Start` came to nothing."""
        search = self._stage.search
        return [] if search is None or run != search.run else self._fail(search, now_ns, "refused", reason)

    def tick(self, now_ns: int) -> list[Output]:
        """Go on to `now_ns`: what took too long ends."""
        self._mind_clock(now_ns)
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        search = self._stage.search
        cancel: list[Output] = [] if search is None or search.is_owned_by_requester else [self._cancel()]
        if now_ns >= self._stage.heard_ns + round(self._silence_s * NS_PER_S):
            if self._stage.state == "pointing" or (
                search is not None and search.state_on_failure == "pointing"
            ):
                self._readiness.on_interrupted(now_ns)
            cue: Cue = "stopped" if search is None else "refused"
            return [*cancel, *self._stage.rest(now_ns, cue, user_messages.silent(self._silence_s))]
        if search is None:
            return []
        return [*cancel, *self._fail(search, now_ns, "refused", user_messages.too_long(self._timeout_s))]

    @property
    def _is_place_known(self) -> bool:
        return self._stage.pose_ns is not None and not self._each_time

    def _mind_clock(self, now_ns: int) -> None:
        """Move all that was noted back with a clock that was set back."""
        back_ns, self._now_ns = self._now_ns - now_ns, now_ns
        if back_ns > NS_PER_S:
            self._readiness.set_back(back_ns)
            self._stage.set_back(back_ns)

    def _start(self, now_ns: int) -> list[Output]:
        if self._localizes and not self._is_place_known:
            return self._localize(now_ns)
        return self._stage.point(now_ns, user_messages.PLACE_KNOWN)

    def _localize(self, now_ns: int) -> list[Output]:
        stage = self._stage
        search = stage.start_attempt("pose", user_messages.ASKED, now_ns, then="pointing", otherwise="idle")
        return [Start(search.run), *stage.show(now_ns), stage.wait_cue(now_ns)]

    def _ask_anchor(self, now_ns: int) -> list[Output]:
        stage = self._stage
        if stage.pose_ns is None:
            return stage.rest(now_ns, "refused", user_messages.NO_POSE_TO_ANCHOR)
        search = stage.start_attempt("anchor", user_messages.ANCHOR_ASKED, now_ns)
        return [StartAnchor(search.run), *stage.show(now_ns), stage.wait_cue(now_ns)]

    def _join(self, news: Localization, now_ns: int) -> list[Output]:
        """Follow what somebody else has asked for, once there is something to point at."""
        stage = self._stage
        before = self._before.resumable_activity(news) if stage.state == "idle" else ""
        if before == "pointing":
            self._readiness.on_interrupted(now_ns)
            return []
        since_ns = min(news.stamp_ns, now_ns)
        if before == "localizing":  # it is theirs
            search = stage.start_attempt(
                "pose", user_messages.RESUMED, now_ns, since_ns=since_ns, then="pointing", otherwise="idle"
            )
            search.is_answered = True
            return self._aim(search, news, now_ns)
        began_ns = news.since_ns or news.stamp_ns
        is_new = news.phase == "sampling" and began_ns >= stage.over_ns and not self._calling_off
        if not is_new or not news.target_id:
            return []
        is_anchor = news.purpose == "anchor"
        reason = user_messages.ANCHOR_ASKED_FOR if is_anchor else user_messages.POSE_ASKED_FOR
        search = stage.start_attempt(news.purpose, reason, now_ns, since_ns=since_ns, is_joined=True)
        return self._aim(search, news, now_ns)

    def _aim(self, search: LocalizationAttempt, news: Localization, now_ns: int) -> list[Output]:
        is_news = search.follow(news, now_ns)
        shown = self._stage.show(now_ns)
        if not is_news:
            return [*shown]
        target = search.target_id
        return [*shown, self._stage.cue(now_ns, "target", search.next_step, target, waits=not target)]

    def _found(self, search: LocalizationAttempt, now_ns: int) -> list[Output]:
        stage = self._stage
        reason = user_messages.ANCHORED if search.purpose == "anchor" else user_messages.LOCALIZED
        cue = stage.cue(now_ns, "localized", reason)
        if search.state_on_success == "pointing":
            return [cue, *stage.point(now_ns, reason, was_heard=search.state_on_failure == "pointing")]
        return [cue, *stage.rest(now_ns, "stopped", reason)]

    def _fail(self, search: LocalizationAttempt, now_ns: int, cue: Cue, reason: str) -> list[Output]:
        """End a search that came to nothing."""
        if search.state_on_failure == "pointing":
            return [self._stage.cue(now_ns, cue, reason), *self._stage.point(now_ns, reason, was_heard=True)]
        if search.purpose == "pose" and not search.is_joined:
            self._readiness.fail(now_ns)
        return self._stage.rest(now_ns, cue, reason)

    def _call_off(self, search: LocalizationAttempt, now_ns: int, *, is_for_good: bool) -> list[Output]:
        """End a search because the person does not want it."""
        reason = search.failure_reason("cancelled")
        if is_for_good or (search.purpose == "pose" and not search.is_joined):
            self._readiness.gesture(ends=True)
            return [self._cancel(), *self._stage.rest(now_ns, "stopped", reason)]
        return [self._cancel(), *self._fail(search, now_ns, "stopped", reason)]

    def _over(self, news: Localization, outputs: list[Output]) -> list[Output]:
        """Take note that it was over when the localizer said so: the next one may have begun right then."""
        self._stage.over_ns = min(self._stage.over_ns, news.stamp_ns)
        return outputs

    def _cancel(self) -> Cancel:
        self._calling_off += 1
        return Cancel()


def _is_same(a: ButtonEvent, b: ButtonEvent) -> bool:
    return (a.stamp_ns, a.seq, a.source, a.gesture) == (b.stamp_ns, b.seq, b.source, b.gesture)
