"""Lights on an MQTT broker, by Home Assistant's discovery, as the entities of a home.

They have the states, events and actions of Home Assistant, so that all else here serves both: rates of
commands, hovers, lamps that are lit at their turn, and what is restored after a kill.

No core: it waits for a broker.
"""

import asyncio
import contextlib
import itertools
import logging
from collections.abc import AsyncGenerator, Callable, Generator, Mapping, Sequence
from typing import Any

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.home_connection import (
    BROKER_CODE,
    ActionRefusedError,
    NoHomeAssistantError,
)
from pointit.bridges.home_assistant.mqtt import tasmota_light
from pointit.bridges.home_assistant.mqtt.announced_light import (
    MAX_BRIGHTNESS,
    AnnouncedLight,
    LightCommand,
)
from pointit.bridges.home_assistant.mqtt.announced_lights import AnnouncedLights, LightEntry
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
from pointit.runtime.mqtt.discovery import discovery_topics, is_announcement
from pointit.schemas.text import first_of, one_line

log = logging.getLogger(__name__)

STATUS = "status"
"""Topic below the prefix on which a home says that it has started."""
ONLINE = "online"
SETTLED_S = 0.5
"""Time without another retained announcement after which all lights are known, s."""
ACK_S = 5.0
"""Time for the broker to acknowledge a command, s."""
OURS_S = 5.0
"""Time after a command in which a report of the light counts as its answer, s. As in Home Assistant."""
MAX_START_S = 10.0
"""Time after the subscription from which lights are expected no more, however many still come, s."""
MAX_PAYLOAD_BYTES = 100_000
"""Limit of a message. Longer ones are not read."""
MAX_UNSUBSCRIBED = 100
"""Number of topics that are unsubscribed from at once."""
MAX_SHOWN_TOPIC = 100
MAX_SHOWN_NAMES = 3
MAX_LOGGED = 500
"""Limit of the topics whose sentences are logged."""


class BrokerConnection:
    """Lights that announce themselves on one broker. Implements `HomeConnection`."""

    def __init__(
        self, client: BrokerClient, broker: str, prefix: str, *, should_say_online: bool = False
    ) -> None:
        """Use a connected client.

        Args:
            client: the client.
            broker: its address.
            prefix: that of the discovery.
            should_say_online: ask devices to announce themselves, as a Home Assistant does when it starts.
        """
        self._should_say_online = should_say_online
        self._problem = ""
        """Refusal of the broker that may be the reason for which there are no lights, or `""`."""
        self._client = client
        self._broker = broker
        self._prefix = prefix
        self._loop = asyncio.get_running_loop()
        self._lights = AnnouncedLights(broker, prefix)
        self._subscribed: set[str] = set()
        """Topics on which lights report, or have reported."""
        self._unread: dict[str, LightEntry] = {}
        """Lights whose topics are to be subscribed to, by entity."""
        self._silent: dict[str, LightEntry] = {}
        """Lights that are to be asked unless they have reported, by entity."""
        self._has_changed = asyncio.Event()
        """Set when there are topics to subscribe to or to unsubscribe from, or lights to ask."""
        self._logged: set[str] = set()
        """Topics whose sentences were logged."""
        self._handlers: list[Callable[[Mapping[str, Any]], None]] = []
        self._announced_s = self._loop.time()
        """Time of the last announcement."""
        self._begin_s = self._announced_s
        """Time of the subscription to announcements."""
        self._has_started = False
        """The lights that were announced so far are all that is waited for."""
        self._contexts = itertools.count(1)

    @property
    def refusals(self) -> Sequence[str]:
        """Return sentences on lights that cannot be used as they are announced, or why there is none."""
        reason = self._lights.reason_of_none if self._has_started else ""
        if not reason:
            return self._lights.refusals
        return [part for part in (reason, self._problem) if part]

    async def request(self, command: str, **fields: Any) -> Any:
        """Return the registry of areas or entities, which has what lights suggest.

        Raises:
            ActionRefusedError: For any other command.
        """
        del fields
        areas: dict[str, str] = {}
        for entity, entry in self._lights.entries.items():
            if entry.light.area:
                areas[entity] = entry.light.area
        if command == "config/area_registry/list":
            return [{"area_id": area, "name": area} for area in sorted(set(areas.values()))]
        if command == "config/entity_registry/list":
            return [{"entity_id": entity, "area_id": area} for entity, area in areas.items()]
        raise ActionRefusedError(f"{self._broker} does not know {command}", BROKER_CODE)

    async def states(self) -> dict[str, Mapping[str, Any]]:
        """Return the states of all lights, by entity."""
        return {entity: self._state_of(entry) for entity, entry in self._lights.entries.items()}

    async def is_starting(self) -> bool:
        """Return True while retained announcements arrive. Silent lights are asked afterwards.

        A device that announces without an end delays others by `MAX_START_S`. Later lights are added.
        """
        if self._has_started:
            return False
        now_s = self._loop.time()
        is_settled = now_s - self._announced_s >= SETTLED_S
        if not is_settled and now_s - self._begin_s < MAX_START_S:
            return True
        if self._should_say_online:
            self._should_say_online = False
            await self._say_online()
            self._announced_s = self._loop.time()
            return True
        self._has_started = True
        self._silent.update(self._lights.entries)
        self._has_changed.set()
        return False

    async def _say_online(self) -> None:
        """Ask for announcements that are not retained, which devices send once a home says so.

        https://www.home-assistant.io/integrations/mqtt, "Birth and last will messages". Other devices send
        theirs again.
        """
        with self._lost_connections():
            try:
                await self._client.publish(f"{self._prefix}/{STATUS}", ONLINE, qos=0, timeout=ACK_S)
            except RefusedTopicsError as error:
                self._problem = str(error)

    async def subscribe(self, event: str, handler: Callable[[Mapping[str, Any]], None]) -> None:
        """Call `handler` with each change of a state. Announcements are read from now on.

        Raises:
            NoHomeAssistantError: If the broker does not let this user read them.
        """
        del event
        self._handlers.append(handler)
        self._begin_s = self._loop.time()
        self._announced_s = self._begin_s
        with self._lost_connections():
            topics = [*discovery_topics(self._prefix), tasmota_light.FILTER]
            self._problem = await self._client.subscribe(
                [(topic, 0) for topic in topics], optional=[tasmota_light.FILTER]
            )

    async def call(self, call: ServiceCall) -> str:
        """Switch a light. Return the context that its answer has.

        Raises:
            ActionRefusedError: If there is no such light or action, or the broker does not permit or
                acknowledge it.
            NoHomeAssistantError: If the connection is lost.
        """
        entry = self._lights.entries.get(call.entity)
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
        # Reading waits for no acknowledgement: while it did, a busy light could hide the messages of others
        reading = asyncio.create_task(self._read_messages(), name="messages of the broker")
        following = asyncio.create_task(self._follow_topics(), name="topics of lights")
        tasks = (reading, following)
        try:
            with self._lost_connections():
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                await (reading if reading.done() else following)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        raise NoHomeAssistantError(f"the connection to {self._broker} is lost: wait")

    async def _read_messages(self) -> None:
        async for message in self._client.messages:
            topic = message.topic.value
            payload = message.payload
            if not isinstance(payload, bytes):
                continue
            if len(payload) > MAX_PAYLOAD_BYTES:
                self._refuse_long_message(topic, len(payload))
                continue
            if topic in self._subscribed:
                self._on_report(topic, payload)
            # Also if a light names it as its own: it would hide another
            if is_announcement(topic, self._prefix) or tasmota_light.is_tasmota(topic):
                self._on_announcement(topic, payload)

    def _refuse_long_message(self, topic: str, size: int) -> None:
        subject = "the announcement"
        if not is_announcement(topic, self._prefix):
            reporting = [entry for entry in self._lights.entries.values() if topic in entry.topics]
            names = first_of([entry.light.name for entry in reporting], MAX_SHOWN_NAMES)
            subject = f"a report of {names}"
        shown_topic = one_line(topic, MAX_SHOWN_TOPIC)
        sentence = f"{subject} on {shown_topic} cannot be used: {size} bytes, limit {MAX_PAYLOAD_BYTES}"
        self._lights.clear_refusals(topic)
        self._lights.refuse(topic, sentence)
        self._log_refusals(topic)

    def _log_refusals(self, topic: str) -> None:
        """Log why messages of `topic` cannot be used, once: a device that repeats them fills no log."""
        sentences = self._lights.refusals_of(topic)
        if not sentences or topic in self._logged:
            return
        if len(self._logged) >= MAX_LOGGED:
            return
        self._logged.add(topic)
        for sentence in sentences:
            log.warning("%s", sentence)

    def _on_report(self, topic: str, payload: bytes) -> None:
        self._lights.clear_refusals(topic)
        for entry in self._lights.entries.values():
            if topic in entry.topics:
                before = self._state_of(entry)
                entry.light.on_message(topic, payload)
                self._tell_change(entry, before)

    def _on_announcement(self, topic: str, payload: bytes) -> None:
        """Add the lights that a message announces, in place of those that it announced before."""
        self._announced_s = self._loop.time()
        change = self._lights.on_announcement(topic, payload)
        self._log_refusals(topic)
        for entity in change.removed:
            self._unread.pop(entity, None)
            self._silent.pop(entity, None)
            self._tell({"entity_id": entity, "new_state": None})
        for entry in change.entries:
            self._unread[entry.light.entity] = entry
            self._tell({"entity_id": entry.light.entity, "new_state": self._state_of(entry)})
        if change.removed or change.entries:
            self._has_changed.set()

    async def _follow_topics(self) -> None:
        """Subscribe to the topics of lights that are new or have changed, and ask those that are silent.

        Topics of former lights, and of former announcements, are unsubscribed from: their number is limited
        by that of the lights.
        """
        while True:
            await self._has_changed.wait()
            self._has_changed.clear()
            while self._unread or self._silent:
                await self._follow_next_light()
            await self._unsubscribe()

    async def _follow_next_light(self) -> None:
        """Subscribe for one light, and ask one: each in its turn, however often another one changes."""
        if self._unread:
            entity = next(iter(self._unread))
            entry = self._unread.pop(entity)
            await self._subscribe_to(entry)
            await self._unsubscribe()
            if self._has_started:
                self._silent[entity] = entry
        if self._silent:
            entity = next(iter(self._silent))
            entry = self._silent.pop(entity)
            await self._ask(entry.light)

    async def _ask(self, light: AnnouncedLight) -> None:
        """Ask a light that has not reported whether it is on, if it can be asked."""
        if light.request is None or light.is_known:
            return
        with contextlib.suppress(RefusedError):
            await self._publish(light.request, light.name)

    async def _subscribe_to(self, entry: LightEntry) -> None:
        """Subscribe to the topics of a light. Retained states come again, also those that were read."""
        topics = sorted(entry.topics)
        if not topics:
            return
        self._subscribed.update(topics)
        problem = await self._client.subscribe([(topic, 0) for topic in topics], optional=topics)
        if problem:
            self._lights.refuse(entry.topic, f"{entry.light.name} reports nothing: {problem}")
            self._log_refusals(entry.topic)

    async def _unsubscribe(self) -> None:
        """Unsubscribe from topics on which no light reports any more."""
        unused = sorted(self._subscribed - self._lights.topics)
        for start in range(0, len(unused), MAX_UNSUBSCRIBED):
            topics = unused[start : start + MAX_UNSUBSCRIBED]
            await self._client.unsubscribe(topics)
            self._subscribed.difference_update(topics)

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
        yield BrokerConnection(client, config.broker, discovery_prefix(), should_say_online=config.say_online)
