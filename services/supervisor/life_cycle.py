"""Runs the table of transitions for one person: presses, cues and progress in, messages and requests out."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import NS_PER_S, ButtonEvent, Feedback, ImuSample, Interaction, Localization, UserPose
from pointit.schemas.cues import MAX_FLASHES, SIGNS, Cue
from pointit.schemas.pointing import PressEffect, StepChoice
from pointit.schemas.selection import SelectionManner
from pointit.services.supervisor import transitions
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.localization_attempt import LocalizationAttempt
from pointit.services.supervisor.transitions import TABLE, Condition, Effect, Event, Stage

State = Literal["idle", "localizing", "pointing"]

LAST_WORD_PURPOSE = "interaction"
"""Name of the file of a person's last interaction."""
GRACE_NS = 2 * NS_PER_S
"""Time within which a requested localization begins, ns."""

UNSURE_YAW_RAD = math.radians(15.0)
"""Standard deviation of the yaw of the pose above which the person is asked to point at a lamp once, rad."""

RETRY_NS = 5 * NS_PER_S
"""Delay of an automatic start after localizing has failed, ns."""
SETTLE_NS = NS_PER_S
"""Time after the start for a known pose to arrive before autostart localizes the person, ns."""


class Readiness:
    """Decides if a sample may start or resume pointing."""

    def __init__(self, config: SupervisorConfig) -> None:
        self._autostarts = config.autostart
        self._resume_ns = round(config.resume_s * NS_PER_S)
        self.is_eager = config.autostart
        """True if a sample may start pointing. False after the person stopped."""
        self._not_before_ns = 0
        self._resume_until_ns: int | None = None

    def wait(self, until_ns: int) -> None:
        """Block starts until `until_ns`."""
        self._not_before_ns = until_ns

    def fail(self, now_ns: int) -> None:
        """Record that localizing has failed."""
        self._not_before_ns = now_ns + RETRY_NS

    def gesture(self, *, ends: bool) -> None:
        """Record a gesture. One that ends pointing disables the automatic start."""
        self.is_eager = self._autostarts and not ends
        self._resume_until_ns = None

    def on_interrupted(self, now_ns: int) -> None:
        """Record that pointing was interrupted against the person's intention."""
        self._resume_until_ns = now_ns + self._resume_ns

    def may_begin(self, now_ns: int) -> bool:
        """Return True if a sample may act like a press."""
        return self.is_eager and now_ns >= self._not_before_ns

    def may_resume(self, now_ns: int) -> bool:
        """Return True if a sample may resume pointing."""
        return self._resume_until_ns is not None and now_ns < self._resume_until_ns


class InteractionResume:
    """Keeps the last interaction of an earlier supervisor until the localizer's first message."""

    def __init__(self) -> None:
        self._interaction: Interaction | None = None

    def store(self, interaction: Interaction, now_ns: int) -> None:
        """Store the last interaction. One with a future stamp is ignored."""
        if interaction.stamp_ns > now_ns:
            return
        if self._interaction is None or interaction.stamp_ns > self._interaction.stamp_ns:
            self._interaction = interaction

    def forget(self) -> None:
        """Discard it, as the person has done something else."""
        self._interaction = None

    def resumable_activity(self, localization: Localization) -> Literal["", "localizing", "pointing"]:
        """Return the activity to resume after the localizer's message `localization`, or `""`. Works once."""
        interaction = self._interaction
        self._interaction = None
        if interaction is None or interaction.state == "idle":
            return ""
        if interaction.state == "pointing":
            return "pointing" if localization.stamp_ns <= interaction.stamp_ns else ""

        # The localizer goes on with what was begun before, if it is the same one
        latest_ns = interaction.stamp_ns + GRACE_NS
        is_same = localization.purpose == "pose" and 0 < localization.since_ns <= latest_ns
        if not is_same or localization.phase not in {"sampling", "solved"}:
            return ""
        return "localizing" if localization.phase == "sampling" else "pointing"


@dataclass(frozen=True)
class Guidance:
    """Next step of a set-up that leads the person, and the choices that they have."""

    text: str
    choices: tuple[StepChoice, ...] = ()


class InteractionPublisher:
    """Numbers states and cues, and skips unchanged states."""

    def __init__(self) -> None:
        self._shown: tuple[object, ...] | None = None
        self._seq = 0
        self._cues = 0
        self._flashes_ns = deque[int](maxlen=MAX_FLASHES)
        """Times of the last cues with a colour, ns."""

    def show(
        self,
        now_ns: int,
        state: State,
        reason: str,
        next_step: str,
        ahead: tuple[str, ...] = (),
        *,
        press: PressEffect,
        is_unsure: bool = False,
        is_advised: bool = False,
        guidance: Guidance | None = None,
    ) -> list[Interaction]:
        """Return the state of the interaction, unless it equals the last one."""
        # A number is used up only by a state that is published
        update = (state, reason, next_step, press, ahead, is_unsure, is_advised, guidance)
        if update == self._shown:
            return []
        self._seq += 1
        self._shown = update
        return [
            Interaction(
                stamp_ns=now_ns,
                seq=self._seq,
                state=state,
                next_step=next_step,
                press=press,
                reason=reason,
                ahead=ahead,
                is_unsure=is_unsure,
                is_advised=is_advised,
                is_guided=guidance is not None,
                choices=() if guidance is None else guidance.choices,
            )
        ]

    def cue(self, now_ns: int, cue: Cue, text: str, target_id: str = "", *, waits: bool = False) -> Feedback:
        """Return a cue. It comes without its colour if lamps would flash too often."""
        self._cues += 1
        sign = SIGNS[cue]._asdict()
        if not self._may_flash(now_ns):
            sign["color"] = None
        return Feedback(
            stamp_ns=now_ns, seq=self._cues, cue=cue, text=text, target_id=target_id, waits=waits, **sign
        )

    def _may_flash(self, now_ns: int) -> bool:
        flashes_ns = self._flashes_ns
        has_many = len(flashes_ns) == MAX_FLASHES
        if has_many and 0 <= now_ns - flashes_ns[0] < NS_PER_S:
            return False
        flashes_ns.append(now_ns)
        return True


@dataclass(frozen=True, slots=True)
class Start:
    """Request to localize the person, or to have them point at one lamp."""

    run: int
    """Number of the person's request. Replies to earlier ones are ignored."""
    is_anchor: bool = False


@dataclass(frozen=True, slots=True)
class Cancel:
    """Request to cancel, to be followed by `LifeCycle.on_cancel_reply`."""


Output = Interaction | Feedback | Start | Cancel


class LifeCycle:
    """Processes events with their time. Repeated events have no effect.

    Every state but idle has a deadline, at which `tick` must be called.
    """

    def __init__(self, config: SupervisorConfig) -> None:
        self._config = config
        self._stage: Stage = "idle"
        self._attempt: LocalizationAttempt | None = None
        """None in the stages `idle` and `pointing`."""
        self._reason = ""
        self._readiness = Readiness(config)
        self._earlier = InteractionResume()
        self._publisher = InteractionPublisher()

        # State of the person and their wrist
        self._pressed: tuple[int, int, str, str] | None = None
        """Stamp, number, source and gesture of the last press."""
        self._pose_ns: int | None = None
        """Stamp of the newest pose, ns. None: no pose is known."""
        self._is_unsure = False
        """True if the yaw of the pose is so uncertain that an anchor is needed."""
        self._imu_ns = 0
        """Time of the wrist's last sample, or of the start of listening, ns."""
        self._over_ns = 0
        """Time at which the last attempt ended, ns. Anything that began earlier is over."""

        # What the next step depends on
        self._manner: SelectionManner | None = None
        """Manner in which people select here, or None if no selector has published it."""
        self._advice: dict[str, str] = {}
        """Next steps of services that act on what the person does, while they point, by instance. The newest
        is shown."""
        self._guidance: dict[str, Guidance] = {}
        """Next steps of set-ups that lead the person, by instance. The newest is shown before all others."""
        self._hears_names = False
        """Names of objects are spoken to the person."""

        # Requests to the localizer
        self._runs = 0
        self._pending_cancels = 0
        """Number of requests to cancel without reply."""

    @property
    def state(self) -> State:
        """Return the state of the interaction."""
        return self._stage if self._stage in ("idle", "pointing") else "localizing"

    @property
    def run(self) -> int:
        """Return the number of the current request, or 0 if there is none."""
        return 0 if self._attempt is None else self._attempt.run

    @property
    def deadline_ns(self) -> int | None:
        """Return the latest time of the next `tick`, ns. None while idle."""
        if self._stage == "idle":
            return None
        if self._attempt is None:
            return self._silent_ns
        timeout_ns = round(self._config.localization_timeout_s * NS_PER_S)
        return min(self._silent_ns, self._attempt.counted_ns + timeout_ns)

    def begin(self, now_ns: int) -> list[Output]:
        """Return the first state."""
        until_ns = now_ns + SETTLE_NS if self._config.localize else now_ns
        self._readiness.wait(until_ns)
        return [*self._show_state(now_ns)]

    def resume_from(self, interaction: Interaction, now_ns: int) -> None:
        """Set the last state of an earlier supervisor. It may continue if the localizer is the same."""
        if self._stage == "idle" and self._pressed is None:
            self._earlier.store(interaction, now_ns)

    def button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Process a gesture."""
        pressed = (event.stamp_ns, event.seq, event.source, event.gesture)
        if pressed == self._pressed:
            return []
        self._pressed = pressed
        self._earlier.forget()
        return self._process_event(event.gesture, now_ns)

    def imu(self, sample: ImuSample, now_ns: int) -> list[Output]:
        """Record a sample of the wrist. A timely one may start pointing, or resume it."""
        self._imu_ns = now_ns
        if self._stage != "idle":
            return []
        is_timely = abs(now_ns - sample.stamp_ns) <= self._config.imu_timeout_s * NS_PER_S
        return self._process_event("sample", now_ns) if is_timely else []

    def pose(self, pose: UserPose, now_ns: int) -> list[Output]:
        """Set the person's pose."""
        self._pose_ns = pose.stamp_ns
        self._is_unsure = pose.method != "external" and pose.covariance[8] > UNSURE_YAW_RAD**2
        return [*self._show_state(now_ns)]

    def manner(self, manner: SelectionManner | None, now_ns: int) -> list[Output]:
        """Set how people select here, which the next step says."""
        self._manner = manner
        return [*self._show_state(now_ns)]

    def hear_names(self, now_ns: int) -> list[Output]:
        """Note that names of objects are spoken to the person."""
        self._hears_names = True
        return [*self._show_state(now_ns)]

    def localization(self, localization: Localization, now_ns: int) -> list[Output]:
        """Process the localizer's progress. Messages older than the current localization are ignored."""
        if self._attempt is not None:
            event = self._attempt.classify(localization, self._pose_ns)
        else:
            event = self._classify_unexpected(localization, now_ns)
        if event is None:
            return []
        reason = localization.reason if event in ("refused", "cancelled") else ""
        return self._process_event(event, now_ns, reason=reason, localization=localization)

    def on_start_accepted(self, run: int) -> list[Output]:
        """Process the reply to a `Start`. It is cancelled if the person rests again."""
        if self._stage == "idle":
            return self._apply_effect("cancel", "idle", 0)
        if self._attempt is not None and run == self._attempt.run:
            self._attempt.is_answered = True
        return []

    def on_start_failed(self, run: int, reason: str, now_ns: int) -> list[Output]:
        """Process the failure of a `Start`."""
        is_current = self._attempt is not None and run == self._attempt.run
        return self._process_event("rejected", now_ns, reason=reason) if is_current else []

    def on_cancel_reply(self, now_ns: int) -> None:
        """Process the reply to a `Cancel`, successful or not."""
        self._pending_cancels = max(0, self._pending_cancels - 1)
        if self._attempt is None:
            self._over_ns = max(self._over_ns, now_ns)

    def cue_of_text(self, text: str, now_ns: int) -> list[Output]:
        """Return the cue of a `text` for the person that is not about the life cycle.

        Its turn of 0 rad says that there is nothing to point at, as a missing one would.
        """
        cue = self._publisher.cue(now_ns, "target", text)
        return [cue.model_copy(update={"turn_rad": (0.0, 0.0)})]

    def advise(self, text: str, now_ns: int, service: str = "") -> list[Output]:
        """Set the next step of a person while they point, until `service` gives another one or ends."""
        self._advice.pop(service, None)
        self._advice[service] = text
        return [*self._show_state(now_ns)]

    def guide(self, guidance: Guidance, now_ns: int, service: str = "") -> list[Output]:
        """Set the next step of a person, also while they rest, until `service` gives another one or ends."""
        self._guidance.pop(service, None)
        self._guidance[service] = guidance
        return [*self._show_state(now_ns)]

    def end_advice(self, service: str, now_ns: int, text: str = "") -> list[Output]:
        """End the next step of `service`, if it is `text` or that is empty. Another service's shows again."""
        guidance = self._guidance.get(service)
        if guidance is not None and text in ("", guidance.text):
            del self._guidance[service]
        if service in self._advice and text in ("", self._advice[service]):
            del self._advice[service]
        return [*self._show_state(now_ns)]

    def tick(self, now_ns: int) -> list[Output]:
        """Advance to `now_ns` and end what has timed out."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        if now_ns >= self._silent_ns:
            reason = transitions.silent(self._config.imu_timeout_s)
            return self._process_event("silent", now_ns, reason=reason)
        reason = transitions.too_long(self._config.localization_timeout_s)
        return self._process_event("timeout", now_ns, reason=reason)

    @property
    def _silent_ns(self) -> int:
        return self._imu_ns + round(self._config.imu_timeout_s * NS_PER_S)

    def _classify_unexpected(self, localization: Localization, now_ns: int) -> Event | None:
        """Return the event of `localization` without an attempt. Those of others count with a target."""
        # An earlier supervisor had this person point, or have their place found
        activity = self._earlier.resumable_activity(localization) if self._stage == "idle" else ""
        if activity == "pointing":
            self._readiness.on_interrupted(now_ns)
            return None
        if activity == "localizing":
            return "recovered"

        # Another client has asked the localizer
        began_ns = localization.since_ns or localization.stamp_ns
        is_over = began_ns < self._over_ns or self._pending_cancels > 0
        if localization.phase != "sampling" or is_over:
            return None
        if not localization.target_id:
            return None
        return "anchor requested" if localization.purpose == "anchor" else "pose requested"

    def _holds(self, condition: Condition, now_ns: int) -> bool:
        is_known = self._pose_ns is not None
        needs_pose = not is_known or self._config.relocalize_each_time
        must_localize = self._config.localize and needs_pose
        match condition:
            case "localizes":
                return self._config.localize
            case "must localize":
                return must_localize
            case "no pose":
                return not is_known
            case "has pose":
                return is_known
            case "press ends":
                return self._is_end
            case "may start":
                return self._readiness.may_begin(now_ns)
            case "may resume":
                has_place = is_known and not must_localize
                return has_place and self._readiness.may_resume(now_ns)

    def _process_event(
        self, event: Event, now_ns: int, *, reason: str = "", localization: Localization | None = None
    ) -> list[Output]:
        """Make the transition of `event`, if there is one. `reason` replaces that of the table."""
        for row in TABLE[self._stage]:
            if event not in row.events:
                continue
            if all(self._holds(condition, now_ns) for condition in row.conditions):
                break
        else:
            return []

        # The stage changes first: effects and cues are those of the new one
        before = self._before_attempt
        self._reason = reason or row.reason or self._reason
        stage = before if row.then == "before" else row.then
        self._enter_stage(stage, now_ns, localization)
        outputs: list[Output] = []
        for effect in row.effects:
            outputs += self._apply_effect(effect, before, now_ns)
        outputs += self._closing_outputs(row.cue, now_ns, localization)
        return outputs

    @property
    def _before_attempt(self) -> Literal["idle", "pointing"]:
        stage = self._stage if self._attempt is None else self._attempt.before
        return "pointing" if stage == "pointing" else "idle"

    def _enter_stage(self, then: Stage, now_ns: int, localization: Localization | None) -> None:
        before = self._before_attempt
        since_ns = now_ns if localization is None else min(now_ns, localization.stamp_ns)
        if then not in ("idle", self._stage) and before == "idle":
            self._imu_ns = now_ns  # the silence counts from here, as there was no listening before
        if then in ("idle", "pointing"):
            if self._attempt is not None:
                self._over_ns = since_ns  # of the localizer, as the next attempt may have begun right then
            self._attempt = None
        elif self._attempt is None:
            self._attempt = LocalizationAttempt(
                stage=then, before=before, since_ns=since_ns, counted_ns=now_ns
            )
        self._stage = then

    def _apply_effect(self, effect: Effect, before: Stage, now_ns: int) -> list[Output]:
        """Change what samples may start. Return the request of `effect`, if it is one."""
        match effect:
            case "request pose" | "request anchor":
                self._runs += 1
                if self._attempt is not None:
                    self._attempt.on_request(self._runs)
                return [Start(self._runs, is_anchor=effect == "request anchor")]
            case "cancel":
                self._pending_cancels += 1
                return [Cancel()]
            case "allow autostart" | "forbid autostart":
                self._readiness.gesture(ends=effect == "forbid autostart")
            case "retry later":
                self._readiness.fail(now_ns)
            case "resume soon":
                if before == "pointing":
                    self._readiness.on_interrupted(now_ns)
        return []

    def _closing_outputs(
        self, outcome: Cue | Literal[""], now_ns: int, localization: Localization | None
    ) -> list[Output]:
        attempt = self._attempt
        cue = self._publisher.cue

        # No attempt is running: cues of what has ended, if any, and of what has begun
        if attempt is None:
            last: Cue = "stopped"
            if self._stage == "pointing":
                last = "started"
            elif outcome == "refused":
                last = "refused"
            text = self._pointing if last == "started" else self._reason
            outputs: list[Output] = []
            if outcome and outcome != last:
                outputs.append(cue(now_ns, outcome, self._reason))
            outputs += self._show_state(now_ns)
            outputs.append(cue(now_ns, last, text))
            return outputs

        # An attempt is running: the state names the target before its cue is played
        is_target_due = localization is not None and attempt.follow(localization, now_ns)
        outputs = [*self._show_state(now_ns)]
        target = attempt.target_id
        next_cue: Cue | Literal[""] = outcome
        if not next_cue and is_target_due:
            next_cue = "target"
        if next_cue:
            outputs.append(cue(now_ns, next_cue, attempt.next_step, target, waits=not target))
        return outputs

    def _show_state(self, now_ns: int) -> list[Interaction]:
        ahead = () if self._attempt is None else self._attempt.ahead
        is_pointing = self._stage == "pointing"
        is_unsure = is_pointing and self._is_unsure
        has_advice = is_pointing and bool(self._advice)
        return self._publisher.show(
            now_ns,
            self.state,
            self._reason,
            self._next_step,
            ahead,
            press=self._press,
            is_unsure=is_unsure,
            is_advised=has_advice and not is_unsure,
            guidance=self._guides,
        )

    @property
    def _guides(self) -> Guidance | None:
        """Return the newest guidance, unless the person is being localized."""
        if self._attempt is not None:
            return None
        return next(reversed(self._guidance.values()), None)

    @property
    def _next_step(self) -> str:
        if self._attempt is not None:
            return self._attempt.next_step
        if self._guides is not None:
            return self._guides.text
        if self._stage == "pointing":
            return transitions.POINT_AT_LAMP if self._is_unsure else self._pointing
        return transitions.rest(
            localizes=self._config.localize,
            is_place_known=self._pose_ns is not None,
            follows_robot=self._config.localization_method == "moving_target",
            is_eager=self._readiness.is_eager,
        )

    @property
    def _pointing(self) -> str:
        usual = transitions.point(is_end=self._is_end, manner=self._manner, hears_names=self._hears_names)
        return next(reversed(self._advice.values()), usual)

    @property
    def _press(self) -> PressEffect:
        return transitions.press_effect(
            self._stage, is_end=self._is_end, manner=self._manner, hears_names=self._hears_names
        )

    @property
    def _is_end(self) -> bool:
        """True if a press while pointing ends it."""
        return self._config.press_while_pointing == "ends"
