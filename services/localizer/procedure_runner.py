"""Localization procedures of one person, at most one at a time.

Pure: messages, requests and the time go in; outputs to publish come out.

`Anchoring` corrects the pose by pointing at one lamp, or robot whose position is known (pointing.md
§3, §4). A queued request waits for its turn at the lamps, which led-driver decides.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.schemas import (
    NS_PER_S,
    Anchor,
    Environment,
    Lamp,
    LampLease,
    LampLeases,
    PointingRay,
    RobotState,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.text import round_beyond
from pointit.services.localizer import static_targets as lamp_choice
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import unfiltered_rays
from pointit.services.localizer.estimation.bias_memory import BiasMemory
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.estimation.unfiltered_rays import Mean
from pointit.services.localizer.moving_target import ROBOT, MovingTarget
from pointit.services.localizer.outputs import AnchorOutcome, Output, Phase
from pointit.services.localizer.procedure import LampProcedure, Procedure
from pointit.services.localizer.static_targets import ObservationModel, StaticTargets, best_for_yaw
from pointit.services.localizer.tracking import PoseTracker

Make = Callable[[int], LampProcedure | Refusal]
"""Creates the procedure when it is its turn, from the map and the pose of that time (ns), or a refusal."""

QUEUE_TIMEOUT_S = 300.0
"""Limit of the wait for lamps that other people use, s."""
MIN_RAYS = 10
"""Rays that an anchor needs."""

MAX_SPREAD_DEG = 3.0
"""Rms by which an arm may wander at an anchor, degrees."""

MAX_ROBOT_AGE_S = 1.0
"""Age of a report at which a robot's place is unknown."""

STANDS_MPS = 0.1
"""Speed below which a robot stands: pointing at it takes seconds."""

STAYS_M = 0.1
"""Distance by which a robot may move while it is pointed at."""

MAX_SIGMA_M = 0.2
"""Uncertainty of a place at which pointing is no measure, 1 sigma."""

MAX_ROBOTS = 256
"""Largest number of robots; those reported last are kept."""

REPUBLISH_NS = NS_PER_S
"""Period at which progress or waiting is published again, from which led-driver knows that it goes on."""

ARBITER_TIMEOUT_NS = 10 * NS_PER_S
"""Time for led-driver to come back, before people who wait begin as if alone, ns."""


class QueuedPointing(Procedure):
    """A place in the queue; it lights no lamp."""

    def __init__(self, make: Make, procedure: LampProcedure, config: LocalizerConfig) -> None:
        super().__init__(config)
        self.make = make
        self.lamp_ids = procedure.lamp_ids
        self.ahead: tuple[str, ...] = ()
        """Users ahead as published last."""
        self.purpose = procedure.purpose
        self._until_ns = 0

    def is_too_long(self, now_ns: int) -> bool:
        """Return True if the limit is reached."""
        return now_ns >= self._until_ns

    def say(self, ahead: tuple[str, ...], now_ns: int) -> list[Output]:
        """Return a message that the person waits for `ahead`."""
        self.ahead = ahead
        return [self._localization(now_ns, "sampling")]

    def refuse(self, now_ns: int, reason: str) -> list[Output]:
        """Return a message that the person waits no longer."""
        return self._end(now_ns, "refused", reason)

    def on_yaw_origin_changed(self, now_ns: int, reason: str) -> list[Output]:
        """Go on waiting, since no ray was used."""
        del now_ns, reason
        return []

    def _begin(self, now_ns: int) -> list[Output]:
        self._until_ns = now_ns + round(QUEUE_TIMEOUT_S * NS_PER_S)
        return [self._localization(now_ns, "sampling")]

    def _continue(self, now_ns: int) -> list[Output]:
        del now_ns  # the runner knows whose turn it is
        return []

    def _details(self, phase: Phase) -> dict[str, Any]:
        return {"ahead": self.ahead, "lamps": self.lamp_ids} if phase == "sampling" else {}


class Anchoring(LampProcedure):
    """One pointing at one lamp."""

    purpose = "anchor"

    def __init__(
        self,
        lamp: Lamp,
        judge: Callable[[Lamp, Mean, str, int], AnchorOutcome],
        config: LocalizerConfig,
        *,
        occupies: Iterable[str] = (),
        is_robot: bool = False,
    ) -> None:
        """Create the procedure.

        Args:
            lamp: to point at.
            judge: applies the anchor of a lamp and a mean ray, and returns the outcome. The text is the
                reason to reject it or `""`, the number is the time, ns.
            config: times and limits of the hold.
            occupies: ids of lamps that other people cannot use meanwhile, besides `lamp`.
            is_robot: `lamp` is the place of a robot, which several people may point at.
        """
        lamp_ids = list(occupies)
        if not is_robot:
            lamp_ids.append(lamp.id)
        super().__init__(lamp_ids, config, MIN_RAYS, "ask again")
        self._is_robot = is_robot
        self._target = lamp
        self._judge = judge

    @property
    def targets(self) -> Sequence[Lamp]:
        """Return the one lamp."""
        return () if self._is_robot else (self._target,)

    def _next_lamp(self) -> Lamp:
        return self._target

    def _held(self, now_ns: int) -> list[Output]:
        mean = unfiltered_rays.mean(self._hold.rays)
        if mean is None:
            return self._end(
                now_ns, "refused", "the rays point in all directions; hold the arm still and try again"
            )
        spread_deg = math.degrees(mean.spread_rad)
        problem = ""
        if spread_deg > MAX_SPREAD_DEG:
            problem = (
                f"the arm wandered by {round_beyond(spread_deg, MAX_SPREAD_DEG)}° while {self._lamp.id} was "
                f"lit and at most {MAX_SPREAD_DEG:.1f}° is accepted; hold it still and try again"
            )
        outcome = self._judge(self._lamp, mean, problem, now_ns)
        anchor = outcome.anchor
        if not outcome.is_done:
            return [anchor, *self._end(now_ns, "refused", anchor.reason)]
        self._running = False
        return [anchor, self._localization(now_ns, "solved", progress=1.0, reason=anchor.reason)]


@dataclass(frozen=True)
class _Seen:
    stamp_ns: int
    robot: TrackedObject


class KnownRobots:
    """The newest report of every robot."""

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}

    def on_objects(self, message: TrackedObjects) -> None:
        """Update the robots of a tracker."""
        for item in message.objects:
            if item.kind == ROBOT:
                self._seen.pop(item.id, None)
                self._seen[item.id] = _Seen(message.stamp_ns, item)
        while len(self._seen) > MAX_ROBOTS:
            del self._seen[next(iter(self._seen))]

    def __contains__(self, robot: str) -> bool:
        """Return True if `robot` was ever reported."""
        return robot in self._seen

    def target(self, robot: str, now_ns: int) -> Lamp | Refusal:
        """Return the place of `robot`, or a refusal if it is unknown or moves."""
        seen = self._seen.get(robot)
        if seen is None or now_ns - seen.stamp_ns > MAX_ROBOT_AGE_S * NS_PER_S:
            return Refusal(f"robot {robot} is not tracked now; start its tracker, or point at a lamp")
        if math.hypot(*seen.robot.velocity_mps) > STANDS_MPS:
            return Refusal(f"robot {robot} moves; let it stand, then point at it")
        sigma_m = seen.robot.position_sigma_m or 0.0
        if sigma_m > MAX_SIGMA_M:
            return Refusal(
                f"the place of robot {robot} is uncertain by {round_beyond(sigma_m, MAX_SIGMA_M)} m and "
                f"at most {MAX_SIGMA_M:g} m is accepted; point at a lamp"
            )
        return Lamp(id=robot, position_m=seen.robot.position_m)

    def standing(self, now_ns: int) -> list[Lamp]:
        """Return the places of all robots that stand."""
        targets = (self.target(robot, now_ns) for robot in self._seen)
        return [target for target in targets if isinstance(target, Lamp)]

    def moved(self, target: Lamp, now_ns: int) -> str:
        """Return the reason not to measure by pointing at `target`, where a robot was, or `""`."""
        current = self.target(target.id, now_ns)
        if isinstance(current, Refusal):
            return current.reason
        moved_m = math.dist(current.position_m, target.position_m)
        if moved_m <= STAYS_M:
            return ""
        return f"robot {target.id} moved by {moved_m:.1f} m meanwhile; try again"


class ProcedureRunner:
    """Creates procedures, runs one at a time, and passes their poses to the tracker."""

    def __init__(self, user: str, config: LocalizerConfig, tracking: PoseTracker) -> None:
        self._user = user
        self._config = config
        self._tracking = tracking
        self._robots = KnownRobots()
        self._room: Environment | None = None
        self._leases: tuple[LampLease, ...] = ()
        """Order of the people who use lamps or wait for them, as led-driver decided."""
        self._gone_ns: int | None = None
        """Time since which led-driver, which orders people, is gone, ns."""
        self._make: Make = self._static
        """Creates the procedure of the last request for lamps."""
        self._running: Procedure | None = None
        self._wrist_sigma_s: float | None = None
        self.bias_memory = BiasMemory()
        """Elevation bias of the person, for localizations by a robot."""
        self._published_ns = 0

    @property
    def is_busy(self) -> bool:
        """Return True if a procedure runs or waits and needs steps."""
        return self._running is not None

    @property
    def is_localizing(self) -> bool:
        """Return True if a procedure for a pose, rather than an anchor, runs or waits."""
        return self._running is not None and self._running.purpose == "pose"

    @property
    def is_following(self) -> bool:
        """Return True if the arm follows a moving target."""
        # asked for each ray: `isinstance` is slow for abstract classes
        return self._running is not None and isinstance(self._running, MovingTarget)

    @property
    def ahead(self) -> tuple[str, ...]:
        """Return the users who come first, or () if the person does not wait."""
        return self._running.ahead if isinstance(self._running, QueuedPointing) else ()

    @property
    def lit(self) -> str:
        """Return the id of the lamp that is lit, or `""` if none is."""
        return self._running.lit if isinstance(self._running, LampProcedure) else ""

    def on_map(self, room: Environment, now_ns: int) -> list[Output]:
        """Update the map.

        Pointing at a lamp that has moved or is gone stops, since it gives no information.
        """
        self._room = room
        running = self._running
        if isinstance(running, QueuedPointing):
            procedure = running.make(now_ns)
            if isinstance(procedure, Refusal):
                return self._process_outputs(running.refuse(now_ns, procedure.reason), now_ns)
            running.lamp_ids = procedure.lamp_ids
            return self._wait_on(running, running.ahead, now_ns)
        if not isinstance(running, LampProcedure):
            return []
        change = lamp_choice.map_change_reason(running.targets, room)
        if not change:
            return []
        reason = f"the map changed while {self._user} was pointing at its lamps: {change}; start again"
        return self.stop(now_ns, reason)

    def on_leases(self, leases: LampLeases, now_ns: int) -> list[Output]:
        """Begin to point if it is the person's turn, or wait if another request was earlier."""
        self._leases = leases.leases
        self._gone_ns = None
        running = self._running
        if not isinstance(running, QueuedPointing | LampProcedure):
            return []
        request = (self._user, running.since_ns)
        lease = next((lease for lease in self._leases if (lease.user, lease.since_ns) == request), None)
        if lease is None:  # led-driver has not heard of the request yet
            return []
        if isinstance(running, QueuedPointing):
            return self._wait_on(running, lease.ahead, now_ns)
        if not lease.ahead:
            return []

        # Both of two people began at the same time: the later one waits
        return self._queue(running, running.since_ns, lease.ahead, now_ns)

    def on_leases_gone(self, now_ns: int) -> None:
        """Forget the order of people, as led-driver has ended. Those who wait give it time to come back."""
        self._leases = ()
        self._gone_ns = now_ns

    def on_wrist(self, latency_sigma_s: float | None, mounting: str) -> None:
        """Update 1 sigma of the time of the person's rays, None if unknown, and how the sensor is worn."""
        self._wrist_sigma_s = latency_sigma_s
        self.bias_memory.mounting = mounting
        if isinstance(self._running, MovingTarget):
            self._running.wrist_sigma_s = latency_sigma_s

    def on_ray(self, ray: PointingRay) -> None:
        """Process a ray of the person."""
        if self._running is not None:
            self._running.on_ray(ray)

    def on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        """Process positions of tracked objects."""
        self._robots.on_objects(objects)
        if self._running is not None:
            self._running.on_objects(tracker, objects)

    def on_yaw_origin_changed(self, now_ns: int) -> list[Output]:
        """Restart or refuse, because rays of two yaw origins cannot be combined."""
        reason = f"the IMU of {self._user} was restarted or turned meanwhile; start again"
        running = self._running
        if running is None:
            return []
        return self._process_outputs(running.on_yaw_origin_changed(now_ns, reason), now_ns)

    def step(self, now_ns: int) -> list[Output]:
        """Advance the running or waiting procedure, if there is one."""
        running = self._running
        if running is None:
            return []
        if isinstance(running, QueuedPointing):
            is_alone = self._gone_ns is not None and now_ns - self._gone_ns > ARBITER_TIMEOUT_NS
            return self._wait_on(running, () if is_alone else running.ahead, now_ns)
        outputs = self._process_outputs(running.step(now_ns), now_ns)

        # The step may have ended the procedure, so ask again which one runs
        if isinstance(self._running, LampProcedure) and abs(now_ns - self._published_ns) >= REPUBLISH_NS:
            self._published_ns = now_ns
            outputs += self._running.republish(now_ns)
        return outputs

    def start_moving_target(self, now_ns: int) -> list[Output]:
        """Start following a robot; stop the procedure that runs."""
        outputs = self.stop(now_ns)
        self._running = MovingTarget(self._config, self.bias_memory)
        self._running.wrist_sigma_s = self._wrist_sigma_s
        self._tracking.end_rest()
        return [*outputs, *self._running.start(now_ns)]

    def start_static_targets(self, now_ns: int) -> list[Output] | Refusal:
        """Start pointing at lamps, or wait for them, instead of the running procedure; or refuse."""
        return self._start_or_queue(self._static, now_ns)

    def anchor(self, lamp_id: str, eyes_m: float, now_ns: int) -> list[Output] | Refusal:
        """Start pointing at lamp `lamp_id` (`""`: the most informative one), or wait for it.

        A pose must be known.
        """
        return self._start_or_queue(lambda then_ns: self._anchoring(lamp_id, eyes_m, then_ns), now_ns)

    def taken_robot(self, state: RobotState, robot: str, mean: Mean, now_ns: int) -> list[Output]:
        """Correct the pose by the rays with which the person has just taken `robot`.

        Not while a procedure runs, nor if the robot moved, nor where the person sees a cursor on a strip: who
        steers a cursor onto a thing points there whatever the drift.
        """
        if self._running is not None or math.hypot(*state.velocity_mps) > STANDS_MPS:
            return []
        may_have_strips = self._room is None or bool(self._room.strips)
        if self._config.anchor_at_robots is None and may_have_strips:
            return []
        return self._tracking.anchor_at(robot, state.position_m, mean, now_ns)

    def stop(self, now_ns: int, reason: str = "") -> list[Output]:
        """Stop the running procedure, lamps off."""
        running = self._running
        if running is None:
            return []
        return self._process_outputs(running.cancel(now_ns, reason), now_ns)

    def _start_or_queue(self, make: Make, now_ns: int) -> list[Output] | Refusal:
        """Stop what runs, and start the procedure of `make` or wait for its lamps. Refusals stop nothing."""
        procedure = make(now_ns)
        if isinstance(procedure, Refusal):
            return procedure
        outputs = self.stop(now_ns)
        self._make = make
        lamps = set(procedure.lamp_ids)
        others = [lease for lease in self._leases if lease.user != self._user]
        ahead = tuple(lease.user for lease in others if not lamps.isdisjoint(lease.lamps))
        if ahead:
            return [*outputs, *self._queue(procedure, now_ns, ahead, now_ns)]
        return [*outputs, *self._begin(procedure, now_ns, now_ns)]

    def _queue(
        self, procedure: LampProcedure, since_ns: int, ahead: tuple[str, ...], now_ns: int
    ) -> list[Output]:
        """Wait for the users `ahead`, since `since_ns`, instead of `procedure`."""
        waiting = QueuedPointing(self._make, procedure, self._config)
        waiting.ahead = ahead
        return self._begin(waiting, since_ns, now_ns)

    def _begin(self, procedure: Procedure, since_ns: int, now_ns: int) -> list[Output]:
        self._running = procedure
        self._published_ns = now_ns
        return procedure.start(now_ns, since_ns)

    def _wait_on(self, waiting: QueuedPointing, ahead: tuple[str, ...], now_ns: int) -> list[Output]:
        """Begin when it is their turn; publish the users ahead when they change, and periodically."""
        if not ahead:
            procedure = waiting.make(now_ns)
            if isinstance(procedure, Refusal):
                return self._process_outputs(waiting.refuse(now_ns, procedure.reason), now_ns)
            return self._begin(procedure, waiting.since_ns, now_ns)
        if waiting.is_too_long(now_ns):
            reason = (
                f"{self._user} has waited {QUEUE_TIMEOUT_S:g} s for the lamps; "
                f"{', '.join(ahead)} came first: see that they come to an end, then start again"
            )
            return self._process_outputs(waiting.refuse(now_ns, reason), now_ns)
        if ahead == waiting.ahead and abs(now_ns - self._published_ns) < REPUBLISH_NS:
            return []
        self._published_ns = now_ns
        return waiting.say(ahead, now_ns)

    def _static(self, _now_ns: int) -> StaticTargets | Refusal:
        lamps = lamp_choice.lamps_for_pose(self._room, self._config)
        return lamps if isinstance(lamps, Refusal) else StaticTargets(lamps, self._config)

    def _anchoring(self, lamp_id: str, eyes_m: float, now_ns: int) -> Anchoring | Refusal:
        config = self._config
        lamps = lamp_choice.lamp_for_anchor(self._room, config.lamps, lamp_id)

        # A robot that stands, if there is no such lamp
        robots: list[Lamp] | Refusal = []
        if isinstance(lamps, Refusal):
            robots = self._anchoring_robots(lamp_id, now_ns)
        if isinstance(robots, Refusal):
            return robots
        if robots:
            robot = self._most_informative(robots, eyes_m, now_ns)
            return Anchoring(robot, self._judge_robot, config, is_robot=True)
        if isinstance(lamps, Refusal):
            return lamps

        occupied = set(config.lamps)
        if not occupied and self._room is not None:  # all: another lit lamp would mislead
            occupied = {lamp.id for lamp in self._room.lamps}
        lamp = self._most_informative(lamps, eyes_m, now_ns)
        return Anchoring(lamp, self._tracking.anchor, config, occupies=occupied)

    def _anchoring_robots(self, asked: str, now_ns: int) -> list[Lamp] | Refusal:
        """Return the robot `asked`, or those that stand if `""`; `[]` if it is no robot."""
        if not asked:
            return self._robots.standing(now_ns)
        if asked not in self._robots:
            return []
        target = self._robots.target(asked, now_ns)
        return target if isinstance(target, Refusal) else [target]

    def _judge_robot(self, robot: Lamp, mean: Mean, problem: str, now_ns: int) -> AnchorOutcome:
        """Apply the anchor of a robot, unless it has moved since the person was asked to point at it."""
        rejection = problem or self._robots.moved(robot, now_ns)
        return self._tracking.anchor(robot, mean, rejection, now_ns)

    def _most_informative(self, lamps: Sequence[Lamp], eyes_m: float, now_ns: int) -> Lamp:
        place_m, covariance = self._tracking.uncertainty(now_ns)
        drift = self._config.drift.settings()
        observation_model = ObservationModel(
            ray_sigma_rad=drift.anchor_sigma_rad, elevation_sigma_rad=drift.elevation_sigma_rad, eyes_m=eyes_m
        )
        lamps_m = [lamp.position_m for lamp in lamps]
        floor_m = self._config.floor_m
        best = best_for_yaw(lamps_m, place_m, covariance, observation_model, floor_m=floor_m)
        return lamps[best]

    def _process_outputs(self, outputs: Sequence[Output], now_ns: int) -> list[Output]:
        """Return a procedure's outputs, its pose as tracked; drop a procedure that has ended."""
        running = self._running
        processed = list[Output]()
        for output in outputs:
            if isinstance(output, UserPose) and running is not None:
                since_ns, middle_ns = running.times_ns
                pose = self._tracking.set_localized(output, since_ns, middle_ns, now_ns)
                processed.append(pose)
                continue
            processed.append(output)
            if isinstance(output, Anchor) and output.accepted:
                corrected_pose = self._tracking.pose(now_ns)
                if corrected_pose is not None:
                    processed.append(corrected_pose)
        if running is not None and not running.running:
            self._running = None
        return processed
