"""Driver of AGVs by VDA 5050: the connection to a broker, and the search for AGVs.

No core: it waits for a broker.
"""

import asyncio
import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pointit.runtime.clock import wait_up_to
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError, first_cause
from pointit.runtime.machine import this_machine
from pointit.runtime.mqtt.broker import (
    client_options,
    connected,
    find_on_brokers,
    keep_connected,
    require_client,
)
from pointit.runtime.mqtt.broker_client import BrokerClient, RefusedTopicsError
from pointit.runtime.mqtt.broker_config import PORT
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import NS_PER_S
from pointit.schemas.message_age import message_age_ns
from pointit.services.robot.drivers.agv import MAX_AGV_AGE_S, Agv, MqttPublication, Vda5050Config
from pointit.services.robot.robot_driver import Command, Report, RobotPlugin, RobotSpec
from pointit.vda5050 import AgvConnection, AgvState, AgvTopic, agv_of_topic, agv_topics, parse

if TYPE_CHECKING:
    import aiomqtt


MAX_AGVS = 500
"""Limit of AGVs on one broker."""

REPORT_TOPICS = tuple(topic for topic in agv_topics() if not topic.endswith("/visualization"))

TOPICS = (("connection", 1), ("state", 0), ("visualization", 0))
"""Topics of an AGV, with their quality of service by the standard."""

TICK_S = 0.05
"""Maximum interval between two checks for messages to send or results to report, s."""

RETRY_S = 1.0
"""Wait after an error, s."""

ACK_S = 5.0
"""Time for a broker to acknowledge a message, after which the connection counts as lost, s."""

END_S = 0.4
"""Maximum time to stop the AGV at the end, s."""


async def find_agvs(seconds: float) -> Sequence[FoundDevice]:
    """Return the AGVs on the broker of this machine and on brokers that announce themselves (`_mqtt._tcp`).

    Raises:
        ConfigError: If the extra `mqtt` is not installed.
    """
    require_client("AGVs by VDA 5050")
    return await find_on_brokers(find_agvs_on, seconds)


async def find_agvs_on(host: str, port: int, seconds: float) -> list[FoundDevice]:
    """Return the AGVs that report on one broker within `seconds`.

    Nothing if there is no broker, and the broker itself if it refuses to show them.
    """
    from aiomqtt import MqttError  # noqa: PLC0415 - an extra

    address = host if port == PORT else f"{host}:{port}"
    server: dict[str, Any] = {"hostname": host, "port": port}
    devices: dict[AgvTopic, FoundDevice] = {}
    try:
        async with asyncio.timeout(seconds), connected(server) as client:
            await client.subscribe([(topic, 1) for topic in REPORT_TOPICS])
            async for message in client.messages:
                agv = agv_of_topic(str(message.topic))
                if agv is not None and len(devices) < MAX_AGVS:
                    _store_agv(devices, address, agv, message)
    except RefusedTopicsError as error:
        return [FoundDevice(address, f"MQTT broker: {error}")]
    except (MqttError, OSError):  # the end of the search, a TimeoutError, is an OSError
        pass
    return list(devices.values())


def _store_agv(
    devices: dict[AgvTopic, FoundDevice], address: str, agv: AgvTopic, message: "aiomqtt.Message"
) -> None:
    """Store the sender of `message` in `devices`, unless the message is not from an AGV.

    Of an AGV that is off, the broker retains a state as well: that does not count as one of now.
    """
    content = parse(AgvConnection if agv.kind == "connection" else AgvState, message.payload)
    if content is None:
        return
    key = agv._replace(kind="")
    if isinstance(content, AgvConnection):
        devices[key] = _agv_device(address, agv, content.connection_state or "no connectionState")
        return
    age_ns = message_age_ns(content.stamp_ns, this_machine().now_ns(), is_retained=message.retain)
    if age_ns <= MAX_AGV_AGE_S * NS_PER_S:
        devices[key] = _agv_device(address, agv, "ONLINE")
        return
    devices.setdefault(key, _agv_device(address, agv, "without a message of now"))


def _agv_device(address: str, agv: AgvTopic, state: str) -> FoundDevice:
    details = {"broker": address, "manufacturer": agv.manufacturer, "serial_number": agv.serial_number}
    interface, _, major = agv.prefix.partition("/v")
    details["interface"] = interface
    if major == "1":
        details["version"] = "1.1.0"
    label = f"{agv.manufacturer} {agv.serial_number}: AGV of VDA 5050 {major}"
    return FoundDevice(address, f"{label}, {state}", details)


def check(config: Vda5050Config) -> None:
    """Check that an AGV can be reached by `config`, as far as can be said without the broker.

    Raises:
        ConfigError: If the extra is missing, the AGV is not named, or a file cannot be read.
    """
    require_client("AGVs by VDA 5050")
    for name in ("broker", "manufacturer", "serial_number"):
        if not getattr(config, name):
            raise ConfigError(f"{name}: is missing; `pointit devices` shows the AGVs of a broker")
    client_options(config)


class Vda5050Driver:
    """Steers one AGV as its master control."""

    def __init__(self, config: Vda5050Config, spec: RobotSpec, surroundings: Surroundings) -> None:
        """Prepare; nothing is opened yet.

        Raises:
            ConfigError: If the extra is missing, the AGV is not named, or a file cannot be read.
        """
        check(config)
        self._options = client_options(config)
        self._has_user = bool(config.username)
        self._health = surroundings.health
        self._agv = Agv(config, spec, surroundings)
        self._changed = asyncio.Event()

    def command(self, command: Command) -> None:
        """Carry out `command`, which replaces those before. Returns at once."""
        self._agv.command(command)
        self._changed.set()

    async def run(self, report: Report) -> None:
        """Report until cancelled, then stop the AGV if it may move."""
        self._agv.set_report(report)
        await keep_connected(self._serve, self._agv.on_disconnected, has_user=self._has_user, retry_s=RETRY_S)

    async def _serve(self) -> None:
        """Connect, and steer until the connection is lost; whatever else ends it stops the AGV first."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        async with connected(self._options) as client:
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._read(client), name="AGV's messages")
                    tasks.create_task(self._send(client), name="AGV's orders")
            except BaseException as error:
                cause = first_cause(error)
                is_connected = isinstance(cause, RefusedTopicsError)
                if is_connected or not isinstance(cause, MqttError | OSError):
                    await self._end(client)
                raise

    async def _read(self, client: BrokerClient) -> None:
        loop = asyncio.get_running_loop()
        async for message in client.messages:
            self._agv.on_message(str(message.topic), message.payload, loop.time(), is_retained=message.retain)
            self._changed.set()

    async def _send(self, client: BrokerClient) -> None:
        loop = asyncio.get_running_loop()
        topics = [(self._agv.topic(name), qos) for name, qos in TOPICS]
        optional = [self._agv.topic("visualization")]
        self._health.warn("subscription", await client.subscribe(topics, optional))
        await self._publish(client, self._agv.on_connected())
        while True:
            self._changed.clear()
            for publication in self._agv.step(loop.time()):
                await self._publish(client, publication)
            await wait_up_to(self._changed, TICK_S)

    async def _publish(self, client: BrokerClient, publication: MqttPublication) -> None:
        topic, payload = publication
        # acknowledged, so that a broker that hangs is noticed; the AGV subscribes without, by the standard
        await client.publish(topic, payload, timeout=ACK_S)

    async def _end(self, client: BrokerClient) -> None:
        """Stop the AGV."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        # without a connection, the AGV ends at its last released node
        with contextlib.suppress(MqttError, OSError):
            for topic, payload in self._agv.closing_messages():
                await client.publish(topic, payload, timeout=END_S)


VDA5050 = RobotPlugin(
    summary="an AGV by VDA 5050 over MQTT, with PointIt as its master control",
    config=Vda5050Config,
    make=Vda5050Driver,
    check=check,
    discover=find_agvs,
)
