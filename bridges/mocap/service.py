"""Reads a server of motion capture, and publishes its bodies as objects and poses of people."""

import asyncio
from typing import ClassVar

from pointit.bridges.mocap.bodies import Bodies, TimedFrame
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.mocap_systems import check_system, open_system
from pointit.bridges.mocap.people import MAX_METRIC, WornBodies
from pointit.maps.frames import frame_or_problem
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import ticks
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, Environment, ImuSample, TrackedObject, TrackedObjects, UserPose
from pointit.schemas.environment import Frame
from pointit.schemas.system import BODY
from pointit.schemas.topics import IMU, MAP, OBJECTS, POSE

RATE_HZ = 25.0
"""Rate of the objects, Hz."""
MAX_FRAME_AGE_NS = NS_PER_S // 2
"""Time without frames after which all objects have left, ns."""
POSE_TICKS = 3
"""Number of these periods between two poses of a person."""


class Mocap(Service[MocapConfig]):
    """Publishes bodies of OptiTrack or Qualisys as objects, and the poses of people who wear some."""

    NAME: ClassVar[str] = "mocap"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = MocapConfig

    def __init__(self, config: MocapConfig, context: Context) -> None:
        """Prepare; nothing is opened yet.

        Raises:
            ConfigError: If there is no server.
        """
        super().__init__(config, context)
        self.validate_config(config)
        self._bodies = Bodies(config)
        self._worn_bodies = WornBodies(config)
        self._session, self._client = open_system(
            config,
            self.clock.now_ns,
            on_frame=self._on_frame,
            warn=lambda problem: self.bus.warn("network", problem),
        )

        # The newest frame, and what was published from it
        self._frame: Frame | None = None
        self._stamp_ns = 0
        """Time of the newest frame."""
        self._sigma_s = 0.0
        self._used_ns = 0
        """Arrival of the newest frame."""
        self._used_frames = 0
        self._had_objects = False
        self._shown_bodies = set[str]()
        """Names of the metrics of bodies."""

        # As ground truth people are objects, and no poses are published
        self._objects = self.bus.publisher(OBJECTS, config.tracker)
        self._poses: dict[str, Publisher[UserPose]] = {}
        if not config.truth:
            for name in self._worn_bodies.names:
                self._poses[name] = self.bus.publisher(POSE, name)
        self.bus.subscribe(MAP, self._on_map)
        for name in self._worn_bodies.names:
            self.bus.subscribe(IMU, self._on_imu, name)
            if config.truth:
                self.bus.subscribe(POSE, self._on_pose, name)

    @classmethod
    def validate_config(cls, config: MocapConfig) -> None:
        """Check that a server is named, and that what reads it is installed."""
        if not config.server:
            raise ConfigError(
                f"server: is missing; name the machine with {config.program}, such as 192.168.1.5, which "
                "`pointit devices` finds"
            )
        check_system(config)

    async def run(self) -> None:
        """Publish until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._client.run(), name="frames of motion capture")
            count = 0
            async for now_ns in ticks(self.clock, RATE_HZ):
                self._publish(now_ns)
                if count % POSE_TICKS == 0:
                    self._publish_poses(now_ns)
                if count % round(RATE_HZ) == 0:
                    self._report(now_ns)
                count += 1

    def _publish(self, now_ns: int) -> None:
        is_fresh = now_ns - self._used_ns < MAX_FRAME_AGE_NS
        people = self._worn_bodies.objects(now_ns, self._stamp_ns)
        objects: tuple[TrackedObject, ...] = ()
        if is_fresh:
            objects = (*self._bodies.objects(self._stamp_ns), *people)
        if objects or self._had_objects:
            stamp_ns = self._stamp_ns if objects else now_ns
            message = TrackedObjects(stamp_ns=stamp_ns, objects=objects, latency_sigma_s=self._sigma_s)
            self._objects.put(message)
        self._had_objects = bool(objects)

    def _publish_poses(self, now_ns: int) -> None:
        for name, pose in self._worn_bodies.poses(now_ns):
            if name in self._poses:
                self._poses[name].put(pose)

    def _report(self, now_ns: int) -> None:
        self.bus.warn("server", self._session.problem(now_ns))
        self.bus.warn("bodies", self._bodies.problem(self._stamp_ns))
        self.bus.warn("yaw", self._worn_bodies.problem(now_ns))
        sigma_s = self._session.clock_sigma_s(now_ns)
        sigma_ms = None if sigma_s is None else 1e3 * sigma_s
        self.bus.set_metric("clock sigma", sigma_ms, "ms")
        self.bus.set_metric("frame rate", self._used_frames, "Hz")
        self.bus.set_metric("damaged packets", self._session.damaged or None)
        self._report_bodies()
        for name, (value, unit) in self._worn_bodies.figures(now_ns).items():
            self.bus.set_metric(name, value, unit)
        self._used_frames = 0

    def _report_bodies(self) -> None:
        states: dict[str, bool] = {}
        for name, is_used in self._bodies.states().items():
            metric = f"{BODY}{name}"[:MAX_METRIC]
            states[metric] = is_used
        unused = sum(not is_used for is_used in states.values())
        self.bus.set_metric("unused bodies", unused or None)
        for name in self._shown_bodies - states.keys():
            self.bus.set_metric(name, None)
        for name, value in states.items():
            self.bus.set_metric(name, float(value))
        self._shown_bodies = set(states)

    def _on_frame(self, timed: TimedFrame) -> None:
        if self.config.frame and self._frame is None:
            return
        self._stamp_ns = timed.stamp_ns
        self._sigma_s = timed.sigma_s
        self._used_ns = self.clock.now_ns()
        self._used_frames += 1
        for pose in self._bodies.update(timed, self._frame):
            self._worn_bodies.on_body(pose)

    def _on_imu(self, sample: ImuSample, person: str) -> None:
        self._worn_bodies.on_imu(person, sample)

    def _on_pose(self, pose: UserPose, person: str) -> None:
        self._worn_bodies.on_pose(person, pose)

    def _on_map(self, environment: Environment, _name: str) -> None:
        if self.config.frame:
            self._frame, problem = frame_or_problem(environment, self.config.frame)
            self.bus.warn("frame", problem)


SERVICE = Mocap
