"""Where one person stands, from whatever tells it: the one who decides which procedure runs.

Pure: messages, requests and the time go in; what is to be published comes out.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import (
    NS_PER_S,
    Anchor,
    Environment,
    ImuSample,
    Interaction,
    Lamp,
    Localization,
    PointingRay,
    SetPose,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.topics import SET_POSE, START_LOCALIZATION
from pointit.services.localizer import lamps as lamp_choice
from pointit.services.localizer.anchoring import Anchoring
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimator import Refusal
from pointit.services.localizer.facing import Facing
from pointit.services.localizer.moving_target import MovingTarget
from pointit.services.localizer.next_target import Acuity, best_for_yaw
from pointit.services.localizer.outputs import LampSwitch, Output, StandBack
from pointit.services.localizer.outside import OutsidePose, stands_back
from pointit.services.localizer.static_targets import StaticTargets
from pointit.services.localizer.tracking import Tracking
from pointit.services.localizer.turns import Turns, busy

SAY_NS = NS_PER_S
"""How often who is localized says so at least, and lights their lamp again."""

IDLE_S = 2.0
"""How long nothing need be looked at while nothing is followed."""

NO_COVARIANCE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

Procedure = StaticTargets | MovingTarget | Anchoring
Method = Literal["fixed", "static_targets", "moving_target"]


@dataclass(frozen=True)
class Answer:
    """What a request comes to."""

    message: str
    outputs: Sequence[Output] = ()


class Locating:
    """Runs at most one procedure, and knows the pose that the last one found or somebody gave."""

    def __init__(self, user: str, config: LocalizerConfig) -> None:
        self._user = user
        self._config = config
        self._room: Environment | None = None
        self._turns = Turns()
        self._tracking = Tracking(config.drift.settings(), follow=config.track_drift)
        self._outside = OutsidePose()
        self._facing = Facing()
        self._procedure: Procedure | None = None
        self._is_cursor_shown = False
        self._said_ns = 0

    @property
    def is_busy(self) -> bool:
        """Return whether a procedure runs and wants to be stepped."""
        return self._procedure is not None

    @property
    def is_followed(self) -> bool:
        """Return whether the pose is to be looked at from time to time."""
        return self._tracking.follows or self._outside.pose is not None

    def begin(self, now_ns: int) -> list[Output]:
        """Say the first word, and begin what the configuration begins by itself."""
        out: list[Output] = [Localization(stamp_ns=now_ns, phase="idle")]
        config = self._config
        if config.method == "fixed":
            out.append(self._tracking.given(config.fixed(now_ns), now_ns))
        elif config.method == "moving_target" and config.autostart:
            out += self._begin(self._following(), now_ns)
        return out

    def on_map(self, room: Environment, now_ns: int) -> list[Output]:
        """Take the room; switch off what a localizer that was killed left lit, unless it is somebody's."""
        is_first, self._room = self._room is None, room
        if not is_first or self._config.method != "static_targets" or self._procedure is not None:
            return []
        wanted = self._config.lamps
        ids = [lamp.id for lamp in room.lamps if not wanted or lamp.id in wanted]
        return [] if self._turns.others(ids, now_ns) else [LampSwitch(lamp_id, on=False) for lamp_id in ids]

    def on_localization(self, news: Localization, user: str, now_ns: int) -> list[Output]:
        """Mind the others who are localized: the lamps are theirs who began first."""
        if user == self._user:
            return []
        has_ended = self._turns.hear(user, news, now_ns)
        procedure = self._procedure
        if procedure is None or isinstance(procedure, MovingTarget):
            return []
        out = self._say_again(procedure, now_ns) if has_ended else []
        others = self._turns.others(procedure.lamp_ids, now_ns)
        if others and others[0] < (procedure.since_ns, self._user):
            out += self._passed(procedure.give_way(now_ns, busy(others[0][1])), now_ns)
        return out

    def on_ray(self, ray: PointingRay, now_ns: int) -> list[Output]:
        """Take a ray of the person."""
        self._facing.add(ray)
        if self._procedure is not None:
            self._procedure.on_ray(ray)
        changed = self._tracking.on_ray(ray, now_ns)
        return [] if changed is None else [changed]

    def on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        """Take where things are."""
        if isinstance(self._procedure, MovingTarget):
            self._procedure.on_objects(tracker, objects)

    def on_imu(self, sample: ImuSample) -> None:
        """Take the arm's orientation: while no cursor is steered, a resting arm shows the IMU's drift."""
        if not self._is_cursor_shown and not isinstance(self._procedure, MovingTarget):
            self._tracking.on_orientation(sample.orientation_xyzw, sample.stamp_ns)

    def on_interaction(self, news: Interaction) -> None:
        """Take what the person is about."""
        self._is_cursor_shown = news.state == "pointing"
        if self._is_cursor_shown:
            self._tracking.disturb()

    def on_pose(self, pose: UserPose, now_ns: int) -> list[Output]:
        """Stand back when a tracker gives the pose."""
        if pose.method != "external":
            return []
        is_first = self._outside.hear(pose, now_ns)
        self._tracking.outside(pose)
        if not is_first:
            return []
        reason = stands_back(self._user)
        stopped = self._stop(now_ns, reason)
        return [*(stopped or [Localization(stamp_ns=now_ns, phase="idle", reason=reason)]), StandBack()]

    def step(self, now_ns: int) -> list[Output]:
        """Go on with the procedure, if there is one."""
        if self._procedure is None:
            return []
        out = self._passed(self._procedure.step(now_ns), now_ns)
        procedure = self._procedure
        if isinstance(procedure, StaticTargets | Anchoring) and abs(now_ns - self._said_ns) >= SAY_NS:
            out += self._say_again(procedure, now_ns)
        return out

    def due(self, now_ns: int) -> list[Output]:
        """Return the pose when it is time to publish it again."""
        pose = self._tracking.due(now_ns)
        return [] if pose is None else [pose]

    def wait_s(self, now_ns: int) -> float:
        """Return when to ask for what is due again, s."""
        return min(IDLE_S, self._tracking.wait_s(now_ns))

    def figures(self, now_ns: int) -> Iterator[tuple[str, float | None, str]]:
        """Yield name, value and unit of what health shows; no value takes it away."""
        yield "external pose", 1.0 if self._outside.pose is not None else None, ""
        yield from self._tracking.figures(now_ns)

    def worry(self, now_ns: int) -> str:
        """Return what is wrong with the pose and what to do; empty when nothing is."""
        if self._outside.pose is not None and not self._outside.is_fresh(now_ns):
            return self._silent(now_ns)
        sigma_deg = math.degrees(self._tracking.yaw_sigma_rad(now_ns))
        if sigma_deg <= self._config.drift.max_yaw_sigma_deg:
            return ""
        return (
            f"the yaw of {self._user} is uncertain by {sigma_deg:.0f}° because the IMU drifts; have them "
            f"point at a lamp once: `pointit anchor {self._user}`, or a double press of the button"
        )

    def start(self, method: Method | None, now_ns: int) -> Answer | Refusal:
        """Begin to localize, by `method` or as configured; what cannot begin stops nothing."""
        method = method or self._config.method
        if taken := self._outside.busy(self._user, now_ns):
            return Refusal(taken)
        if method == "fixed":
            out = self._stop(now_ns)
            self._outside.take_over()
            out.append(self._tracking.given(self._config.fixed(now_ns), now_ns))
            out.append(Localization(stamp_ns=now_ns, phase="solved", progress=1.0))
            return Answer("the pose is fixed by the configuration", out)
        procedure = self._following() if method == "moving_target" else self._at_lamps(now_ns)
        if isinstance(procedure, Refusal):
            return procedure
        out = self._stop(now_ns)
        self._outside.take_over()
        return Answer(f"localizing by {method.replace('_', ' ')}", [*out, *self._begin(procedure, now_ns)])

    def cancel(self, now_ns: int) -> Answer:
        """Stop what goes on."""
        out = self._stop(now_ns)
        return Answer("cancelled; the last pose stays" if out else "nothing was going on", out)

    def set_pose(self, query: SetPose, now_ns: int) -> Answer | Refusal:
        """Take the pose from a person."""
        if taken := self._outside.busy(self._user, now_ns):
            return Refusal(taken)
        out = self._stop(now_ns)
        self._outside.take_over()
        pose = UserPose(
            stamp_ns=now_ns,
            position_m=query.position_m,
            yaw_rad=query.yaw_rad,
            method=query.method,
            covariance=query.covariance or NO_COVARIANCE,
            elevation_bias_rad=query.elevation_bias_rad,
        )
        if query.method == "fixed" or query.covariance is None:
            out.append(self._tracking.given(pose, now_ns))
        else:  # it was found once, and its localizer died
            out.append(self._tracking.found(pose, now_ns, now_ns, now_ns))
        return Answer(f"the pose is set; yaw {math.degrees(query.yaw_rad):.1f}°", out)

    def set_heading(self, azimuth_rad: float, now_ns: int) -> Answer | Refusal:
        """Take that the person points towards `azimuth_rad` right now."""
        if taken := self._outside.busy(self._user, now_ns):
            return Refusal(taken)
        if self._procedure is not None:
            return Refusal(f"{self._user} is being localized now; wait until that is done, or cancel it")
        mean = self._facing.mean(now_ns)
        if isinstance(mean, Refusal):
            return mean
        if self._tracking.base is None or self._outside.pose is not None:
            if self._config.method != "fixed":
                return Refusal(self._nowhere())
            self._outside.take_over()
            self._tracking.given(self._config.fixed(now_ns), now_ns)
        result = self._tracking.heading(mean, azimuth_rad)
        pose = self._tracking.pose(now_ns)
        if not result.accepted or pose is None:
            return Refusal(result.reason)
        note = f"; {result.note}" if result.note else ""
        return Answer(f"the yaw is set; {math.degrees(pose.yaw_rad):.1f}°{note}", [pose])

    def point_anchor(self, asked: str, now_ns: int) -> Answer | Refusal:
        """Have the person point at the lamp that is `asked` for, or at the one that tells most."""
        if self._procedure is not None and not isinstance(self._procedure, Anchoring):
            return Refusal(f"{self._user} is being localized now; wait until that is done, or cancel it")
        if self._tracking.base is None:
            return Refusal(self._nowhere())
        if self._outside.pose is not None and not self._outside.is_fresh(now_ns):
            return Refusal(self._silent(now_ns))
        lamps = lamp_choice.for_an_anchor(self._room, self._config.lamps, asked)
        if isinstance(lamps, Refusal):
            return lamps
        occupied = {lamp.id for lamp in self._room.lamps} if self._room is not None else set[str]()
        if others := self._turns.others(occupied, now_ns):
            return Refusal(busy(others[0][1]))
        lamp = self._telling(lamps, now_ns)
        anchoring = Anchoring(
            lamp,
            self._tracking.anchor,
            self._config.timing(),
            self._config.steadiness(),
            occupies=occupied,
        )
        return Answer(f"point at {lamp.id}", [*self._stop(now_ns), *self._begin(anchoring, now_ns)])

    def stop(self, now_ns: int) -> list[Output]:
        """End what goes on, lamps off."""
        return self._stop(now_ns)

    def _telling(self, lamps: Sequence[Lamp], now_ns: int) -> Lamp:
        """Return the lamp that tells most about the yaw."""
        place, covariance = self._tracking.uncertainty(now_ns)
        drift = self._config.drift.settings()
        acuity = Acuity(
            ray_sigma_rad=drift.anchor_sigma_rad,
            elevation_sigma_rad=drift.elevation_sigma_rad,
            independent=1.0,
            eyes_m=self._facing.eyes_m,
        )
        places = [lamp.position_m for lamp in lamps]
        return lamps[best_for_yaw(places, place, covariance, acuity, floor_m=self._config.floor_m)]

    def _following(self) -> MovingTarget:
        config = self._config
        return MovingTarget(config.following(), config.believed(), floor_m=config.floor_m)

    def _at_lamps(self, now_ns: int) -> StaticTargets | Refusal:
        config = self._config
        lamps = lamp_choice.for_a_pose(self._room, config.lamps)
        if isinstance(lamps, Refusal):
            return lamps
        if others := self._turns.others({lamp.id for lamp in lamps}, now_ns):
            return Refusal(busy(others[0][1]))
        return StaticTargets(
            lamps, config.timing(), config.believed(), config.choice(), floor_m=config.floor_m
        )

    def _begin(self, procedure: Procedure, now_ns: int) -> list[Output]:
        self._procedure = procedure
        self._said_ns = now_ns
        if isinstance(procedure, MovingTarget):
            self._tracking.disturb()
        return procedure.start(now_ns)

    def _stop(self, now_ns: int, reason: str = "") -> list[Output]:
        procedure = self._procedure
        return [] if procedure is None else self._passed(procedure.cancel(now_ns, reason), now_ns)

    def _say_again(self, procedure: StaticTargets | Anchoring, now_ns: int) -> list[Output]:
        self._said_ns = now_ns
        return procedure.again(now_ns)

    def _passed(self, outputs: Sequence[Output], now_ns: int) -> list[Output]:
        """Return what a procedure gave, its pose as it is followed from now on; forget one that has ended."""
        procedure, out = self._procedure, list[Output]()
        for output in outputs:
            if isinstance(output, UserPose) and isinstance(procedure, StaticTargets | MovingTarget):
                out.append(self._tracking.found(output, *procedure.times_ns, now_ns))
                continue
            out.append(output)
            if isinstance(output, Anchor) and output.accepted:
                pose = self._tracking.pose(now_ns)
                out += [] if pose is None else [pose]
        if procedure is not None and not procedure.running:
            self._procedure = None
        return out

    def _nowhere(self) -> str:
        user = self._user
        return (
            f"no pose of {user} is known; localize first (`pointit call {START_LOCALIZATION.at(user)}`), or "
            f"set it (`pointit call {SET_POSE.at(user)}`)"
        )

    def _silent(self, now_ns: int) -> str:
        age_s = self._outside.age_s(now_ns)
        return (
            f"the tracker that gave the pose of {self._user} is silent for {age_s:.0f} s; start it again, or "
            "localize"
        )
