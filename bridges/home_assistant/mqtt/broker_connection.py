"""Lights on an MQTT broker, by Home Assistant's discovery, as the entities of a home.

They have the states, events and actions of Home Assistant, so that all else here serves both: rates of
commands, hovers, lamps that are lit at their turn, and what is restored after a kill.
"""

import asyncio
import contextlib
import itertools
import logging
import math
from collections.abc import AsyncGenerator, Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.home_connection import (
    BROKER_CODE,
    ActionRefusedError,
    NoHomeAssistantError,
)
from pointit.bridges.home_assistant.mqtt.announced_light import (
    MAX_BRIGHTNESS,
    AnnouncedLight,
    LightCommand,
    light_of,
)
from pointit.runtime.errors import RefusedError
from pointit.runtime.mqtt.broker import (
    client_options,
    connected,
    describe_error,
    discovery_prefix,
    refuses_login,
    require_client,
)
from pointit.runtime.mqtt.broker_client import BrokerClient, BrokerError, RefusedTopicsError
from pointit.runtime.mqtt.discovery import CONFIG, discovery_topics, light_configs
from pointit.schemas.text import one_line

log = logging.getLogger(__name__)

SETTLED_S = 0.5
"""Time without another retained announcement after which all lights are known, s."""
ACK_S = 5.0
"""Time for the broker to acknowledge a command, s."""
OURS_S = 5.0
"""Time after a command in which a report of the light counts as its answer, s. As in Home Assistant."""
MAX_LIGHTS = 500
MAX_TOPICS = 10 * MAX_LIGHTS
"""Limit of the topics that are read, also of those of lights that have been announced otherwise since."""
MAX_PAYLOAD_BYTES = 100_000
"""Limit of a message. Longer ones are left out."""
MAX_REFUSAL = 300


@dataclass
class LightEntry:
    """A light, and the topic on which it announces itself."""

    light: AnnouncedLight
    topic: str
    context: str = ""
    """Context of the last command."""
    command_s: float = -math.inf


class BrokerConnection:
    """Lights that announce themselves on one broker. Implements `HomeConnection`."""

    def __init__(self, client: BrokerClient, broker: str, prefix: str) -> None:
        """Use a connected client; `broker` is its address, `prefix` that of the discovery."""
        self._client = client
        self._broker = broker
        self._prefix = prefix
        self._loop = asyncio.get_running_loop()
        self._entries: dict[str, LightEntry] = {}
        """Lights by entity."""
        self._refusals: dict[str, str] = {}
        """Sentences on lights that cannot be used, by the topic of their announcement."""
        self._subscribed: set[str] = set()
        self._handlers: list[Callable[[Mapping[str, Any]], None]] = []
        self._announced_s = self._loop.time()
        """Time of the last announcement."""
        self._contexts = itertools.count(1)

    @property
    def refusals(self) -> Sequence[str]:
        """Return sentences on lights that cannot be used as they are announced."""
        return sorted(self._refusals.values())

    async def request(self, command: str, **fields: Any) -> Any:
        """Return the registry of areas or entities, which has what lights suggest.

        Raises:
            ActionRefusedError: For any other command.
        """
        del fields
        areas: dict[str, str] = {}
        for entity, entry in self._entries.items():
            if entry.light.area:
                areas[entity] = entry.light.area
        if command == "config/area_registry/list":
            return [{"area_id": area, "name": area} for area in sorted(set(areas.values()))]
        if command == "config/entity_registry/list":
            return [{"entity_id": entity, "area_id": area} for entity, area in areas.items()]
        raise ActionRefusedError(f"{self._broker} does not know {command}", BROKER_CODE)

    async def states(self) -> dict[str, Mapping[str, Any]]:
        """Return the states of all lights, by entity."""
        return {entity: self._state_of(entry) for entity, entry in self._entries.items()}

    async def is_starting(self) -> bool:
        """Return True while retained announcements arrive. Ask lights that are silent afterwards."""
        if self._loop.time() - self._announced_s < SETTLED_S:
            return True
        for entry in list(self._entries.values()):
            await self._ask(entry.light)
        return False

    async def subscribe(self, event: str, handler: Callable[[Mapping[str, Any]], None]) -> None:
        """Call `handler` with each change of a state. Announcements are read from now on.

        Raises:
            NoHomeAssistantError: If the broker does not let this user read them.
        """
        del event
        self._handlers.append(handler)
        self._announced_s = self._loop.time()
        with self._lost_connections():
            await self._client.subscribe([(topic, 0) for topic in discovery_topics(self._prefix)])

    async def call(self, call: ServiceCall) -> str:
        """Switch a light. Return the context that its answer has.

        Raises:
            ActionRefusedError: If there is no such light or action, or the broker does not permit or
                acknowledge it.
            NoHomeAssistantError: If the connection is lost.
        """
        entry = self._entries.get(call.entity)
        if entry is None:
            raise ActionRefusedError(f"no lamp on {self._broker} is {call.entity} any more", BROKER_CODE)
        light = entry.light
        is_on = {"turn_on": True, "turn_off": False}.get(call.service)
        if call.service == "toggle":
            is_on = light.state["state"] != "on"
        is_known = is_on is not None and call.domain == "light"
        if is_on is None or not is_known or call.data.keys() - {"brightness"}:
            raise ActionRefusedError(
                f"{light.name} on {self._broker} can be switched and dimmed, not {call.service}", BROKER_CODE
            )
        brightness = call.data.get("brightness")
        if brightness is not None:
            _check_brightness(light, brightness)

        # The context first: the light may answer before the broker acknowledges
        entry.context = f"pointit-{next(self._contexts)}"
        entry.command_s = self._loop.time()
        for command in light.commands(is_on=is_on, brightness=brightness):
            await self._publish(command, light.name)
        before = self._state_of(entry)
        if light.assume(is_on=is_on):
            self._tell_change(entry, before)
        return entry.context

    async def read(self) -> None:
        """Read announcements and states until the connection is lost.

        Raises:
            NoHomeAssistantError: If it is lost.
        """
        with self._lost_connections():
            async for message in self._client.messages:
                topic = message.topic.value
                payload = message.payload
                if not isinstance(payload, bytes) or len(payload) > MAX_PAYLOAD_BYTES:
                    continue
                if topic in self._subscribed:
                    self._on_report(topic, payload)
                if topic.endswith(CONFIG):  # also if a light names it as its own: it would hide another
                    await self._on_announcement(topic, payload, is_retained=message.retain)
        raise NoHomeAssistantError(f"the connection to {self._broker} is lost: wait")

    def _on_report(self, topic: str, payload: bytes) -> None:
        for entry in self._entries.values():
            if topic in entry.light.topics:
                before = self._state_of(entry)
                entry.light.on_message(topic, payload)
                self._tell_change(entry, before)

    async def _on_announcement(self, topic: str, payload: bytes, *, is_retained: bool) -> None:
        """Add the lights that a message announces, in place of those that it announced before."""
        self._announced_s = self._loop.time()
        self._refusals.pop(topic, None)
        lights: dict[str, AnnouncedLight] = {}
        for config in light_configs(topic, payload, self._prefix):
            try:
                light = light_of(config)
            except RefusedError as error:
                if len(self._refusals) < MAX_LIGHTS:
                    self._refusals[topic] = one_line(str(error), MAX_REFUSAL)
                continue
            lights[light.entity] = light

        # Lights that are announced no more
        for entity, entry in list(self._entries.items()):
            if entry.topic == topic and entity not in lights:
                del self._entries[entity]
                self._tell({"entity_id": entity, "new_state": None})

        # What is announced once more without a change keeps what it has reported
        for entity, light in lights.items():
            entry = self._entries.get(entity)
            if entry is not None and entry.light.config == light.config:
                continue
            if entry is None and len(self._entries) >= MAX_LIGHTS:
                log.warning("%s: more than %d lights, %s is left out", self._broker, MAX_LIGHTS, light.name)
                continue
            entry = LightEntry(light, topic)
            self._entries[entity] = entry
            self._tell({"entity_id": entity, "new_state": self._state_of(entry)})
            await self._subscribe_to(light)  # retained states come again, also those that were read before
            if not is_retained:
                await self._ask(light)

    async def _ask(self, light: AnnouncedLight) -> None:
        """Ask a light that has not reported whether it is on, if it can be asked."""
        if light.request is None or light.is_known:
            return
        with contextlib.suppress(RefusedError):
            await self._publish(light.request, light.name)

    async def _subscribe_to(self, light: AnnouncedLight) -> None:
        topics = sorted(light.topics)
        if not topics:
            return
        if len(self._subscribed.union(topics)) > MAX_TOPICS:
            log.warning("%s: more than %d topics, %s is not read", self._broker, MAX_TOPICS, light.name)
            return
        self._subscribed.update(topics)
        problem = await self._client.subscribe([(topic, 0) for topic in topics], optional=topics)
        if problem:
            log.warning("%s: %s", light.name, problem)

    async def _publish(self, command: LightCommand, name: str) -> None:
        """Publish a command to the light `name`. Raises as `call`."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        try:
            await self._client.publish(command.topic, command.payload, retain=command.retain, timeout=ACK_S)
        except RefusedTopicsError as error:
            raise ActionRefusedError(f"{name}: {error}", BROKER_CODE) from error
        except BrokerError as error:
            raise NoHomeAssistantError(str(error)) from error
        except MqttError as error:
            raise ActionRefusedError(
                f"{self._broker} does not acknowledge the command to {name}: look at the broker", BROKER_CODE
            ) from error

    def _state_of(self, entry: LightEntry) -> dict[str, Any]:
        """Return the state of a light, with the context of the command that it follows."""
        state = entry.light.state
        is_answer = self._loop.time() - entry.command_s < OURS_S
        return state | {"context": {"id": entry.context if is_answer else ""}}

    def _tell_change(self, entry: LightEntry, before: Mapping[str, Any]) -> None:
        after = self._state_of(entry)
        if (after["state"], after["attributes"]) != (before["state"], before["attributes"]):
            self._tell({"entity_id": entry.light.entity, "new_state": after})

    def _tell(self, data: Mapping[str, Any]) -> None:
        for handler in self._handlers:
            handler(data)

    @contextlib.contextmanager
    def _lost_connections(self) -> Generator[None]:
        """Turn errors of the client into the one of a lost connection."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        try:
            yield
        except (MqttError, BrokerError) as error:
            raise NoHomeAssistantError(f"{self._broker}: {describe_error(error, has_user=True)}") from error


def _check_brightness(light: AnnouncedLight, brightness: object) -> None:
    """Check that a light can be dimmed to what a map has. Raises ActionRefusedError."""
    if not light.can_dim:
        raise ActionRefusedError(
            f"{light.name} cannot be dimmed as it is announced: leave `brightness` out in the map",
            BROKER_CODE,
        )
    if type(brightness) is not int or not 1 <= brightness <= MAX_BRIGHTNESS:
        raise ActionRefusedError(
            f"{light.name} has no such brightness: write a number from 1 to {MAX_BRIGHTNESS} in the map",
            BROKER_CODE,
        )


@contextlib.asynccontextmanager
async def broker_connected(config: HomeAssistantConfig) -> AsyncGenerator[BrokerConnection]:
    """Yield a connection to the broker of `config`.

    Raises:
        ConfigError: If the extra is missing, or a file cannot be read.
        NoHomeAssistantError: If there is no connection. One sentence with the remedy.
    """
    from aiomqtt import MqttError  # noqa: PLC0415 - an extra

    require_client("lamps by MQTT")
    options = await asyncio.to_thread(client_options, config)
    async with contextlib.AsyncExitStack() as stack:
        try:
            client = await stack.enter_async_context(connected(options))
        except (MqttError, OSError) as error:  # BrokerError is an OSError
            reason = describe_error(error, has_user=bool(config.username))
            if refuses_login(error):
                reason = (
                    "it refuses the user name or the password: write the user into the address, "
                    "mqtt://USER@HOST, and give the password"
                )
            raise NoHomeAssistantError(f"{config.broker}: {reason}") from error
        yield BrokerConnection(client, config.broker, discovery_prefix())
