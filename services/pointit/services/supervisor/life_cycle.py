"""The life cycle of a pointing-based interaction (paper, §II-D), for one person.

idle --button--> localizing --solved--> pointing --button--> idle
idle --button--> pointing                        when the person's place is known
localizing --button, refusal, time-out, silent wrist--> idle
pointing --silent wrist--> idle
pointing, idle --double press, or somebody else's request--> localizing --in any case--> back where it was,
    or idle when the wrist is silent: pointing at one lamp sets the pose right (an anchor), and while it is
    pointed at no cursor is shown

With `autostart` a sample of the wrist does in idle what the button does, unless a press led there.
"""

import math
from dataclasses import dataclass

from pointit.schemas import NS_PER_S, ButtonEvent, Feedback, ImuSample, Interaction, Localization, UserPose
from pointit.services.supervisor import sentences
from pointit.services.supervisor.voice import Cue, State, Voice

SETTLE_NS = NS_PER_S
"""After the begin, how long the person's place may take to come before they are localized unasked."""


@dataclass(frozen=True, slots=True)
class Start:
    """Ask the localizer to begin."""

    run: int
    """Which of the person's localizations it is; answers to earlier ones do not count any more."""


@dataclass(frozen=True, slots=True)
class StartAnchor:
    """Ask the localizer to have the person point at one lamp."""

    run: int
    """As in `Start`."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """Ask the localizer to stop."""


Output = Interaction | Feedback | Start | StartAnchor | Cancel


class LifeCycle:
    """Takes what happens, with the time, and gives what to say and to ask for.

    Whatever is told twice changes nothing the second time. Every state but idle has a deadline; call
    `pass_time` when it is reached.
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
        unsure_rad: float = math.radians(15.0),
    ) -> None:
        self.state: State = "idle"
        self._localizes = localize
        self._each_time = localize and relocalize_each_time
        self._follows_robot = follows_robot
        self._timeout_s = localization_timeout_s
        self._silence_s = imu_timeout_s
        self._retry_ns = round(retry_s * NS_PER_S)
        self._is_eager = autostart
        """Whether the next sample may begin; not after the person stopped themselves."""
        self._autostarts = autostart
        self._not_before_ns = 0
        self._button: ButtonEvent | None = None
        self._pose_ns: int | None = None
        self._unsure_variance = unsure_rad**2
        self._is_unsure = False
        """Whether the yaw of the pose is so uncertain that an anchor is wanted."""
        self._heard_ns = 0
        self._run = 0
        self._run_ns = 0
        self._is_answered = False
        self._target = ""
        """The next step while localizing."""
        self._reason = ""
        self._back: State | None = None
        """While an anchor is pointed at: where it goes on afterwards."""
        self._anchored_ns = 0
        """When the last anchor ended here; what began before is over."""
        self._now_ns = 0
        self._voice = Voice()

    @property
    def run(self) -> int:
        """Return the number of the current localization, or 0 when there is none."""
        return self._run if self.state == "localizing" else 0

    @property
    def deadline_ns(self) -> int | None:
        """Return when `pass_time` must be called at the latest; none while idle."""
        if self.state == "idle":
            return None
        silent_ns = self._heard_ns + round(self._silence_s * NS_PER_S)
        if self.state == "pointing":
            return silent_ns
        return min(silent_ns, self._run_ns + round(self._timeout_s * NS_PER_S))

    def begin(self, now_ns: int) -> list[Output]:
        """Say the first state."""
        self._not_before_ns = now_ns + SETTLE_NS if self._localizes else now_ns
        return [*self._show(now_ns)]

    def button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Take a press: it starts what is not going on and ends what is.

        `hold` localizes anew, where the person localizes at all; `double` sets the pose right by an anchor.
        Every gesture calls off what the localizer does. Nothing begins by itself after a gesture that ends.
        """
        self._mind_clock(now_ns)
        if self._button is not None and _is_same(event, self._button):
            return []
        self._button = event
        if self._back is not None:
            return [Cancel(), *self._go_back(self._back, now_ns, "stopped", sentences.ANCHOR_CANCELLED)]
        if event.gesture == "double" and self.state != "localizing":
            return self._ask_anchor(now_ns)
        ends = self.state == "localizing"
        ends = ends or (self.state == "pointing" and not (event.gesture == "hold" and self._localizes))
        self._is_eager = self._autostarts and not ends
        if self.state == "localizing":
            return [Cancel(), *self._rest(now_ns, "stopped", sentences.CANCELLED)]
        if event.gesture == "hold" and self._localizes:
            return self._localize(now_ns)
        if self.state == "pointing":
            return self._rest(now_ns, "stopped", sentences.STOPPED)
        if self._pose_ns is None and not self._localizes:
            return self._rest(now_ns, "refused", sentences.NO_POSE)
        return self._start(now_ns)

    def imu(self, sample: ImuSample, now_ns: int) -> list[Output]:
        """Take note that the wrist is heard; with `autostart` a timely sample begins."""
        self._mind_clock(now_ns)
        self._heard_ns = now_ns
        if self.state != "idle" or not self._is_eager or now_ns < self._not_before_ns:
            return []
        is_timely = abs(now_ns - sample.stamp_ns) <= self._silence_s * NS_PER_S
        if not is_timely or (self._pose_ns is None and not self._localizes):
            return []
        return self._start(now_ns)

    def pose(self, pose: UserPose, now_ns: int) -> list[Output]:
        """Take the person's place."""
        self._pose_ns = pose.stamp_ns
        self._is_unsure = pose.method != "external" and pose.covariance[8] > self._unsure_variance
        return [*self._show(now_ns)]

    def localization(self, news: Localization, now_ns: int) -> list[Output]:
        """Take the localizer's progress; what is older than the current localization is left out."""
        self._mind_clock(now_ns)
        if self.state != "localizing":
            return self._join_anchor(news, now_ns)
        if news.stamp_ns < self._run_ns:
            return []
        if self._back is not None:
            return self._anchor(self._back, news, now_ns)
        return [] if news.purpose == "anchor" else self._find(news, now_ns)

    def _mind_clock(self, now_ns: int) -> None:
        """Move all that was noted back with a clock that was set back, or it would be to come for so long."""
        back_ns, self._now_ns = self._now_ns - now_ns, now_ns
        if back_ns > NS_PER_S:
            self._heard_ns -= back_ns
            self._run_ns -= back_ns
            self._not_before_ns -= back_ns
            self._anchored_ns = 0

    def _find(self, news: Localization, now_ns: int) -> list[Output]:
        """Take news while the place is looked for."""
        if news.phase == "sampling":
            return self._aim(news, now_ns)
        if news.phase == "solved":
            return self._localized(now_ns)
        if news.phase == "refused":
            return self._fail(now_ns, "refused", news.reason or sentences.REFUSED)
        if not self._is_answered:  # cancelled or idle before it heard of this run
            return []
        if news.phase == "cancelled":
            return self._fail(now_ns, "stopped", news.reason or sentences.CANCELLED)
        if self._pose_ns is not None and self._pose_ns >= self._run_ns:  # idle again: solved unseen
            return self._localized(now_ns)
        start = self._ask()  # idle, as if it had never heard of us
        self._reason = sentences.AGAIN
        return [start, *self._show(now_ns)]

    def answered(self, run: int) -> list[Output]:
        """Take the localizer's consent to a `Start`; it is called off when the person rests again."""
        if self.state == "idle":
            return [Cancel()]
        self._is_answered = self._is_answered or run == self._run
        return []

    def not_started(self, run: int, reason: str, now_ns: int) -> list[Output]:
        """Take why a `Start` came to nothing."""
        if self.state != "localizing" or run != self._run:
            return []
        if self._back is not None:
            return self._go_back(self._back, now_ns, "refused", reason)
        return self._fail(now_ns, "refused", reason)

    def pass_time(self, now_ns: int) -> list[Output]:
        """Go on to `now_ns`: what took too long ends."""
        self._mind_clock(now_ns)
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        is_silent = now_ns >= self._heard_ns + round(self._silence_s * NS_PER_S)
        if not is_silent and self._back is not None:
            too_long = sentences.too_long(self._timeout_s)
            return [Cancel(), *self._go_back(self._back, now_ns, "refused", too_long)]
        if not is_silent:
            return [Cancel(), *self._fail(now_ns, "refused", sentences.too_long(self._timeout_s))]
        reason = sentences.silent(self._silence_s)
        if self.state == "localizing":
            return [Cancel(), *self._rest(now_ns, "refused", reason)]
        return self._rest(now_ns, "stopped", reason)

    @property
    def _is_place_known(self) -> bool:
        return self._pose_ns is not None and not self._each_time

    def _start(self, now_ns: int) -> list[Output]:
        if self._localizes and not self._is_place_known:
            return self._localize(now_ns)
        return self._point(now_ns, sentences.PLACE_KNOWN)

    def _localize(self, now_ns: int) -> list[Output]:
        self.state = "localizing"
        self._reason = sentences.ASKED
        self._heard_ns = self._run_ns = now_ns  # both waits count from here
        start = self._ask()
        return [start, *self._show(now_ns), self._cue(now_ns, "started", sentences.WAIT)]

    def _ask(self) -> Start:
        self._run += 1
        self._is_answered = False
        self._target = sentences.WAIT
        return Start(self._run)

    def _ask_anchor(self, now_ns: int) -> list[Output]:
        if self._pose_ns is None:
            return self._rest(now_ns, "refused", sentences.NO_POSE_TO_ANCHOR)
        self._begin_anchor(now_ns, now_ns, sentences.ANCHOR_ASKED)
        cue = self._cue(now_ns, "started", sentences.WAIT)
        return [StartAnchor(self._run), *self._show(now_ns), cue]

    def _join_anchor(self, news: Localization, now_ns: int) -> list[Output]:
        """Follow an anchor that somebody else has asked for."""
        began_ns = news.since_ns or news.stamp_ns
        if news.purpose != "anchor" or news.phase != "sampling" or began_ns < self._anchored_ns:
            return []
        self._begin_anchor(now_ns, min(news.stamp_ns, now_ns), sentences.ANCHOR_ASKED_FOR)
        self._is_answered = True
        return self._aim(news, now_ns)

    def _begin_anchor(self, now_ns: int, since_ns: int, reason: str) -> None:
        if self.state == "idle":  # the silence counts from here, as nobody listened before
            self._heard_ns = now_ns
        self._back = self.state
        self.state = "localizing"
        self._reason = reason
        self._run_ns = since_ns
        self._run += 1
        self._is_answered = False
        self._target = sentences.WAIT

    def _anchor(self, back: State, news: Localization, now_ns: int) -> list[Output]:
        """Take news while an anchor is pointed at."""
        if news.purpose == "anchor":
            if news.phase == "sampling":
                return self._aim(news, now_ns)
            if news.phase == "solved":
                return self._over(news, self._go_back(back, now_ns, "localized", sentences.ANCHORED))
            if news.phase == "refused":
                reason = news.reason or sentences.ANCHOR_REFUSED
                return self._over(news, self._go_back(back, now_ns, "refused", reason))
        if not self._is_answered:  # of what was before ours
            return []
        if news.purpose == "anchor" and news.phase == "cancelled":
            reason = news.reason or sentences.ANCHOR_CANCELLED
            return self._over(news, self._go_back(back, now_ns, "stopped", reason))
        return self._go_back(back, now_ns, "refused", sentences.ANCHOR_LOST)

    def _over(self, news: Localization, outputs: list[Output]) -> list[Output]:
        """Take note that it was over when the localizer said so: the next one may have begun right then."""
        self._anchored_ns = min(self._anchored_ns, news.stamp_ns)
        return outputs

    def _go_back(self, back: State, now_ns: int, cue: Cue, reason: str) -> list[Output]:
        self._anchored_ns = now_ns
        self._back = None
        self.state = back
        self._reason = reason
        return [self._cue(now_ns, cue, reason), *self._show(now_ns)]

    def _aim(self, news: Localization, now_ns: int) -> list[Output]:
        target = sentences.aim(news) if news.target_id else self._target
        if target == self._target:
            return [*self._show(now_ns)]
        self._target = target
        return [*self._show(now_ns), self._cue(now_ns, "target", target)]

    def _localized(self, now_ns: int) -> list[Output]:
        cue = self._cue(now_ns, "localized", sentences.LOCALIZED)
        return [cue, *self._point(now_ns, sentences.LOCALIZED)]

    def _point(self, now_ns: int, reason: str) -> list[Output]:
        self.state = "pointing"
        self._reason = reason
        self._heard_ns = now_ns  # the silence counts from here
        return [*self._show(now_ns), self._cue(now_ns, "started", sentences.POINT)]

    def _fail(self, now_ns: int, cue: Cue, reason: str) -> list[Output]:
        self._not_before_ns = now_ns + self._retry_ns
        return self._rest(now_ns, cue, reason)

    def _rest(self, now_ns: int, cue: Cue, reason: str) -> list[Output]:
        if self._back is not None:
            self._anchored_ns = now_ns
        self.state = "idle"
        self._back = None
        self._reason = reason
        return [*self._show(now_ns), self._cue(now_ns, cue, reason)]

    def _show(self, now_ns: int) -> list[Interaction]:
        return self._voice.show(now_ns, self.state, self._reason, self._next_step())

    def _next_step(self) -> str:
        if self.state == "localizing":
            return self._target
        if self.state == "pointing":
            return sentences.POINT_AT_LAMP if self._is_unsure else sentences.POINT
        return sentences.rest(
            localizes=self._localizes,
            is_place_known=self._is_place_known,
            follows_robot=self._follows_robot,
            is_eager=self._is_eager,
        )

    def _cue(self, now_ns: int, cue: Cue, text: str) -> Feedback:
        return self._voice.cue(now_ns, cue, text)


def _is_same(a: ButtonEvent, b: ButtonEvent) -> bool:
    return (a.stamp_ns, a.seq, a.source, a.gesture) == (b.stamp_ns, b.seq, b.source, b.gesture)
