"""Reads rays, the map and tracked objects; writes the person's pose, the progress and the lamps."""

import asyncio
import math
from collections import Counter
from typing import ClassVar, Literal

from pointit.runtime import Context, Publisher, RefusedError, Service, sleep
from pointit.runtime.service import Scope
from pointit.schemas import (
    NS_PER_S,
    CancelLocalization,
    Done,
    Environment,
    Lamp,
    LampColor,
    Localization,
    PointingRay,
    SetPose,
    StartLocalization,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.topics import (
    CANCEL_LOCALIZATION,
    LAMP_COLOR,
    LOCALIZATION,
    MAP,
    OBJECTS,
    POSE,
    RAY,
    SET_POSE,
    START_LOCALIZATION,
)
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.moving_target import MovingTarget
from pointit.services.localizer.outputs import LampSwitch, Output
from pointit.services.localizer.static_targets import StaticTargets
from pointit.services.localizer.turns import Turns, busy

STEP_HZ = 20.0
"""How often a procedure is stepped while it runs."""

AHEAD_NS = NS_PER_S
"""Rays and objects stamped further in the future are wrong, and would make all that follow look late."""

SAY_NS = NS_PER_S
"""How often who is localized says so at least, and lights their lamp again."""

ON = (255, 255, 255)
OFF = (0, 0, 0)


class Localizer(Service[LocalizerConfig]):
    """Finds out where one person stands: from a fixed pose, from pointing at lamps or at a moving robot."""

    NAME: ClassVar[str] = "localizer"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = LocalizerConfig

    def __init__(self, config: LocalizerConfig, context: Context) -> None:
        super().__init__(config, context)
        self._map: Environment | None = None
        self._turns = Turns()
        self._said_ns = 0
        self._procedure: StaticTargets | MovingTarget | None = None
        self._sampling = asyncio.Event()
        self._lamps: dict[str, Publisher[LampColor]] = {}
        self._sent: Counter[str] = Counter()
        """Messages by topic and name."""
        self._poses = self.bus.publisher(POSE, self.user)
        self._progress = self.bus.publisher(LOCALIZATION, self.user)
        self._emit([Localization(stamp_ns=self.clock.now_ns(), phase="idle")])
        if config.method == "fixed":
            self._emit([self._fixed_pose()])
        elif config.method == "moving_target" and config.autostart:
            self._begin(MovingTarget(config.following(), config.trust.trust(), floor_m=config.floor_m))
        self.bus.subscribe(LOCALIZATION, self._on_localization)  # first: the map may switch lamps off
        self.bus.subscribe(MAP, self._on_map)
        self.bus.subscribe(OBJECTS, self._on_objects)
        self.bus.subscribe(RAY, self._on_ray, self.user)
        self.bus.serve(START_LOCALIZATION, self._start, self.user)
        self.bus.serve(CANCEL_LOCALIZATION, self._cancel, self.user)
        self.bus.serve(SET_POSE, self._set_pose, self.user)

    async def run(self) -> None:
        """Step the procedure while there is one; leave no lamp lit at the end."""
        try:
            while True:
                await self._sampling.wait()
                await sleep(self.clock, 1.0 / STEP_HZ)
                now_ns = self.clock.now_ns()
                if self._procedure is not None:
                    self._emit(self._procedure.step(now_ns))
                    self._rest()
                if isinstance(self._procedure, StaticTargets) and abs(now_ns - self._said_ns) >= SAY_NS:
                    self._say_again(self._procedure)
        finally:
            self._stop()

    def _on_map(self, environment: Environment, _name: str) -> None:
        is_first, self._map = self._map is None, environment
        if is_first and self.config.method == "static_targets":
            self._darken(environment)

    def _darken(self, environment: Environment) -> None:
        """Switch off what a localizer that was killed left lit, unless it is somebody's now."""
        wanted = self.config.lamps
        lamps = [lamp.id for lamp in environment.lamps if not wanted or lamp.id in wanted]
        if self._procedure is None and not self._turns.others(lamps, self.clock.now_ns()):
            self._emit([LampSwitch(lamp_id, on=False) for lamp_id in lamps])

    def _on_localization(self, news: Localization, user: str) -> None:
        """Mind the others who are localized: the lamps are theirs who began first."""
        if user == self.user:
            return
        now_ns = self.clock.now_ns()
        has_ended = self._turns.hear(user, news, now_ns)
        procedure = self._procedure
        if not isinstance(procedure, StaticTargets):
            return
        if has_ended:
            self._say_again(procedure)
        others = self._turns.others(procedure.lamp_ids, now_ns)
        if others and others[0] < (procedure.since_ns, self.user):
            self._emit(procedure.give_way(now_ns, busy(others[0][1])))
            self._rest()

    def _say_again(self, procedure: StaticTargets) -> None:
        self._said_ns = self.clock.now_ns()
        self._emit(procedure.again(self._said_ns))

    def _on_ray(self, ray: PointingRay, _user: str) -> None:
        if self._procedure is not None and self._is_timely(RAY.key, ray.stamp_ns):
            self._procedure.on_ray(ray)

    def _on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        if isinstance(self._procedure, MovingTarget) and self._is_timely(OBJECTS.key, objects.stamp_ns):
            self._procedure.on_objects(tracker, objects)

    def _is_timely(self, key: str, stamp_ns: int) -> bool:
        """Return whether `stamp_ns` is not in the future, but for clocks that differ a little, and say so."""
        ahead_ns = stamp_ns - self.clock.now_ns()
        if ahead_ns <= AHEAD_NS * self.clock.speed:
            self.bus.clear(f"future {key}")
            return True
        self.bus.warn(
            f"future {key}",
            f"{key} is stamped {ahead_ns / NS_PER_S:.1f} s ahead of this machine's clock and left out: "
            "synchronize the clocks of the machines",
        )
        return False

    async def _start(self, query: StartLocalization, _user: str) -> Done:
        method = query.method or self.config.method
        if method == "fixed":
            self._stop()
            now_ns = self.clock.now_ns()
            self._emit([self._fixed_pose(), Localization(stamp_ns=now_ns, phase="solved", progress=1.0)])
            return Done(message="the pose is fixed by the configuration")
        procedure = self._new(method)  # refuses before it stops what runs
        self._stop()
        self._begin(procedure)
        return Done(message=f"localizing by {method.replace('_', ' ')}")

    async def _cancel(self, _query: CancelLocalization, _user: str) -> Done:
        return Done(message="cancelled; the last pose stays" if self._stop() else "nothing was going on")

    async def _set_pose(self, query: SetPose, _user: str) -> Done:
        self._stop()
        pose = UserPose(
            stamp_ns=self.clock.now_ns(),
            position_m=query.position_m,
            yaw_rad=query.yaw_rad,
        )
        self._emit([pose])
        return Done(message=f"the pose is set; yaw {math.degrees(query.yaw_rad):.1f}°")

    def _new(self, method: Literal["static_targets", "moving_target"]) -> StaticTargets | MovingTarget:
        trust, floor_m = self.config.trust.trust(), self.config.floor_m
        if method == "moving_target":
            return MovingTarget(self.config.following(), trust, floor_m=floor_m)
        return StaticTargets(self._lamps_to_light(), self.config.timing(), trust, floor_m=floor_m)

    def _lamps_to_light(self) -> list[Lamp]:
        """Return the configured lamps of the map.

        Raises:
            RefusedError: there is no map, or not the lamps that are wanted, or fewer than two, or somebody
                else is pointing at them.
        """
        if self._map is None:
            raise RefusedError("there is no map yet; start pui, which publishes it")
        known = {lamp.id: lamp for lamp in self._map.lamps}
        missing = [lamp_id for lamp_id in self.config.lamps if lamp_id not in known]
        if missing:
            raise RefusedError(
                f"lamps {', '.join(missing)} are not on map {self._map.name!r}, which has "
                f"{', '.join(known) or 'none'}; correct `lamps`"
            )
        lamps = (
            [known[lamp_id] for lamp_id in self.config.lamps] if self.config.lamps else list(known.values())
        )
        if len({lamp.position_m for lamp in lamps}) < 2:
            raise RefusedError(
                f"pointing at lamps needs two at different places, map {self._map.name!r} gives {len(lamps)}"
            )
        others = self._turns.others({lamp.id for lamp in lamps}, self.clock.now_ns())
        if others:
            raise RefusedError(busy(others[0][1]))
        return lamps

    def _begin(self, procedure: StaticTargets | MovingTarget) -> None:
        self._procedure = procedure
        self._said_ns = self.clock.now_ns()
        self._emit(procedure.start(self._said_ns))
        self._sampling.set()

    def _stop(self) -> bool:
        """End what goes on, and return whether something did."""
        procedure = self._procedure
        if procedure is None:
            return False
        self._emit(procedure.cancel(self.clock.now_ns()))
        self._rest()
        return True

    def _rest(self) -> None:
        if self._procedure is not None and not self._procedure.running:
            self._procedure = None
            self._sampling.clear()

    def _emit(self, outputs: list[Output]) -> None:
        for output in outputs:
            if isinstance(output, LampSwitch):
                color = ON if output.on else OFF
                seq = self._next(LAMP_COLOR.at(output.lamp_id))
                lamp = LampColor(stamp_ns=self.clock.now_ns(), seq=seq, color=color)
                self._lamp(output.lamp_id).put(lamp)
            elif isinstance(output, UserPose):
                self._poses.put(output.model_copy(update={"seq": self._next(POSE.key)}))
            else:
                self._tell(output)

    def _tell(self, progress: Localization) -> None:
        self._progress.put(progress.model_copy(update={"seq": self._next(LOCALIZATION.key)}))
        if progress.phase == "refused":
            self.bus.warn("localization", progress.reason)
        else:
            self.bus.clear("localization")

    def _lamp(self, lamp_id: str) -> Publisher[LampColor]:
        if lamp_id not in self._lamps:
            self._lamps[lamp_id] = self.bus.publisher(LAMP_COLOR, lamp_id)
        return self._lamps[lamp_id]

    def _fixed_pose(self) -> UserPose:
        return UserPose(
            stamp_ns=self.clock.now_ns(),
            position_m=self.config.position_m,
            yaw_rad=math.radians(self.config.yaw_deg),
        )

    def _next(self, key: str) -> int:
        self._sent[key] += 1
        return self._sent[key]


SERVICE = Localizer
