"""Driver of AGVs by VDA 5050: the connection to a broker, and the search for AGVs that report on one."""

import asyncio
import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError, first_cause
from pointit.runtime.mqtt.broker import client_options, connected, keep_connected, require_client, uncancelled
from pointit.runtime.mqtt.broker_config import PORT
from pointit.runtime.mqtt.broker_search import find_on_brokers
from pointit.runtime.service.surroundings import Surroundings
from pointit.services.robot.drivers.vda5050.agv import Agv, MqttPublication, Vda5050Config
from pointit.services.robot.robot_driver import Command, Report, RobotPlugin, RobotSpec
from pointit.vda5050.agv_messages import AgvConnection, AgvState, parse
from pointit.vda5050.agv_topic import AgvTopic, agv_of_topic, agv_topics

if TYPE_CHECKING:
    import aiomqtt

MAX_AGVS = 500
"""Limit of AGVs on one broker."""

REPORT_TOPICS = tuple(each for each in agv_topics() if not each.endswith("/visualization"))

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
    """Return the AGVs that report on one broker within `seconds`; nothing if there is no broker."""
    from aiomqtt import MqttError  # noqa: PLC0415 - an extra

    address = host if port == PORT else f"{host}:{port}"
    found: dict[AgvTopic, FoundDevice] = {}
    # the end of the search, a TimeoutError, is an OSError
    with contextlib.suppress(MqttError, OSError):
        async with asyncio.timeout(seconds), connected({"hostname": host, "port": port}) as client:
            await client.subscribe([(topic, 1) for topic in REPORT_TOPICS])
            async for message in client.messages:
                agv = agv_of_topic(str(message.topic))
                if agv and len(found) < MAX_AGVS and (device := _found(address, agv, message.payload)):
                    found[agv._replace(kind="")] = device
    return list(found.values())


def _found(address: str, agv: AgvTopic, payload: object) -> FoundDevice | None:
    """Return the AGV that has sent `payload` to a topic, or None if it is no message of an AGV."""
    message = parse(AgvConnection if agv.kind == "connection" else AgvState, payload)
    if message is None or not (agv.major or message.serial_number):
        return None
    state = message.connection_state if isinstance(message, AgvConnection) else "ONLINE"
    details = {"broker": address, "manufacturer": agv.manufacturer, "serial_number": agv.serial_number}
    interface, _, level = agv.prefix.partition("/")
    prefix = {"interface": interface} if level == f"v{agv.major}" else {"topic_prefix": agv.prefix}
    version = {"version": "1.1.0"} if agv.major == "1" else {}
    label = f"{agv.manufacturer} {agv.serial_number}: AGV of VDA 5050 {agv.major}".rstrip()
    return FoundDevice(address, f"{label}, {state or 'no connectionState'}", {**details, **prefix, **version})


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
                if not isinstance(first_cause(error), MqttError | OSError):
                    await self._end(client)
                raise

    async def _read(self, client: "aiomqtt.Client") -> None:
        loop = asyncio.get_running_loop()
        async for message in client.messages:
            self._agv.on_message(str(message.topic), message.payload, loop.time())
            self._changed.set()

    async def _send(self, client: "aiomqtt.Client") -> None:
        loop = asyncio.get_running_loop()
        topics = [(self._agv.topic(name), qos) for name, qos in TOPICS]
        await uncancelled(client.subscribe(topics))
        await self._publish(client, self._agv.on_connected())
        while True:
            self._changed.clear()
            for publication in self._agv.step(loop.time()):
                await self._publish(client, publication)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(TICK_S):
                    await self._changed.wait()

    async def _publish(self, client: "aiomqtt.Client", publication: MqttPublication) -> None:
        topic, payload = publication
        # acknowledged, so that a broker that hangs is noticed; the AGV subscribes without, by the standard
        await uncancelled(client.publish(topic, payload, qos=1, timeout=ACK_S))

    async def _end(self, client: "aiomqtt.Client") -> None:
        """Stop the AGV; the task counts as cancelled, so `uncancelled` would raise here."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        # without a connection, the AGV ends at its last released node
        with contextlib.suppress(MqttError, OSError):
            for topic, payload in self._agv.closing_messages():
                await client.publish(topic, payload, qos=1, timeout=END_S)


VDA5050 = RobotPlugin(
    summary="an AGV by VDA 5050 over MQTT, with PointIt as its master control",
    config=Vda5050Config,
    make=Vda5050Driver,
    check=check,
    discover=find_agvs,
)
