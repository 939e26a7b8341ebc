"""`pointit run --mqtt`: things on an MQTT broker, for Home Assistant and others."""

import asyncio
import contextlib
import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from pointit.cli.things.home_assistant import OFFLINE, ONLINE, Announcements, Publication
from pointit.launch.plan.watcher import News
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.mqtt.broker import client_options, connected, keep_connected, require_client, uncancelled
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.schemas import Environment, Selection, SelectionEvent, SetThing
from pointit.schemas.environment import Thing
from pointit.schemas.topics import SELECTION, SELECTION_EVENTS, SET_THING

if TYPE_CHECKING:
    import aiomqtt

log = logging.getLogger(__name__)

USER = "mqtt"
"""Name by which it switches things."""
RETRY_S = 2.0
"""Pause before the next connection, s."""
OLD_FOUND_S = 0.5
"""Time in which a broker sends what it retains of earlier announcements, s."""
MAX_QUEUED = 100
"""Maximum number of events that wait for the broker."""


def broker_of(address: str) -> BrokerConfig:
    """Return the broker at `HOST`, `HOST:PORT` or `mqtt[s]://[USER@]HOST[:PORT]`.

    Raises:
        ConfigError: If it is none of these, or the extra is missing.
    """
    require_client("things by MQTT")
    url = address if "://" in address else f"mqtt://{address}"
    try:
        parts = urlsplit(url)
        port = f":{parts.port}" if parts.port else ""
    except ValueError as error:
        raise ConfigError(f"--mqtt {address}: {str(error).lower()}") from error
    if parts.scheme not in ("mqtt", "mqtts") or not parts.hostname or parts.password or parts.path.strip("/"):
        raise ConfigError(
            f"--mqtt {address}: write HOST, HOST:PORT or mqtts://USER@HOST; the password is in MQTT_PASSWORD"
        )
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return BrokerConfig(broker=host + port, tls=parts.scheme == "mqtts", username=parts.username or "")


class MqttThings:
    """Watcher of a run that announces its things at a broker, and publishes their events and states."""

    def __init__(self, config: BrokerConfig) -> None:
        """Prepare; nothing is opened yet. Raises ConfigError: a file of `config` cannot be read."""
        self._config = config
        self._options = client_options(config)
        self._things: dict[str, Thing] = {}
        self._has_map = False
        self._selection = Selection(stamp_ns=0)
        self._events: asyncio.Queue[Publication] = asyncio.Queue(MAX_QUEUED)
        self._changed = asyncio.Event()
        self._is_connected = False
        self._problem = ""
        self._sent = 0
        self._dropped = 0

    def attach(self, bus: Bus, news: News) -> Sequence[Closable]:
        """Subscribe on `bus`, and connect. Return the subscriptions, and what ends the connection."""
        del news
        self._bus, self._announcements = bus, Announcements(bus.site)
        running = asyncio.create_task(self._run(), name="things by MQTT")
        ending = contextlib.ExitStack()
        ending.callback(running.cancel)
        return (
            ending,
            bus.subscribe(SELECTION_EVENTS, self._on_event),
            bus.subscribe(SELECTION, self._on_selection),
        )

    def on_map(self, environment: Environment) -> None:
        """Announce the things of the map, and take back those that are gone."""
        self._things = {thing.id: thing for thing in environment.things}
        self._has_map = True
        self._changed.set()

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Ignore services."""

    def summary(self) -> Mapping[str, Any]:
        """Return the number of events that the broker got and that it did not get, and its last problem."""
        return {"mqtt": {"events": self._sent, "dropped": self._dropped, "problem": self._problem}}

    def _on_selection(self, selection: Selection, _name: str) -> None:
        self._selection = selection
        self._changed.set()

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        thing = self._things.get(event.object_id)
        publication = self._announcements.event(thing, event) if thing is not None else None
        if publication is None:
            return
        # what was pointed at while there was no broker would happen long after
        if not self._is_connected or self._events.full():
            self._dropped += 1
            log.warning("%s was pointed at, and the broker does not know", event.thing)
            return
        self._events.put_nowait(publication)

    async def _run(self) -> None:
        has_user = bool(self._config.username)
        await keep_connected(self._serve, self._on_lost, has_user=has_user, retry_s=RETRY_S)

    def _on_lost(self, problem: str) -> None:
        if problem != self._problem:
            log.warning("%s: %s", self._config.broker, problem)
        self._problem = problem

    async def _serve(self) -> None:
        from aiomqtt import MqttError, Will  # noqa: PLC0415 - an extra

        status = self._announcements.status_topic
        will = Will(status, OFFLINE, qos=1, retain=True)
        async with connected({**self._options, "will": will}) as client:
            old = await self._announced_before(client)
            self._problem = ""
            self._is_connected = True
            self._changed.set()
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._publish_states(client, old), name="states by MQTT")
                    tasks.create_task(self._publish_events(client), name="events by MQTT")
                    tasks.create_task(self._obey(client), name="commands by MQTT")
            finally:
                self._is_connected = False
                self._dropped += self._events.qsize()
                while not self._events.empty():
                    self._events.get_nowait()
                with contextlib.suppress(MqttError, TimeoutError):  # the last will says it then
                    async with asyncio.timeout(OLD_FOUND_S):
                        await client.publish(status, OFFLINE, qos=1, retain=True)

    async def _announced_before(self, client: "aiomqtt.Client") -> list[str]:
        """Return the topics of announcements that the broker has retained."""
        found: list[str] = []
        await client.subscribe(self._announcements.found, qos=1)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(OLD_FOUND_S):
                async for message in client.messages:
                    found += [message.topic.value] if message.payload else []
        await client.unsubscribe(self._announcements.found)
        return found

    async def _publish_states(self, client: "aiomqtt.Client", old: Sequence[str]) -> None:
        """Publish announcements and states when they have changed."""
        shown: dict[str, str] = dict.fromkeys(old, "")
        while True:
            await self._changed.wait()
            self._changed.clear()
            if not self._has_map:
                continue
            things = list(self._things.values())
            outdated = self._announcements.outdated(
                [each for each in shown if each.endswith("/config")], things
            )
            wanted = [
                *outdated,
                *(self._announcements.discovery(thing) for thing in things),
                *self._announcements.states(things, self._selection.objects),
                Publication(topic=self._announcements.status_topic, payload=ONLINE, retain=True),
            ]
            for each in wanted:
                if shown.get(each.topic) != each.payload or each in outdated:
                    await uncancelled(client.publish(each.topic, each.payload, qos=1, retain=True))
                    shown[each.topic] = each.payload
            for each in outdated:
                del shown[each.topic]

    async def _publish_events(self, client: "aiomqtt.Client") -> None:
        while True:
            event = await self._events.get()
            self._dropped += 1  # until the broker has it
            await uncancelled(client.publish(event.topic, event.payload, qos=1))
            self._dropped -= 1
            self._sent += 1

    async def _obey(self, client: "aiomqtt.Client") -> None:
        """Switch things as the broker says, until the connection is lost, which raises MqttError."""
        await uncancelled(client.subscribe(self._announcements.commands, qos=1))
        async for message in client.messages:
            topic = message.topic.value
            command = self._announcements.command([*self._things.values()], topic, message.payload)
            if command is None or message.retain:  # a retained command is of another time
                log.warning("%s is no command to a switch, and ignored", topic)
                continue
            try:
                await self._bus.call(SET_THING, SetThing(thing=command[0], on=command[1]), USER)
            except PointItError as error:
                log.warning("%s: %s", topic, error)
