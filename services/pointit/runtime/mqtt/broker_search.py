"""Search for devices on MQTT brokers, of this machine and those that announce themselves in the network."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.service_browser import browse
from pointit.runtime.mqtt.broker_config import PORT

FindOn = Callable[[str, int, float], Awaitable[Sequence[FoundDevice]]]
"""Returns the devices on the broker at a host and a port, after seconds at most."""


async def find_on_brokers(find_on: FindOn, seconds: float) -> list[FoundDevice]:
    """Return the devices on the broker of this machine and on those that announce `_mqtt._tcp`."""
    here = find_on("127.0.0.1", PORT, seconds)
    local, others = await asyncio.gather(here, _find_elsewhere(find_on, seconds))
    return [*local, *others]


async def _find_elsewhere(find_on: FindOn, seconds: float) -> list[FoundDevice]:
    try:
        brokers = await browse("_mqtt._tcp", seconds / 2)
    except ConfigError:  # without the extra `discovery`, that of this machine is all
        return []
    found = await asyncio.gather(*(find_on(each.address, each.port, seconds / 2) for each in brokers))
    return [device for devices in found for device in devices]
