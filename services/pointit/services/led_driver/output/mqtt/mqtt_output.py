"""Output to single lamps on an MQTT broker."""

import asyncio
import contextlib
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, Any

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.runtime.mqtt.broker import client_options, connected, keep_connected, require_client, uncancelled
from pointit.runtime.mqtt.broker_config import PORT
from pointit.runtime.mqtt.broker_errors import encrypts, refuses_login
from pointit.runtime.mqtt.broker_search import find_on_brokers
from pointit.schemas import Lamp
from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.mqtt import light_protocol
from pointit.services.led_driver.output.mqtt.lamp_commands import DARK, LampCommands
from pointit.services.led_driver.output.mqtt.light_protocol import (
    TOPICS,
    WORDS,
    AnnouncedLight,
    announced_lights,
)
from pointit.services.led_driver.output.mqtt.mqtt_config import BRIDGE, MqttConfig
from pointit.services.led_driver.output.output_health import OutputHealth
from pointit.services.led_driver.outputs import LedOutput

if TYPE_CHECKING:
    import aiomqtt


RETRY_S = 1.0
"""Wait after an error, s."""
ACK_S = 5.0
"""Time for a broker to acknowledge a command, after which the connection counts as lost, s."""
OFF_S = 0.4
"""Maximum time for the commands that switch the lamps off at the end, s."""
ONLINE, OFFLINE = b"online", b"offline"
MAX_LAMPS = 500
"""Limit of lamps on one broker."""
TLS_SHARE = 0.2
"""Share of the time of a search that is left to find out if a broker that does not answer encrypts."""
MAX_PAYLOAD = 20_000
"""Limit of an availability message, bytes."""
MAX_SHOWN = 40
"""Characters of a message that are shown."""


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

    def set_lamps(self, lamps: Sequence[Lamp]) -> None:
        """Set the map's lamps. Reports in health those that are configured and not in the map."""
        ids = [lamp.id for lamp in lamps]
        self._lamps = tuple(lamp_id for lamp_id in ids if self._config.command_topic(lamp_id))
        self._commands.set_lamps(self._lamps)
        unknown = ", ".join(sorted(self._config.lamps.keys() - set(ids)))
        self._health.warn(
            "map", f"no lamp of the map is called {unknown}: correct `lamps`, or the map" if unknown else ""
        )
        self._tell_availability()
        self._changed.set()

    def show_lamp(self, lamp_id: str, color: Rgb) -> None:
        """Show `color` on the lamp `lamp_id`. Returns at once."""
        self._commands.show(lamp_id, color)
        self._changed.set()

    async def run(self) -> None:
        """Send until cancelled, then switch the lamps off."""
        has_user = bool(self._config.username)
        await keep_connected(
            self._serve, lambda why: self._health.warn("broker", why), has_user=has_user, retry_s=RETRY_S
        )

    async def _serve(self) -> None:
        status = self._config.status_topic
        async with self._connected(0, status, OFFLINE, retain=True) as client:
            self._health.clear("broker")
            self._payloads.clear()
            self._subscribed.clear()
            self._guarded.clear()
            self._tell_availability()
            self._commands.resend()
            self._changed.set()
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._read(client), name="lamps' availability")
                    tasks.create_task(self._send(client, tasks), name="lamps' commands")
            except asyncio.CancelledError:
                await self._end(client)
                raise

    def _connected(
        self, number: int, topic: str, will: bytes, *, retain: bool = False
    ) -> AbstractAsyncContextManager["aiomqtt.Client"]:
        """Connect as client `number`, with a last `will` on `topic`; without if that is `""`."""
        from aiomqtt import Will  # noqa: PLC0415 - an extra

        options = self._options | {"identifier": f"{self._options['identifier']}-{number}"}
        return connected(options | ({"will": Will(topic, will, qos=1, retain=retain)} if topic else {}))

    async def _guard(self, tasks: asyncio.TaskGroup) -> None:
        """Connect once more for each new lamp: a connection has one last will, which switches one off."""
        new = [lamp_id for lamp_id in self._lamps if lamp_id not in self._guarded]
        if not self._config.last_wills or not new:
            return
        is_left = [asyncio.Event() for _ in new]
        for lamp_id, event in zip(new, is_left, strict=True):
            self._guarded.add(lamp_id)
            tasks.create_task(self._leave_will(len(self._guarded), lamp_id, event), name="a lamp's last will")
        for event in is_left:
            await event.wait()

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
            why = str(error) or "no answer"
            raise OSError(f"{why}, at the last will of {lamp_id}; `last_wills: false` needs none") from error

    async def _send(self, client: "aiomqtt.Client", tasks: asyncio.TaskGroup) -> None:
        loop = asyncio.get_running_loop()
        await self._tell_status(client, ONLINE)
        while True:
            self._changed.clear()
            await self._subscribe(client)
            await self._guard(tasks)
            while (taken := self._commands.take(loop.time())) is not None:
                lamp_id, color = taken
                await self._publish(client, lamp_id, color)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._commands.wait_s(loop.time())):
                    await self._changed.wait()

    async def _publish(self, client: "aiomqtt.Client", lamp_id: str, color: Rgb) -> None:
        topic = self._config.command_topic(lamp_id)
        # acknowledged, so that no command waits behind old ones and a broker that hangs is noticed
        await uncancelled(client.publish(topic, light_protocol.command(color), qos=1, timeout=ACK_S))

    async def _tell_status(self, client: "aiomqtt.Client", status: bytes) -> None:
        if self._config.status_topic:
            await uncancelled(
                client.publish(self._config.status_topic, status, qos=1, retain=True, timeout=ACK_S)
            )

    async def _subscribe(self, client: "aiomqtt.Client") -> None:
        wanted = {topic for lamp_id in self._lamps for topic in self._config.availability_topics(lamp_id)}
        if new := sorted(wanted - self._subscribed):
            await uncancelled(client.subscribe([(topic, 1) for topic in new]))
            self._subscribed.update(new)

    async def _read(self, client: "aiomqtt.Client") -> None:
        async for message in client.messages:
            self._payloads[str(message.topic)] = message.payload[:MAX_PAYLOAD]
            self._tell_availability()
            self._changed.set()

    def _tell_availability(self) -> None:
        offline: list[str] = []
        unknown: dict[str, str] = {}
        for lamp_id in self._lamps:
            # payloads are empty where the broker has nothing retained any more
            topics = [each for each in self._config.availability_topics(lamp_id) if self._payloads.get(each)]
            bridges = [each for each in topics if each.endswith(BRIDGE)]
            for topic in (each for each in topics if each not in bridges[1:]):
                payload = self._payloads[topic]
                online = self._config.is_online(lamp_id, topic, payload)
                if online is None:
                    unknown[topic] = repr(payload.decode(errors="replace")[:MAX_SHOWN])
                elif not online and lamp_id not in offline:
                    offline.append(lamp_id)
        self._commands.set_offline(offline)
        reported = ", ".join(f"{topic} tells {text}" for topic, text in unknown.items())
        remedy = (
            "set `availability` to the topic that tells if the lamp is online, and `payload_available` and "
            "`payload_not_available` to its words for online and offline"
        )
        self._health.warn("availability", f"{reported}: {remedy}" if reported else "")
        who = ", ".join(offline)
        self._health.warn(
            "lamps", f"offline: {who}; switch them on at the wall, or look into their bridge" if who else ""
        )

    async def _end(self, client: "aiomqtt.Client") -> None:
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        # without a connection, the broker publishes the last will
        with contextlib.suppress(MqttError, OSError):  # TimeoutError is one
            async with asyncio.timeout(OFF_S):
                await asyncio.gather(
                    *(self._publish(client, lamp_id, DARK) for lamp_id in self._commands.lit)
                )
                await self._tell_status(client, OFFLINE)


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

    lights: dict[str, AnnouncedLight] = {}
    address = host if port == PORT else f"{host}:{port}"
    server: dict[str, Any] = {"hostname": host, "port": port}
    reached = False
    try:
        # TimeoutError, at the end of the search, is an OSError
        async with asyncio.timeout(seconds - TLS_SHARE * seconds), connected(server) as client:
            reached = True
            await client.subscribe([(topic, 0) for topic in TOPICS])
            async for message in client.messages:
                for light in announced_lights(str(message.topic), message.payload):
                    if len(lights) < MAX_LAMPS:
                        lights.setdefault(light.topic, light)
    except MqttError as error:
        if not reached and refuses_login(error):
            return [FoundDevice(address, "MQTT broker that asks for a user name", {"broker": address})]
    except OSError:
        pass
    if not reached and await encrypts(host, port, TLS_SHARE * seconds):
        url = f"mqtts://{address}"
        return [FoundDevice(url, "MQTT broker that encrypts: write the name that its certificate has")]
    if not lights:
        return [FoundDevice(address, "MQTT broker on which no lamp announces itself")] if reached else []
    return [_found(address, light) for light in lights.values()]


def _found(address: str, light: AnnouncedLight) -> FoundDevice:
    kind = "lamp with colour" if light.has_color else "lamp without colour"
    details = {
        "name": light.name,
        "broker": address,
        "topic": light.topic,
        "availability": light.availability,
    }
    words = {name: word for name in WORDS if (word := getattr(light, name))}
    return FoundDevice(address, f"{light.name}: {kind}, topic {light.topic}", details | words)


MQTT = LedOutput(
    summary="smart lamps by MQTT (Zigbee2MQTT, Home Assistant)",
    config=MqttConfig,
    make=lambda config, around: MqttLamps(config, OutputHealth(around.health, config.broker)),
    argument="broker",
    example="HOST",
    discover=find_lamps,
)
