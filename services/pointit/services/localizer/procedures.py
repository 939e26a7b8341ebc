"""What goes on to find out where one person stands: at most one procedure at a time.

Pure: messages, requests and the time go in; what is to be published comes out.
"""

from collections.abc import Sequence

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
from pointit.services.localizer import lamps as lamp_choice
from pointit.services.localizer.anchoring import Anchoring
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimator import Refusal
from pointit.services.localizer.lamp_procedure import LampProcedure
from pointit.services.localizer.moving_target import MovingTarget
from pointit.services.localizer.next_target import Acuity, best_for_yaw
from pointit.services.localizer.outputs import LampSwitch, Output
from pointit.services.localizer.static_targets import StaticTargets
from pointit.services.localizer.tracking import Tracking
from pointit.services.localizer.turns import Turns, busy

SAY_NS = NS_PER_S
"""How often who is localized says so at least, and lights their lamp again."""

Procedure = StaticTargets | MovingTarget | Anchoring


class Procedures:
    """Makes procedures, runs one of them, and gives what it finds to who keeps the pose."""

    def __init__(self, user: str, config: LocalizerConfig, tracking: Tracking) -> None:
        self._user = user
        self._config = config
        self._tracking = tracking
        self._room: Environment | None = None
        self._turns = Turns()
        self._running: Procedure | None = None
        self._said_ns = 0

    @property
    def is_busy(self) -> bool:
        """Return whether a procedure runs and wants to be stepped."""
        return self._running is not None

    @property
    def is_localizing(self) -> bool:
        """Return whether one runs that finds the pose, rather than an anchor."""
        return self._running is not None and not isinstance(self._running, Anchoring)

    @property
    def is_following(self) -> bool:
        """Return whether the arm follows something that moves."""
        return isinstance(self._running, MovingTarget)

    def on_map(self, room: Environment, now_ns: int) -> list[Output]:
        """Take the room; switch off what a localizer that was killed left lit, unless it is somebody's.

        Who points at a lamp that is not there any more tells nothing: that is stopped.
        """
        is_first, self._room = self._room is None, room
        if isinstance(self._running, LampProcedure):
            change = lamp_choice.change(self._running.targets, room)
            reason = f"the map changed while {self._user} was pointing at its lamps: {change}; start again"
            return self.stop(now_ns, reason) if change else []
        if not is_first or self._config.method != "static_targets" or self._running is not None:
            return []
        wanted = self._config.lamps
        ids = [lamp.id for lamp in room.lamps if not wanted or lamp.id in wanted]
        return [] if self._turns.others(ids, now_ns) else [LampSwitch(lamp_id, on=False) for lamp_id in ids]

    def on_localization(self, news: Localization, user: str, now_ns: int) -> list[Output]:
        """Mind the others who are localized: the lamps are theirs who began first."""
        if user == self._user:
            return []
        has_ended = self._turns.hear(user, news, now_ns)
        running = self._running
        if not isinstance(running, LampProcedure):
            return []
        out = self._say_again(running, now_ns) if has_ended else []
        others = self._turns.others(running.lamp_ids, now_ns)
        if others and others[0] < (running.since_ns, self._user):
            out += self._passed(running.give_way(now_ns, busy(others[0][1])), now_ns)
        return out

    def on_ray(self, ray: PointingRay) -> None:
        """Take a ray of the person."""
        if self._running is not None:
            self._running.on_ray(ray)

    def on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        """Take where things are."""
        if isinstance(self._running, MovingTarget):
            self._running.on_objects(tracker, objects)

    def lose_yaw(self, now_ns: int) -> list[Output]:
        """Begin anew, or refuse: rays of two yaw origins do not belong together."""
        running = self._running
        if running is None:
            return []
        if isinstance(running, MovingTarget):
            return running.start(now_ns)
        reason = f"the IMU of {self._user} was restarted or turned meanwhile; start again"
        return self._passed(running.give_way(now_ns, reason), now_ns)

    def step(self, now_ns: int) -> list[Output]:
        """Go on with what runs, if something does."""
        if self._running is None:
            return []
        out = self._passed(self._running.step(now_ns), now_ns)
        running = self._running
        if isinstance(running, LampProcedure) and abs(now_ns - self._said_ns) >= SAY_NS:
            out += self._say_again(running, now_ns)
        return out

    def begin(self, procedure: Procedure, now_ns: int) -> list[Output]:
        """Run `procedure`, nothing else being on."""
        self._running = procedure
        self._said_ns = now_ns
        if isinstance(procedure, MovingTarget):
            self._tracking.disturb()
        return procedure.start(now_ns)

    def stop(self, now_ns: int, reason: str = "") -> list[Output]:
        """End what goes on, lamps off."""
        running = self._running
        return [] if running is None else self._passed(running.cancel(now_ns, reason), now_ns)

    def following(self) -> MovingTarget:
        """Return the procedure that follows a robot."""
        config = self._config
        return MovingTarget(config.following(), config.believed(), floor=config.floor())

    def at_lamps(self, now_ns: int) -> StaticTargets | Refusal:
        """Return the procedure with lamps, or why it cannot be."""
        config = self._config
        lamps = lamp_choice.for_a_pose(self._room, config.lamps, config.choice())
        if isinstance(lamps, Refusal):
            return lamps
        if others := self._turns.others({lamp.id for lamp in lamps}, now_ns):
            return Refusal(busy(others[0][1]))
        return StaticTargets(lamps, config.timing(), config.believed(), config.choice(), floor=config.floor())

    def anchoring(self, asked: str, eyes_m: float, now_ns: int) -> tuple[Lamp, Anchoring] | Refusal:
        """Return the lamp that is `asked` for, or the one that tells most, and the pointing at it.

        A pose must be known.
        """
        config = self._config
        lamps = lamp_choice.for_an_anchor(self._room, config.lamps, asked)
        if isinstance(lamps, Refusal):
            return lamps
        occupied = {lamp.id for lamp in self._room.lamps} if self._room is not None else set[str]()
        if others := self._turns.others(occupied, now_ns):
            return Refusal(busy(others[0][1]))
        lamp = self._telling(lamps, eyes_m, now_ns)
        return lamp, Anchoring(
            lamp, self._tracking.anchor, config.timing(), config.steadiness(), occupies=occupied
        )

    def _telling(self, lamps: Sequence[Lamp], eyes_m: float, now_ns: int) -> Lamp:
        """Return the lamp that tells most about the yaw."""
        place, covariance = self._tracking.uncertainty(now_ns)
        drift = self._config.drift.settings()
        acuity = Acuity(
            ray_sigma_rad=drift.anchor_sigma_rad,
            elevation_sigma_rad=drift.elevation_sigma_rad,
            eyes_m=eyes_m,
        )
        places = [lamp.position_m for lamp in lamps]
        return lamps[best_for_yaw(places, place, covariance, acuity, floor_m=self._config.floor_m)]

    def _say_again(self, procedure: LampProcedure, now_ns: int) -> list[Output]:
        self._said_ns = now_ns
        return procedure.again(now_ns)

    def _passed(self, outputs: Sequence[Output], now_ns: int) -> list[Output]:
        """Return what a procedure gave, its pose as it is followed from now on; forget one that has ended."""
        running, out = self._running, list[Output]()
        for output in outputs:
            if isinstance(output, UserPose) and isinstance(running, StaticTargets | MovingTarget):
                out.append(self._tracking.found(output, *running.times_ns, now_ns))
                continue
            out.append(output)
            if isinstance(output, Anchor) and output.accepted:
                pose = self._tracking.pose(now_ns)
                out += [] if pose is None else [pose]
        if running is not None and not running.running:
            self._running = None
        return out
