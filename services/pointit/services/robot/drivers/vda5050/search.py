"""Search for AGVs that report on MQTT brokers by VDA 5050."""

import asyncio
import contextlib
from collections.abc import Sequence

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.mqtt.broker import connected, require_client
from pointit.runtime.mqtt.broker_config import PORT
from pointit.runtime.mqtt.broker_search import find_on_brokers
from pointit.vda5050.agv_messages import Connection, State, parse

MAX_AGVS = 500
"""Limit of AGVs on one broker."""
TOPICS = ("+/+/+/+/connection", "+/+/+/+/state")
LEVELS = 5


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
    found: dict[tuple[str, ...], FoundDevice] = {}
    # the end of the search, a TimeoutError, is an OSError
    with contextlib.suppress(MqttError, OSError):
        async with asyncio.timeout(seconds), connected({"hostname": host, "port": port}) as client:
            await client.subscribe([(topic, 1) for topic in TOPICS])
            async for message in client.messages:
                levels = str(message.topic).split("/")
                if len(found) < MAX_AGVS and (agv := _found(address, levels, message.payload)):
                    found[tuple(levels[: LEVELS - 1])] = agv
    return list(found.values())


def _found(address: str, levels: Sequence[str], payload: object) -> FoundDevice | None:
    """Return the AGV that has sent `payload` to a topic, or None if it is no message of an AGV."""
    interface, major, manufacturer, serial_number, name = levels
    message = parse(Connection if name == "connection" else State, payload)
    if message is None or not major.startswith("v"):
        return None
    state = message.connection_state if isinstance(message, Connection) else "ONLINE"
    details = {
        "broker": address,
        "interface": interface,
        "manufacturer": manufacturer,
        "serial_number": serial_number,
    }
    label = f"{manufacturer} {serial_number}: AGV of VDA 5050 {major.removeprefix('v')}, {state}"
    return FoundDevice(address, label, details)
