"""Localization procedures of one person, at most one at a time.

Pure: messages, requests and the time go in; outputs to publish come out.
"""

from collections.abc import Sequence
from dataclasses import replace

from pointit.schemas import (
    NS_PER_S,
    Anchor,
    Environment,
    Lamp,
    Localization,
    PointingRay,
    TrackedObjects,
    UserPose,
)
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import LampSwitch, Output
from pointit.services.localizer.procedures import lamps as lamp_choice
from pointit.services.localizer.procedures.anchoring import Anchoring
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure
from pointit.services.localizer.procedures.lamp_queue import LampQueue, queue_timeout_message
from pointit.services.localizer.procedures.moving_target import MovingTarget
from pointit.services.localizer.procedures.next_target import ObservationModel, best_for_yaw
from pointit.services.localizer.procedures.queued_pointing import Make, PointingRequest, QueuedPointing
from pointit.services.localizer.procedures.static_targets import StaticTargets
from pointit.services.localizer.tracking.pose_tracking import PoseTracker

REPUBLISH_NS = NS_PER_S
"""Period at which progress or waiting is published again and the lamp is switched on again."""


class ProcedureRunner:
    """Creates procedures, runs one at a time, and passes their poses to the tracker."""

    def __init__(self, user: str, config: LocalizerConfig, tracking: PoseTracker) -> None:
        self._user = user
        self._config = config
        self._tracking = tracking
        self._room: Environment | None = None
        self._turns = LampQueue(user)
        self._wish: PointingRequest | None = None
        """The request whose lamps are pointed at."""
        self._running: LampProcedure | MovingTarget | QueuedPointing | None = None
        self._published_ns = 0

    @property
    def is_busy(self) -> bool:
        """Return True if a procedure runs or waits and needs steps."""
        return self._running is not None

    @property
    def is_localizing(self) -> bool:
        """Return True if a procedure for a pose, rather than an anchor, runs or waits."""
        running = self._running
        if isinstance(running, QueuedPointing):
            return running.purpose == "pose"
        return running is not None and not isinstance(running, Anchoring)

    @property
    def is_following(self) -> bool:
        """Return True if the arm follows a moving target."""
        return isinstance(self._running, MovingTarget)

    @property
    def ahead(self) -> tuple[str, ...]:
        """Return the users who come first, or () if the person does not wait."""
        return self._running.ahead if isinstance(self._running, QueuedPointing) else ()

    @property
    def lit(self) -> str:
        """Return the id of the lamp that is lit, or `""` if none is."""
        return self._running.lit if isinstance(self._running, LampProcedure) else ""

    def on_map(self, room: Environment, now_ns: int) -> list[Output]:
        """Update the map. Switch off lamps that a killed localizer left lit, unless another person uses them.

        Pointing at a lamp that has moved or is gone stops, since it gives no information.
        """
        is_first, self._room = self._room is None, room
        running = self._running
        if isinstance(running, QueuedPointing):
            made = running.wish.make(now_ns)
            if isinstance(made, Refusal):
                return self._leave_queue(running, now_ns, made.reason)
            running.lamp_ids = made.lamp_ids
            return self._wait_on(running, now_ns)
        if isinstance(running, LampProcedure):
            change = lamp_choice.map_change_reason(running.targets, room)
            reason = f"the map changed while {self._user} was pointing at its lamps: {change}; start again"
            return self.stop(now_ns, reason) if change else []
        if not is_first or self._config.method != "static_targets" or running is not None:
            return []
        wanted = self._config.lamps
        ids = [lamp.id for lamp in room.lamps if not wanted or lamp.id in wanted]
        return [] if self._turns.pointing(ids, now_ns) else [LampSwitch(lamp_id, on=False) for lamp_id in ids]

    def on_localization(self, news: Localization, user: str, now_ns: int) -> list[Output]:
        """Update the queue from other people's localizations: lamps go to who asked first."""
        if user == self._user:
            return []
        return self._on_queue_changed(now_ns, has_ended=self._turns.on_localization(user, news, now_ns))

    def on_absence(self, user: str, now_ns: int) -> list[Output]:
        """Remove `user`, who or whose localizer has left, from the queue."""
        if user == self._user or not self._turns.leave(user):
            return []
        return self._on_queue_changed(now_ns, has_ended=True)

    def on_ray(self, ray: PointingRay) -> None:
        """Process a ray of the person."""
        if self._running is not None and not isinstance(self._running, QueuedPointing):
            self._running.on_ray(ray)

    def on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        """Process positions of tracked objects."""
        if isinstance(self._running, MovingTarget):
            self._running.on_objects(tracker, objects)

    def on_yaw_origin_changed(self, now_ns: int) -> list[Output]:
        """Restart or refuse, because rays of two yaw origins cannot be combined."""
        running = self._running
        if running is None or isinstance(running, QueuedPointing):
            return []
        if isinstance(running, MovingTarget):
            return running.start(now_ns)
        reason = f"the IMU of {self._user} was restarted or turned meanwhile; start again"
        return self._process_outputs(running.refuse(now_ns, reason), now_ns)

    def step(self, now_ns: int) -> list[Output]:
        """Advance the running or waiting procedure, if there is one."""
        running = self._running
        if running is None:
            return []
        if isinstance(running, QueuedPointing):
            return self._wait_on(running, now_ns)
        out = self._process_outputs(running.step(now_ns), now_ns)
        if isinstance(self._running, LampProcedure) and abs(now_ns - self._published_ns) >= REPUBLISH_NS:
            out += self._republish(self._running, now_ns)
        return out

    def start_moving_target(self, now_ns: int) -> list[Output]:
        """Start following a robot; stop the procedure that runs."""
        out = self.stop(now_ns)
        self._running = MovingTarget(self._config)
        self._tracking.end_rest()
        return [*out, *self._running.start(now_ns)]

    def start_static_targets(self, now_ns: int) -> list[Output] | Refusal:
        """Start pointing at lamps, or wait for them, instead of the running procedure; or refuse."""
        return self._ask(self._static, now_ns)

    def anchor(self, lamp_id: str, eyes_m: float, now_ns: int) -> list[Output] | Refusal:
        """Start pointing at lamp `lamp_id` (`""`: the most informative one), or wait for it.

        A pose must be known.
        """
        return self._ask(lambda then_ns: self._anchoring(lamp_id, eyes_m, then_ns), now_ns)

    def stop(self, now_ns: int, reason: str = "") -> list[Output]:
        """Stop the running procedure, lamps off."""
        running = self._running
        if isinstance(running, QueuedPointing):
            self._running = None
            return [running.end("cancelled", now_ns, reason)]
        return [] if running is None else self._process_outputs(running.cancel(now_ns, reason), now_ns)

    def _ask(self, make: Make, now_ns: int) -> list[Output] | Refusal:
        procedure = make(now_ns)
        if isinstance(procedure, Refusal):
            return procedure
        out = self.stop(now_ns)
        wish = PointingRequest(make, now_ns)
        ahead = self._turns.ahead(procedure.lamp_ids, wish.since_ns, now_ns)
        return [*out, *(self._queue(wish, procedure, ahead, now_ns) or self._begin(wish, procedure, now_ns))]

    def _queue(
        self, wish: PointingRequest, procedure: LampProcedure, ahead: tuple[str, ...], now_ns: int
    ) -> list[Output]:
        """Wait if there are users `ahead`, otherwise do nothing."""
        if not ahead:
            return []
        waiting = QueuedPointing(wish, procedure, now_ns, self._config.queue_timeout_s)
        self._running, self._published_ns = waiting, now_ns
        return [waiting.say(ahead, now_ns)]

    def _begin(self, wish: PointingRequest, procedure: LampProcedure, now_ns: int) -> list[Output]:
        self._wish, self._running, self._published_ns = wish, procedure, now_ns
        return procedure.start(now_ns, wish.since_ns)

    def _wait_on(self, waiting: QueuedPointing, now_ns: int) -> list[Output]:
        """Begin when it is their turn; publish the users ahead when they change, and periodically."""
        is_too_long = waiting.is_too_long(now_ns)
        wish = waiting.wish
        ahead = self._turns.ahead(waiting.lamp_ids, wish.since_ns, now_ns)
        if not ahead:
            procedure = wish.make(now_ns)
            if isinstance(procedure, Refusal):
                return self._leave_queue(waiting, now_ns, procedure.reason)
            return self._begin(wish, procedure, now_ns)
        if is_too_long:
            reason = queue_timeout_message(self._user, ahead, self._config.queue_timeout_s)
            return self._leave_queue(waiting, now_ns, reason)
        if ahead == waiting.ahead and abs(now_ns - self._published_ns) < REPUBLISH_NS:
            return []
        self._published_ns = now_ns
        return [waiting.say(ahead, now_ns)]

    def _leave_queue(self, waiting: QueuedPointing, now_ns: int, reason: str) -> list[Output]:
        self._running = None
        return [waiting.end("refused", now_ns, reason)]

    def _on_queue_changed(self, now_ns: int, *, has_ended: bool) -> list[Output]:
        """Begin, or yield the lamps, after a change of the queue."""
        running, wish = self._running, self._wish
        if isinstance(running, QueuedPointing):
            return self._wait_on(running, now_ns)
        if not isinstance(running, LampProcedure) or wish is None:
            return []
        first = self._turns.must_yield_to(running.lamp_ids, running.since_ns, running.begun_ns, now_ns)
        if first:
            again = replace(wish, since_ns=running.since_ns)
            return [*running.stop_silently(), *self._queue(again, running, first, now_ns)]
        return self._republish(running, now_ns) if has_ended else []  # our lamp may be off

    def _static(self, _now_ns: int) -> StaticTargets | Refusal:
        lamps = lamp_choice.lamps_for_pose(self._room, self._config)
        return lamps if isinstance(lamps, Refusal) else StaticTargets(lamps, self._config)

    def _anchoring(self, lamp_id: str, eyes_m: float, now_ns: int) -> Anchoring | Refusal:
        config = self._config
        lamps = lamp_choice.lamp_for_anchor(self._room, config.lamps, lamp_id)
        if isinstance(lamps, Refusal):
            return lamps
        occupied = set(config.lamps)
        if not occupied and self._room is not None:  # all: another lit lamp would mislead
            occupied = {lamp.id for lamp in self._room.lamps}
        lamp = self._most_informative(lamps, eyes_m, now_ns)
        return Anchoring(lamp, self._tracking.anchor, config, occupies=occupied)

    def _most_informative(self, lamps: Sequence[Lamp], eyes_m: float, now_ns: int) -> Lamp:
        """Return the lamp that is most informative about the yaw."""
        place, covariance = self._tracking.uncertainty(now_ns)
        drift = self._config.drift.settings()
        acuity = ObservationModel(
            ray_sigma_rad=drift.anchor_sigma_rad,
            elevation_sigma_rad=drift.elevation_sigma_rad,
            eyes_m=eyes_m,
        )
        places = [lamp.position_m for lamp in lamps]
        return lamps[best_for_yaw(places, place, covariance, acuity, floor_m=self._config.floor_m)]

    def _republish(self, procedure: LampProcedure, now_ns: int) -> list[Output]:
        self._published_ns = now_ns
        return procedure.republish(now_ns)

    def _process_outputs(self, outputs: Sequence[Output], now_ns: int) -> list[Output]:
        """Return a procedure's outputs, its pose as tracked; drop a procedure that has ended."""
        running, out = self._running, list[Output]()
        for output in outputs:
            if isinstance(output, UserPose) and isinstance(running, StaticTargets | MovingTarget):
                out.append(self._tracking.set_localized(output, *running.times_ns, now_ns))
                continue
            out.append(output)
            if isinstance(output, Anchor) and output.accepted:
                pose = self._tracking.pose(now_ns)
                out += [] if pose is None else [pose]
        if isinstance(running, LampProcedure | MovingTarget) and not running.running:
            self._running = None
        return out
