"""Reads rays, the map, tracked objects and more; writes the person's pose and the progress."""

import asyncio
from collections import Counter
from collections.abc import Iterable
from typing import ClassVar

from pointit.runtime.bus.contract import Publisher
from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.runtime.clock import sleep
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    NS_PER_S,
    Anchor,
    CancelLocalization,
    Done,
    Environment,
    ImuSample,
    Interaction,
    LampLeases,
    Localization,
    PointAnchor,
    PointingRay,
    RobotState,
    SelectionEvent,
    SetHeading,
    SetPose,
    StartLocalization,
    TrackedObjects,
    UserPose,
    topics,
)
from pointit.schemas.problems import UNCERTAIN
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import Output, WithdrawPose
from pointit.services.localizer.pose_manager import PoseManager, Response
from pointit.services.localizer.static_targets import MIN_LAMPS

STEP_HZ = 20.0
"""Rate of steps while a procedure runs."""

ARBITER = "led-driver"
"""Instance that decides who may use which lamps."""


class Localizer(Service[LocalizerConfig]):
    """Localizes one person and tracks their pose while the IMU drifts."""

    NAME: ClassVar[str] = "localizer"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = LocalizerConfig

    @classmethod
    def validate_map(cls, config: LocalizerConfig, room: Environment) -> None:
        """Check that there are enough lamps to point at.

        Raises:
            ConfigError: If people are localized by lamps and there are fewer.
        """
        if config.method != "static_targets" or len(room.lamps) >= MIN_LAMPS:
            return
        lamps = {0: "no lamps", 1: "1 lamp"}.get(len(room.lamps), f"{len(room.lamps)} lamps")
        raise ConfigError(
            f"map {room.name!r} has {lamps} and pointing at lamps needs {MIN_LAMPS}; "
            "leave --localize out, or add lamps to the map"
        )

    def __init__(self, config: LocalizerConfig, context: Context) -> None:
        super().__init__(config, context)
        self._pose_manager = PoseManager(self.user, config)
        self._busy = asyncio.Event()
        self._followed = asyncio.Event()
        self._sent: Counter[str] = Counter()
        """Number of messages by topic and name."""
        self._poses: Publisher[UserPose] | None = self.bus.publisher(topics.POSE, self.user)
        self._ahead: set[str] = set()
        """Keys that were ahead of this machine's clock when they were read last."""
        self._progress = self.bus.publisher(topics.LOCALIZATION, self.user)
        self._anchors = self.bus.publisher(topics.ANCHOR, self.user)

        # The idle phase, or the configured pose, is published before anything is received
        self._emit(self._pose_manager.begin(self.clock.now_ns()))

        # Lamps that people share; then map, person and robots
        self.bus.subscribe(topics.LAMP_LEASES, self._on_leases)
        self.bus.watch(topics.SERVICE_ALIVE, self._on_service)
        self.bus.subscribe(topics.MAP, self._on_map)
        self.bus.subscribe(topics.INTERACTION, self._on_interaction, self.user)
        self.bus.subscribe(topics.POSE, self._on_pose, self.user)
        self.bus.subscribe(topics.OBJECTS, self._on_objects)
        self.bus.subscribe(topics.ROBOT_STATE, self._on_robot)
        self.bus.subscribe(topics.IMU, self._on_imu, self.user)
        self.bus.subscribe(topics.RAY, self._on_ray, self.user)

        # Landings of reaches; they may also only be measured, as by default
        if config.anchor_at_things is not False:
            self.bus.subscribe(topics.ANNOUNCED, self._pose_manager.on_announced, self.user)
            self.bus.subscribe(topics.SELECTION_EVENTS, self._on_selection)

        # Requests
        self.bus.serve(topics.START_LOCALIZATION, self._start, self.user)
        self.bus.serve(topics.CANCEL_LOCALIZATION, self._cancel, self.user)
        self.bus.serve(topics.SET_POSE, self._set_pose, self.user)
        self.bus.serve(topics.SET_HEADING, self._set_heading, self.user)
        self.bus.serve(topics.POINT_ANCHOR, self._point_anchor, self.user)

    async def run(self) -> None:
        """Step procedures and track the pose. The procedure that runs is cancelled at the end."""
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._step(), name=f"localizer.{self.user} procedure")
                group.create_task(self._follow(), name=f"localizer.{self.user} drift")
        finally:
            self._emit(self._pose_manager.procedures.stop(self.clock.now_ns()))

    async def _step(self) -> None:
        while True:
            await self._busy.wait()
            await sleep(self.clock, 1.0 / STEP_HZ)
            self._emit(self._pose_manager.procedures.step(self.clock.now_ns()))

    async def _follow(self) -> None:
        while True:
            await self._followed.wait()
            now_ns = self.clock.now_ns()
            self._emit(self._pose_manager.due(now_ns))
            self._set_metrics(now_ns)
            await sleep(self.clock, self._pose_manager.wait_s(now_ns))

    def _set_metrics(self, now_ns: int) -> None:
        for name, value, unit in self._pose_manager.figures(now_ns):
            self.bus.set_metric(name, value, unit)
        self.bus.warn(UNCERTAIN, self._pose_manager.problem(now_ns))

    def _on_map(self, environment: Environment, _name: str) -> None:
        self._emit(self._pose_manager.on_map(environment, self.clock.now_ns()))

    def _on_leases(self, leases: LampLeases, _name: str) -> None:
        self._emit(self._pose_manager.procedures.on_leases(leases, self.clock.now_ns()))

    def _on_service(self, instance: str, *, present: bool) -> None:
        if instance == ARBITER and not present:
            self._pose_manager.procedures.on_leases_gone(self.clock.now_ns())

    def _on_interaction(self, interaction: Interaction, _user: str) -> None:
        self._pose_manager.on_interaction(interaction)

    def _on_pose(self, pose: UserPose, _user: str) -> None:
        self._emit(self._pose_manager.on_pose(pose, self.clock.now_ns()))

    def _on_ray(self, ray: PointingRay, _user: str) -> None:
        now_ns = self.clock.now_ns()
        if self._is_timely(topics.RAY.key, ray.stamp_ns, now_ns):
            outputs = self._pose_manager.on_ray(ray, now_ns)
            if outputs:
                self._emit(outputs)

    def _on_imu(self, sample: ImuSample, _user: str) -> None:
        now_ns = self.clock.now_ns()
        if self._is_timely(topics.IMU.key, sample.stamp_ns, now_ns):
            outputs = self._pose_manager.on_imu(sample, now_ns)
            if outputs:
                self._emit(outputs)

    def _on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        if self._is_timely(topics.OBJECTS.key, objects.stamp_ns, self.clock.now_ns()):
            self._pose_manager.procedures.on_objects(objects, tracker)

    def _on_robot(self, state: RobotState, robot: str) -> None:
        self._emit(self._pose_manager.on_robot(state, robot, self.clock.now_ns()))

    def _on_selection(self, event: SelectionEvent, _name: str) -> None:
        self._emit(self._pose_manager.on_selection(event, self.clock.now_ns()))

    def _is_timely(self, key: str, stamp_ns: int, now_ns: int) -> bool:
        """Return True if `stamp_ns` is at most `MAX_AHEAD_NS` in the future; otherwise warn."""
        ahead_ns = stamp_ns - now_ns
        if ahead_ns <= 0 and not self._ahead:  # nearly all
            return True
        if ahead_ns <= MAX_AHEAD_NS * self.clock.speed:
            self._ahead.discard(key)
            self.bus.clear("future", key)
            return True
        self._ahead.add(key)
        self.bus.warn(
            "future",
            f"{key} is stamped {ahead_ns / NS_PER_S:.1f} s ahead of this machine's clock and left out: "
            "synchronize the clocks of the machines",
            key,
        )
        return False

    async def _start(self, query: StartLocalization, _user: str) -> Done:
        return self._done(self._pose_manager.start(query.method, self.clock.now_ns()))

    async def _cancel(self, query: CancelLocalization, _user: str) -> Done:
        return self._done(self._pose_manager.cancel(self.clock.now_ns(), forget_bias=query.forget_bias))

    async def _set_pose(self, query: SetPose, _user: str) -> Done:
        return self._done(self._pose_manager.set_pose(query, self.clock.now_ns()))

    async def _set_heading(self, query: SetHeading, _user: str) -> Done:
        return self._done(self._pose_manager.set_heading(query.azimuth_rad, self.clock.now_ns()))

    async def _point_anchor(self, query: PointAnchor, _user: str) -> Done:
        return self._done(self._pose_manager.point_anchor(query.lamp, self.clock.now_ns()))

    def _done(self, answer: Response | Refusal) -> Done:
        """Publish the outputs of an answer and return the reply.

        Raises:
            RefusedError: If it is a refusal.
        """
        if isinstance(answer, Refusal):
            self._emit(())
            raise RefusedError(answer.reason)
        self._emit(answer.outputs)
        return Done(message=answer.message)

    def _emit(self, outputs: Iterable[Output]) -> None:
        for output in outputs:
            match output:
                case UserPose():
                    self._publish_pose(output)
                case Localization():
                    self._publish_progress(output)
                case Anchor():
                    self._anchors.put(output.model_copy(update={"seq": self._next(topics.ANCHOR.key)}))
                case WithdrawPose():
                    self._withdraw_pose()
        self._set(self._busy, is_on=self._pose_manager.procedures.is_busy)
        self._set(self._followed, is_on=self._pose_manager.is_followed)

    @staticmethod
    def _set(event: asyncio.Event, *, is_on: bool) -> None:
        if is_on:
            event.set()
        else:
            event.clear()

    def _publish_pose(self, pose: UserPose) -> None:
        if self._poses is None:
            self._poses = self.bus.publisher(topics.POSE, self.user)
        remembered = self._pose_manager.procedures.bias_memory.remembered
        update = {"seq": self._next(topics.POSE.key), "remembered_bias": remembered}
        self._poses.put(pose.model_copy(update=update))
        self._set_metrics(self.clock.now_ns())

    def _withdraw_pose(self) -> None:
        """Withdraw the key for the tracker, so that late subscribers do not get our last pose."""
        if self._poses is not None:
            self._poses.close()
            self._poses = None
        self._set_metrics(self.clock.now_ns())

    def _publish_progress(self, progress: Localization) -> None:
        self._progress.put(progress.model_copy(update={"seq": self._next(topics.LOCALIZATION.key)}))
        reason = progress.reason if progress.phase == "refused" else ""
        purpose = "anchor" if progress.purpose == "anchor" else "localization"
        self.bus.warn("refused", reason, purpose)

    def _next(self, key: str) -> int:
        self._sent[key] += 1
        return self._sent[key]


SERVICE = Localizer
