"""Reads the AGVs at an MQTT broker, and publishes where they are."""

import asyncio
from typing import ClassVar

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.bridges.agv_tracker.fleet import Fleet
from pointit.maps.frames import aligned, frame_or_problem
from pointit.plugins import ConfigError, Context, Scope, Service, ticks
from pointit.runtime.mqtt.broker import client_options, connected, keep_connected, require_client
from pointit.schemas import Environment, TrackedObjects
from pointit.schemas.environment import Frame
from pointit.schemas.topics import MAP, OBJECTS
from pointit.vda5050 import agv_topics

RATE_HZ = 10.0
"""Rate of the tracked objects, Hz."""
RETRY_S = 1.0
"""Wait after an error, s."""


class AgvTracker(Service[AgvTrackerConfig]):
    """Publishes the AGVs that report at a broker by VDA 5050. It sends them nothing."""

    NAME: ClassVar[str] = "agv-tracker"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = AgvTrackerConfig

    def __init__(self, config: AgvTrackerConfig, context: Context) -> None:
        """Prepare; nothing is opened yet.

        Raises:
            ConfigError: If the extra `mqtt` is missing, there is no broker, or a file cannot be read.
        """
        super().__init__(config, context)
        self.validate_config(config)
        self._options = client_options(config)
        self._fleet = Fleet(config)
        self._frame: Frame | None = None
        self._objects = self.bus.publisher(OBJECTS, config.tracker)
        self._had_objects = False
        self.bus.subscribe(MAP, self._on_map)

    @classmethod
    def validate_config(cls, config: AgvTrackerConfig) -> None:
        """Check that a broker is named, and can be connected to with what is installed."""
        require_client("AGVs by VDA 5050")
        if not config.broker:
            raise ConfigError("broker: is missing; name the MQTT broker of the AGVs, HOST or HOST:PORT")
        client_options(config)

    async def run(self) -> None:
        """Publish until cancelled."""
        reading = keep_connected(
            self._read, self._on_lost, has_user=bool(self.config.username), retry_s=RETRY_S
        )
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(reading, name="AGVs' messages")
            async for now_ns in ticks(self.clock, RATE_HZ):
                self._publish(now_ns)

    async def _read(self) -> None:
        async with connected(self._options) as client:
            topics = agv_topics(self.config.topic_prefix)
            optional = [topic for topic in topics if topic.endswith("/visualization")]
            subscriptions = [(topic, 1) for topic in topics]
            problem = await client.subscribe(subscriptions, optional)
            if problem:
                problem = f"{self.config.broker}: {problem}"
            self.bus.warn("broker", problem)
            async for message in client.messages:
                self._fleet.on_message(
                    str(message.topic), message.payload, self.clock.now_ns(), is_retained=message.retain
                )

    def _on_lost(self, problem: str) -> None:
        self.bus.warn("broker", f"{self.config.broker}: {problem}")
        self._fleet.forget()

    def _publish(self, now_ns: int) -> None:
        objects = self._fleet.objects(now_ns)
        self.bus.warn("messages", self._fleet.problem)
        if self._frame is not None:
            objects = aligned(objects, self._frame)
        elif self.config.frame:
            objects = ()
        if objects or self._had_objects:
            self._objects.put(TrackedObjects(stamp_ns=now_ns, objects=objects))
        self._had_objects = bool(objects)

    def _on_map(self, environment: Environment, _name: str) -> None:
        if self.config.frame:
            self._frame, problem = frame_or_problem(environment, self.config.frame)
            self.bus.warn("frame", problem)


SERVICE = AgvTracker
