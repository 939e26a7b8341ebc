"""Things of a run on an MQTT broker: announced, switched, and reported when people point at them."""

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.bridges.mqtt_things.announcements import Announcements, Publication
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import PointItError
from pointit.runtime.mqtt.broker import (
    CONNECT_TIMEOUT_S,
    client_options,
    connected,
    discovery_prefix,
    keep_connected,
)
from pointit.runtime.mqtt.broker_client import BrokerClient, BrokerError, RefusedTopicsError
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.runtime.service.carrier import Act, ActFailedError, Carrier
from pointit.schemas import NS_PER_S, Environment, Selection, SelectionEvent, SetThing, ThingState
from pointit.schemas.environment import Thing
from pointit.schemas.message_age import message_age_ns
from pointit.schemas.topics import SELECTION, SET_THING

log = logging.getLogger(__name__)

ONLINE = "online"
OFFLINE = "offline"
USER = "mqtt"
"""Name by which it switches things."""
RETRY_S = 2.0
"""Pause before the next connection, s."""
OLD_FOUND_S = 0.5
"""Timeout for the next retained announcement of the broker, s."""
MAX_COMMAND_AGE_S = 1.0
"""Age of a command above which it is not carried out, s. That of a retained one is unknown."""
RESTORE_TIMEOUT_S = 8.0
"""Time after a start for which a switch that the broker retains as on counts as on, s."""
LOG_PERIOD_S = 600.0
"""Minimum time between two log lines with the same cause, s."""
MAX_CAUSES = 100
"""Maximum number of causes whose times are kept. Beyond it all are logged again."""


class MqttThings:
    """Watcher of a run that announces its things at a broker. Carries out acts: publishes their events."""

    def __init__(self, config: BrokerConfig, prefix: str = "", *, is_new_run: bool = True) -> None:
        """Prepare; nothing is opened yet.

        Args:
            config: the broker.
            prefix: as of `discovery_prefix`.
            is_new_run: switches that the broker retains as on are on again. A site that runs knows better.

        Raises: ConfigError: If a file of `config` cannot be read, or `prefix` is no topic.
        """
        self._config = config
        self._prefix = discovery_prefix(prefix)
        self._options = client_options(config)

        # What the run has, and what the broker has
        self._things: Sequence[Thing] | None = None
        self._selection: Selection | None = None
        self._retained: Mapping[str, object] | None = None
        """Payloads by topic that the broker had retained at the first connection."""
        self._restoring: set[str] | None = None if is_new_run else set()
        """Switches that the broker retains as on, and the selector does not have yet. None until known."""
        self._shown: dict[str, str] = {}
        """Payloads by topic that the broker has retained."""
        self._changed = asyncio.Event()

        # The connection
        self._client: BrokerClient | None = None
        """None if there is none."""
        self._problem = ""
        self._logged_s: dict[str, float] = {}
        """Times at which causes were logged."""
        self._sent = 0

    def attach(self, bus: Bus, on_event: Callable[[str, str], object]) -> Sequence[Closable]:
        """Subscribe on `bus`, and connect.

        Return the subscriptions, and a function that ends the connection.
        """
        del on_event
        self._bus = bus
        self._announcements = Announcements(bus.site, self._prefix)
        self._carrier = Carrier(bus, SiteClock(bus), USER)
        self._ending = contextlib.ExitStack()
        running = asyncio.create_task(self._run(), name="things by MQTT")
        self._ending.callback(running.cancel)
        return self._ending, bus.subscribe(SELECTION, self._on_selection)

    def on_map(self, environment: Environment) -> None:
        """Announce the things of the map, and take back those that are gone."""
        self._things = environment.things
        targets = {thing.id: [MqttTarget(self, thing)] for thing in environment.things}
        self._carrier.use(targets)
        self._restore()

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Ignore services."""

    def summary(self) -> Mapping[str, Any]:
        """Return the number of events that the broker got, and its last problem."""
        return {"mqtt": {"events": self._sent, "problem": self._problem}}

    def state_of(self, thing: Thing) -> ThingState:
        """Return the state of a thing. The broker has none but that of a switch from before a restart."""
        if self._client is None:
            problem = self._problem or "it is not connected yet: wait"
            reason = f"{self._config.broker}: {problem}"
            return ThingState(id="", state="unavailable", reason=reason)
        if thing.id in (self._restoring or ()):
            return ThingState(id="", state="on")
        state = "unknown" if thing.mode == "claim" else ""  # its end is an act
        return ThingState(id="", state=state)

    async def publish(self, thing: Thing, event: SelectionEvent) -> None:
        """Return when the broker has the message of an event. Raises ActFailedError if it does not get it."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        self._stop_restoring([thing.id])
        message = self._announcements.event(thing, event)
        if message is None:
            return
        try:
            if self._client is None:
                raise ActFailedError("unavailable", self.state_of(thing).reason)
            await self._client.publish(message.topic, message.payload)
        except RefusedTopicsError as error:
            raise ActFailedError("refused", f"{self._config.broker}: {error}") from error
        except (MqttError, BrokerError) as error:
            raise ActFailedError(
                "no_answer", f"{self._config.broker} did not take the event: {error}"
            ) from error
        self._sent += 1

    def _on_selection(self, selection: Selection, _name: str) -> None:
        self._selection = selection
        self._restore()
        self._stop_restoring(selected.id for selected in selection.objects)

    def _restore(self) -> None:
        """Report for a while that switches are on which the broker retains as on, as soon as all is known."""
        self._changed.set()
        if self._restoring is None:
            self._begin_restoring()
        self._carrier.tell()

    def _begin_restoring(self) -> None:
        """Begin if things, retained states and selection are known."""
        if self._things is None or self._retained is None or not self._selection:
            return
        selected = {selected.id for selected in self._selection.objects}
        switched_on = self._announcements.switched_on(self._things, self._retained)
        self._restoring = switched_on - selected
        timer = asyncio.get_running_loop().call_later(RESTORE_TIMEOUT_S, self._give_up_restoring)
        self._ending.callback(timer.cancel)

    def _give_up_restoring(self) -> None:
        names = self._restoring or ()
        for name in names:
            self._log_warning(
                f"{name} was on before the restart and is off now: not placed, or another target is off"
            )
        self._stop_restoring(names)

    def _stop_restoring(self, things: Iterable[str]) -> None:
        if self._restoring:
            self._restoring -= {*things}
            self._carrier.tell()
            self._changed.set()

    async def _run(self) -> None:
        has_user = bool(self._config.username)
        try:
            await keep_connected(self._serve_connection, self._on_lost, has_user=has_user, retry_s=RETRY_S)
        finally:
            await self._carrier.close()

    def _on_lost(self, problem: str) -> None:
        self._problem = problem
        self._carrier.tell()
        self._log_warning(f"{self._config.broker}: {problem}")

    def _log_warning(self, cause: str) -> None:
        """Log a warning, each cause once per `LOG_PERIOD_S`."""
        now_s = asyncio.get_running_loop().time()
        logged_s = self._logged_s.get(cause, -math.inf)
        if now_s - logged_s < LOG_PERIOD_S:
            return
        if len(self._logged_s) >= MAX_CAUSES:
            self._logged_s.clear()
        self._logged_s[cause] = now_s
        log.warning("%s", cause)

    async def _serve_connection(self) -> None:
        from aiomqtt import MqttError, Will  # noqa: PLC0415 - an extra

        status = self._announcements.status_topic
        will = Will(status, OFFLINE, qos=1, retain=True)
        async with connected({**self._options, "will": will}) as client:
            self._problem = ""

            # Only what was retained at the start counts for switches: later it is from here
            retained = await self._read_retained(client)
            if self._retained is None:
                self._retained = retained
            self._shown = dict.fromkeys(retained, "")
            self._client = client
            self._restore()

            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._publish_states(client), name="states by MQTT")
                    tasks.create_task(self._run_commands(client), name="commands by MQTT")
            finally:
                self._client = None
                self._carrier.tell()
                with contextlib.suppress(MqttError, OSError):  # the last will says it then
                    async with asyncio.timeout(OLD_FOUND_S):
                        await client.publish(status, OFFLINE, retain=True)

    async def _subscribe(self, client: BrokerClient, filters: Sequence[str]) -> None:
        """Subscribe to `filters`. What the broker refuses is reported, and the rest goes on."""
        subscriptions = [(topic_filter, 1) for topic_filter in filters]
        problem = await client.subscribe(subscriptions, optional=filters)
        if problem:
            self._on_refused(problem)

    def _on_refused(self, problem: str) -> None:
        self._problem = problem
        self._log_warning(f"{self._config.broker}: {problem}")

    async def _read_retained(self, client: BrokerClient) -> dict[str, object]:
        """Return the announcements and states that the broker has retained: payloads by topic."""
        retained: dict[str, object] = {}
        filters = (self._announcements.found, self._announcements.all_states)
        await self._subscribe(client, filters)
        with contextlib.suppress(TimeoutError):
            # A broker does not say which retained message is its last one: a pause does
            async with asyncio.timeout(OLD_FOUND_S) as ending:
                async for message in client.messages:
                    if message.payload and message.retain:
                        now_s = asyncio.get_running_loop().time()
                        ending.reschedule(now_s + OLD_FOUND_S)
                        retained[message.topic.value] = message.payload
        await client.unsubscribe(filters)
        return retained

    async def _publish_states(self, client: BrokerClient) -> None:
        """Publish announcements and states when they have changed."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            if self._things is None:
                continue

            # Old announcements go first: a thing may have become one of another kind
            things = self._things
            outdated = self._announcements.outdated([*self._shown], things)
            publications = list(outdated)
            for thing in things:
                publications.extend(self._announcements.discovery(thing))
            publications.extend(self._states(things))
            status_topic = self._announcements.status_topic
            publications.append(Publication(topic=status_topic, payload=ONLINE, retain=True))

            # What the broker has retained already is not sent again
            for publication in publications:
                is_shown = self._shown.get(publication.topic) == publication.payload
                if is_shown and publication not in outdated:
                    continue
                try:
                    await client.publish(publication.topic, publication.payload, retain=True)
                except RefusedTopicsError as error:
                    self._on_refused(str(error))
                self._shown[publication.topic] = publication.payload
            for publication in outdated:
                self._shown.pop(publication.topic, None)

    def _states(self, things: Sequence[Thing]) -> Sequence[Publication]:
        if self._restoring is None or self._selection is None:  # what is on is not known yet
            return ()
        unknown = self._restoring | self._selection.under_way
        return self._announcements.states(things, self._selection.objects, unknown)

    async def _run_commands(self, client: BrokerClient) -> None:
        """Switch things as the broker says, until the connection is lost, which raises BrokerError."""
        birth_topic = self._announcements.birth_topic
        await self._subscribe(client, (self._announcements.commands, birth_topic))
        async for message in client.messages:
            topic = message.topic.value
            if topic == birth_topic:
                if message.payload == ONLINE.encode():
                    self._shown.clear()  # announces a device again that was deleted there
                    self._changed.set()
                continue

            # What is retained would switch a thing again at each connection
            command = self._announcements.command(self._things or (), topic, message.payload)
            if message_age_ns(None, 0, is_retained=message.retain) > MAX_COMMAND_AGE_S * NS_PER_S:
                self._log_warning(
                    f"{topic} is retained, thus old, and ignored: send commands without `retain`"
                )
                continue
            if command is None:
                self._log_warning(
                    f"{topic} is no command to a switch, and ignored: send ON or OFF to a switch of the map"
                )
                continue

            # A command is newer than what a restart restores
            thing_id, on = command
            self._stop_restoring([thing_id])
            try:
                await self._bus.call(SET_THING, SetThing(thing=thing_id, on=on), USER)
            except PointItError as error:
                self._log_warning(f"{topic}: {error}")


@dataclass(frozen=True)
class MqttTarget:
    """Topic of a thing, as the target of acts."""

    things: MqttThings
    thing: Thing

    @property
    def state(self) -> ThingState:
        """Return the state of the thing: unavailable while there is no connection.

        Its limit is longer than that of the client, which names the broker.
        """
        state = self.things.state_of(self.thing)
        return state.model_copy(update={"limit_s": CONNECT_TIMEOUT_S + 1.0})

    async def carry_out(self, act: Act, /) -> None:
        """Publish its event."""
        await self.things.publish(self.thing, act.event)
