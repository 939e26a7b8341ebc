"""Search for lamps on MQTT brokers, of this machine and those that announce themselves in the network."""

import asyncio
from collections.abc import Sequence

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.mqtt.broker import connected, require_client
from pointit.runtime.mqtt.broker_config import PORT
from pointit.runtime.mqtt.broker_search import find_on_brokers
from pointit.services.led_driver.output.mqtt.light_protocol import TOPICS, AnnouncedLight, announced_lights

MAX_LAMPS = 500
"""Limit of lamps on one broker."""


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
    reached = False
    try:
        # TimeoutError, at the end of the search, is an OSError
        async with asyncio.timeout(seconds), connected({"hostname": host, "port": port}) as client:
            reached = True
            await client.subscribe([(topic, 0) for topic in TOPICS])
            async for message in client.messages:
                for light in announced_lights(str(message.topic), message.payload):
                    if len(lights) < MAX_LAMPS:
                        lights.setdefault(light.topic, light)
    except MqttError as error:
        if not reached and "uthor" in str(error):
            return [FoundDevice(address, "MQTT broker that asks for a user name", {"broker": address})]
    except OSError:
        pass
    if not lights:
        return [FoundDevice(address, "MQTT broker on which no lamp announces itself")] if reached else []
    return [_found(address, light) for light in lights.values()]


def _found(address: str, light: AnnouncedLight) -> FoundDevice:
    kind = "lamp with colour" if light.has_color else "lamp without colour"
    details = {"broker": address, "topic": light.topic, "availability": light.availability}
    return FoundDevice(address, f"{light.name}: {kind}, topic {light.topic}", {"name": light.name, **details})
