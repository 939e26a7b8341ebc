"""Output to single lamps on an MQTT broker, and its parameters.

No core: it waits for a broker.
"""

import asyncio
import contextlib
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from pointit.runtime.address_config import described_error
from pointit.runtime.clock import wait_up_to
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.runtime.mqtt.broker import (
    client_options,
    connected,
    discovery_prefix,
    encrypts,
    find_on_brokers,
    keep_connected,
    refuses_login,
    require_client,
)
from pointit.runtime.mqtt.broker_client import BrokerClient, BrokerError, RefusedTopicsError
from pointit.runtime.mqtt.broker_config import PORT, BrokerConfig
from pointit.schemas import Lamp
from pointit.schemas.base import Rgb
from pointit.schemas.text import system_reason
from pointit.services.led_driver.output import light_protocol
from pointit.services.led_driver.output.lamp_commands import DARK, LampCommands
from pointit.services.led_driver.output.light_protocol import (
    OFFLINE,
    ONLINE,
    WORDS,
    DiscoveredLight,
    announced_lights,
    announcement_topics,
    is_online,
)
from pointit.services.led_driver.output.pixel_output import OutputHealth
from pointit.services.led_driver.outputs import LedOutput, OutputConfig

Topic = Annotated[str, StringConstraints(max_length=1000, pattern=r"^[^#+\x00]*$")]

LAMP = "{lamp}"
"""Placeholder of a lamp's id in `MqttConfig.topic`."""
BRIDGE = "/bridge/state"
"""End of the topic by which a Zigbee2MQTT reports if it is online."""
STATUS_TOPIC = "pointit/status"
"""Topic that reports if the lamps are controlled, online or offline."""
SET = "/set"
"""End of a command topic of Zigbee2MQTT."""
RETRY_S = 1.0
"""Wait after an error, s."""
ACK_S = 5.0
"""Time for a broker to acknowledge a command, after which the connection counts as lost, s."""
OFF_S = 0.4
"""Maximum time for the commands that switch the lamps off at the end, s."""
MAX_LAMPS = 500
"""Limit of lamps on one broker."""
TLS_SHARE = 0.2
"""Share of the time of a search that is left to find out if a broker that does not answer encrypts."""
MAX_PAYLOAD = 20_000
"""Limit of an availability message, bytes."""
MAX_SHOWN = 40
"""Characters of a message that are shown."""
SESSION_HINT = "set `last_wills: false`: PointIt then has one connection for all lamps"
"""Remedy if the broker permits one connection for each user name."""


def _payload(value: object) -> object:
    """Return a word of a device. YAML hides which word it read as true."""
    if isinstance(value, bool):
        raise described_error('write the word in quotes as the device sends it, such as "true" or "on"')
    return str(value) if isinstance(value, int | float) else value


Payload = Annotated[str, BeforeValidator(_payload), StringConstraints(max_length=200)]


class AvailabilityConfig(Config):
    """Topic and words by which lamps report if they are online."""

    availability: Topic = Field(
        default="",
        description="topic that reports online or offline; {lamp} stands for the id; if empty, those of "
        "Zigbee2MQTT below `base_topic`",
    )
    online: Payload = Field(default="", description="word there for online; `online` if empty")
    offline: Payload = Field(default="", description="word there for offline; `offline` if empty")


class LampTopics(AvailabilityConfig):
    """Topics of one lamp."""

    topic: Topic = Field(default="", description="topic of its commands; by `topic` of the output if empty")


class MqttConfig(AvailabilityConfig, BrokerConfig, OutputConfig):
    """Lamps of the map as smart lamps on an MQTT broker (Zigbee2MQTT, Home Assistant's JSON schema)."""

    kind: str = Field(default="mqtt", description="kind of controller")
    topic: Topic = Field(
        default="",
        description="topic of a lamp's commands; {lamp} stands for its id; /{lamp}/set below `base_topic` if "
        "empty",
    )
    base_topic: Topic = Field(default="zigbee2mqtt", description="base topic of Zigbee2MQTT")
    lamps: dict[str, LampTopics] = Field(
        default={}, description="topics by id of the lamp; all lamps of the map, by `topic`, if empty"
    )
    lamp_rate_hz: float = Field(
        default=5.0, gt=0, le=100, description="maximum number of commands per second to a lamp"
    )
    max_rate_hz: float = Field(
        default=20.0, gt=0, le=1000, description="maximum number of commands per second to all lamps"
    )
    last_wills: bool = Field(
        default=True,
        description="switch lamps off if PointIt dies: by last wills, for which each has a connection",
    )

    @model_validator(mode="after")
    def _one_topic_a_lamp(self) -> Self:
        if self.topic and LAMP not in self.topic and self._uses_common_topic():
            raise ValueError(f"topic: write {LAMP}, for which a lamp's id is put in")
        lamps_by_topic: dict[str, str] = {}
        for lamp_id in self.lamps:
            first = lamps_by_topic.setdefault(self.command_topic(lamp_id), lamp_id)
            if first != lamp_id:
                raise ValueError(f"lamps: {first} and {lamp_id} share a topic")
        return self

    def _uses_common_topic(self) -> bool:
        """Return True if a lamp has no command topic of its own."""
        if not self.lamps:
            return True
        return not all(lamp.topic for lamp in self.lamps.values())

    def command_topic(self, lamp_id: str) -> str:
        """Return the topic of a lamp's commands, or `""` if the lamp is not on this output."""
        if self.lamps and lamp_id not in self.lamps:
            return ""
        if self.lamps and self.lamps[lamp_id].topic:
            return self.lamps[lamp_id].topic
        common_topic = self.topic or f"{self.base_topic}/{LAMP}{SET}"
        return common_topic.replace(LAMP, lamp_id)

    def availability_topics(self, lamp_id: str) -> tuple[str, ...]:
        """Return the topics that report if a lamp is online: all of them must say so, or nothing."""
        configured = self._of_lamp(lamp_id, "availability")
        if configured:
            return (configured.replace(LAMP, lamp_id),)
        topic = self.command_topic(lamp_id)
        if not topic.startswith(f"{self.base_topic}/") or not topic.endswith(SET):
            return ()
        return (f"{topic.removesuffix(SET)}/availability", f"{self.base_topic}{BRIDGE}")

    def is_online(self, lamp_id: str, topic: str, payload: bytes) -> bool | None:
        """Return True if a message on an availability topic says that the lamp is online, None if neither."""
        if topic.endswith(BRIDGE) and not self._of_lamp(lamp_id, "availability"):
            return is_online(payload, ONLINE, OFFLINE)
        online, offline = (self._of_lamp(lamp_id, name) for name in WORDS)
        return is_online(payload, online or ONLINE, offline or OFFLINE)

    def _of_lamp(self, lamp_id: str, name: str) -> str:
        """Return the value of the field `name` of a lamp, or that of the output if the lamp has none."""
        own = ""
        if lamp_id in self.lamps:
            own = getattr(self.lamps[lamp_id], name)
        return own or getattr(self, name)


class MqttLamps:
    """Sends the newest colour of each lamp to its topic, at a rate that lamps take."""

    def __init__(self, config: MqttConfig, health: OutputHealth) -> None:
        """Prepare; nothing is opened yet.

        Raises:
            ConfigError: If the extra is missing, there is no broker, or a file cannot be read.
        """
        require_client("lamps by MQTT")
        if not config.broker:
            raise ConfigError("broker: is missing; `--output mqtt:HOST` sets it")
        self._config = config
        self._health = health
        self._options = client_options(config)
        self._commands = LampCommands(config.lamp_rate_hz, config.max_rate_hz)
        self._changed = asyncio.Event()
        self._lamps: tuple[str, ...] = ()
        self._payloads: dict[str, bytes] = {}
        """Last message of each availability topic."""
        self._subscribed: set[str] = set()
        self._guarded: set[str] = set()
        """Lamps that the last will of a connection switches off."""
        self._refused: dict[str, str] = {}
        """Error messages of commands that the broker refuses, by lamp."""

    def set_lamps(self, lamps: Sequence[Lamp]) -> None:
        """Set the map's lamps. Reports in health those that are configured and not in the map."""
        ids = [lamp.id for lamp in lamps]
        self._lamps = tuple(lamp_id for lamp_id in ids if self._config.command_topic(lamp_id))
        self._commands.set_lamps(self._lamps)
        unknown = ", ".join(sorted(self._config.lamps.keys() - ids))
        warning = ""
        if unknown:
            warning = f"no lamp of the map is called {unknown}: correct `lamps`, or the map"
        self._health.warn("map", warning)
        self._report_availability()
        self._changed.set()

    def show_lamp(self, lamp_id: str, color: Rgb) -> None:
        """Show `color` on the lamp `lamp_id`. Returns at once."""
        self._commands.show(lamp_id, color)
        self._changed.set()

    async def run(self) -> None:
        """Send until cancelled, then switch the lamps off."""
        has_user = bool(self._config.username)
        await keep_connected(self._serve, self._on_connection_lost, has_user=has_user, retry_s=RETRY_S)

    def _on_connection_lost(self, reason: str) -> None:
        self._health.warn("broker", reason)

    async def _serve(self) -> None:
        async with self._connected(0, STATUS_TOPIC, OFFLINE.encode(), retain=True) as client:
            # A new connection knows nothing of the last one's subscriptions, last wills and refusals
            self._health.clear("broker")
            self._payloads.clear()
            self._subscribed.clear()
            self._guarded.clear()
            self._refused.clear()
            self._health.clear("commands")
            self._report_availability()
            self._commands.resend()
            self._changed.set()

            # Both run until the connection is lost, or until led-driver ends
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._read(client), name="lamps' availability")
                    tasks.create_task(self._send(client, tasks), name="lamps' commands")
            except asyncio.CancelledError:
                await self._end(client)
                raise

    def _connected(
        self, number: int, topic: str, will: bytes, *, retain: bool = False
    ) -> AbstractAsyncContextManager[BrokerClient]:
        """Connect as client `number`, with a last `will` on `topic`."""
        from aiomqtt import Will  # noqa: PLC0415 - an extra

        options = dict(self._options)
        options["identifier"] = f"{self._options['identifier']}-{number}"
        options["will"] = Will(topic, will, qos=1, retain=retain)
        if self._config.last_wills:
            options["session_hint"] = SESSION_HINT
        return connected(options)

    async def _guard(self, tasks: asyncio.TaskGroup) -> None:
        """Connect once more for each new lamp: a connection has one last will, which switches one off."""
        new_lamps = [lamp_id for lamp_id in self._lamps if lamp_id not in self._guarded]
        if not self._config.last_wills or not new_lamps:
            return
        events: list[asyncio.Event] = []
        for lamp_id in new_lamps:
            self._guarded.add(lamp_id)
            is_left = asyncio.Event()
            number = len(self._guarded)
            tasks.create_task(self._leave_will(number, lamp_id, is_left), name="a lamp's last will")
            events.append(is_left)

        # All connect in parallel. No lamp is lit before its last will is with the broker
        for is_left in events:
            await is_left.wait()

    async def _leave_will(self, number: int, lamp_id: str, is_left: asyncio.Event) -> None:
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        topic = self._config.command_topic(lamp_id)
        try:
            async with self._connected(number, topic, light_protocol.command(DARK)) as client:
                is_left.set()
                async for _message in client.messages:  # none comes; a lost connection raises
                    pass
        except (MqttError, OSError) as error:
            if is_left.is_set():
                raise
            raise BrokerError(
                f"{system_reason(error)}, at the last will of {lamp_id}; `last_wills: false` needs none"
            ) from error

    async def _send(self, client: BrokerClient, tasks: asyncio.TaskGroup) -> None:
        loop = asyncio.get_running_loop()
        await self._publish_status(client, ONLINE.encode())
        while True:
            # cleared first: a change during the commands below gets another round
            self._changed.clear()
            await self._subscribe(client)
            await self._guard(tasks)
            while (command := self._commands.take(loop.time())) is not None:
                lamp_id, color = command
                await self._publish_color(client, lamp_id, color)
            wait_s = self._commands.wait_s(loop.time())
            await wait_up_to(self._changed, wait_s)

    async def _publish_color(self, client: BrokerClient, lamp_id: str, color: Rgb) -> None:
        """Send a command. One that the broker refuses is reported, and the other lamps go on."""
        topic = self._config.command_topic(lamp_id)
        self._refused.pop(lamp_id, None)
        try:
            # acknowledged, so that no command waits behind old ones and a broker that hangs is noticed
            await client.publish(topic, light_protocol.command(color), timeout=ACK_S)
        except RefusedTopicsError as error:
            self._refused[lamp_id] = str(error)
        self._report_refusals()

    async def _publish_status(self, client: BrokerClient, status: bytes) -> None:
        """Say whether the lamps are controlled. Lamps need no such message, so it may be refused."""
        with contextlib.suppress(RefusedTopicsError):
            await client.publish(STATUS_TOPIC, status, retain=True, timeout=ACK_S)

    def _report_refusals(self) -> None:
        sentences = list(self._refused.values())
        warning = ""
        if sentences:
            warning = sentences[0]
        if len(sentences) > 1:
            warning += f" ({len(sentences) - 1} more lamps)"
        self._health.warn("commands", warning)

    async def _subscribe(self, client: BrokerClient) -> None:
        """Subscribe to the availability of new lamps. Without it, all lamps count as online."""
        topics: set[str] = set()
        for lamp_id in self._lamps:
            topics.update(self._config.availability_topics(lamp_id))
        new_topics = sorted(topics - self._subscribed)
        if not new_topics:
            return
        warning = await client.subscribe([(topic, 1) for topic in new_topics], optional=new_topics)
        if warning:
            warning += "; until then, lamps that are off count as online"
        self._health.warn("subscription", warning)
        self._subscribed.update(new_topics)

    async def _read(self, client: BrokerClient) -> None:
        async for message in client.messages:
            self._payloads[str(message.topic)] = message.payload[:MAX_PAYLOAD]
            self._report_availability()
            self._changed.set()

    def _report_availability(self) -> None:
        """Send no commands to lamps that are offline, and report them and messages of unknown words."""
        offline: list[str] = []
        unknown: dict[str, str] = {}
        for lamp_id in self._lamps:
            for topic in self._config.availability_topics(lamp_id):
                # empty where the broker has nothing retained any more
                payload = self._payloads.get(topic)
                if not payload:
                    continue
                online = self._config.is_online(lamp_id, topic, payload)
                if online is None:
                    text = payload.decode(errors="replace")
                    unknown[topic] = repr(text[:MAX_SHOWN])
                elif not online and lamp_id not in offline:
                    offline.append(lamp_id)
        self._commands.set_offline(offline)

        # Both warnings end as soon as their message is empty
        messages = [f"{topic} reports {text}" for topic, text in unknown.items()]
        warning = ", ".join(messages)
        if warning:
            warning += (
                ": set `availability` to the topic that reports if the lamp is online, and `online` and "
                "`offline` to its words, or its whole messages"
            )
        self._health.warn("availability", warning)
        warning = ""
        if offline:
            warning = f"offline: {', '.join(offline)}; switch them on at the wall, or look into their bridge"
        self._health.warn("lamps", warning)

    async def _end(self, client: BrokerClient) -> None:
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        # without a connection, the broker publishes the last will
        with contextlib.suppress(MqttError, OSError):  # TimeoutError is one
            async with asyncio.timeout(OFF_S):
                commands = [self._publish_color(client, lamp_id, DARK) for lamp_id in self._commands.lit]
                await asyncio.gather(*commands)
                await self._publish_status(client, OFFLINE.encode())


async def find_lamps(seconds: float) -> Sequence[FoundDevice]:
    """Return the lamps on the broker of this machine and on brokers that announce themselves (`_mqtt._tcp`).

    Raises:
        ConfigError: If the extra `mqtt` is not installed.
    """
    require_client("lamps by MQTT")
    return await find_on_brokers(find_lamps_on, seconds)


async def find_lamps_on(host: str, port: int, seconds: float) -> list[FoundDevice]:
    """Return the lamps on one broker, and the broker itself if it shows none; nothing if there is none."""
    from aiomqtt import MqttError  # noqa: PLC0415 - an extra

    lights: dict[str, DiscoveredLight] = {}
    prefix = discovery_prefix()
    address = host if port == PORT else f"{host}:{port}"
    server: dict[str, Any] = {"hostname": host, "port": port}
    reached = False

    # Collect retained announcements until the time is over: nothing says that the last one has come
    try:
        # TimeoutError, at the end of the search, is an OSError
        async with asyncio.timeout(seconds - TLS_SHARE * seconds), connected(server) as client:
            reached = True
            topics = announcement_topics(prefix)
            await client.subscribe([(topic, 0) for topic in topics])
            async for message in client.messages:
                for light in announced_lights(str(message.topic), message.payload, prefix):
                    if len(lights) < MAX_LAMPS:
                        lights.setdefault(light.topic, light)
    except RefusedTopicsError as error:
        return [FoundDevice(address, f"MQTT broker: {error}", {"broker": address})]
    except MqttError as error:
        if not reached and refuses_login(error):
            return [FoundDevice(address, "MQTT broker that asks for a user name", {"broker": address})]
    except OSError:
        pass

    if not reached:
        return await _encrypting_broker(host, port, address, TLS_SHARE * seconds)
    if not lights:
        return [FoundDevice(address, "MQTT broker on which no lamp announces itself")]
    return [_lamp_device(address, light) for light in lights.values()]


async def _encrypting_broker(host: str, port: int, address: str, seconds: float) -> list[FoundDevice]:
    """Return the broker that does not answer since it expects an encrypted connection, or nothing."""
    if not await encrypts(host, port, seconds):
        return []
    url = f"mqtts://{address}"
    return [FoundDevice(url, "MQTT broker that encrypts: write the name that its certificate has")]


def _lamp_device(address: str, light: DiscoveredLight) -> FoundDevice:
    kind = "lamp with colour" if light.has_color else "lamp without colour"
    details = {
        "name": light.name,
        "broker": address,
        "topic": light.topic,
        "availability": light.availability,
    }
    for name in WORDS:
        word = getattr(light, name)
        if word:
            details[name] = word
    return FoundDevice(address, f"{light.name}: {kind}, topic {light.topic}", details)


MQTT = LedOutput(
    summary="smart lamps by MQTT (Zigbee2MQTT, Home Assistant)",
    config=MqttConfig,
    make=lambda config, surroundings: MqttLamps(config, OutputHealth(surroundings.health, config.broker)),
    argument="broker",
    example="HOST",
    discover=find_lamps,
)
