"""Search for devices on MQTT brokers, of this machine and those that announce themselves in the network."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.service_browser import browse
from pointit.runtime.mqtt.broker_config import PORT, TLS_PORT

KINDS = ("_mqtt._tcp", "_secure-mqtt._tcp")
"""Services by which brokers announce themselves."""

FindOn = Callable[[str, int, float], Awaitable[Sequence[FoundDevice]]]
"""Returns the devices on the broker at a host and a port, after seconds at most."""


async def find_on_brokers(find_on: FindOn, seconds: float) -> list[FoundDevice]:
    """Return the devices on the brokers of this machine and on those that announce themselves."""
    here = (find_on("127.0.0.1", port, seconds) for port in (PORT, TLS_PORT))
    found = await asyncio.gather(*here, _find_in_thread(find_on, seconds))
    return [device for devices in found for device in devices]


async def _find_in_thread(find_on: FindOn, seconds: float) -> list[FoundDevice]:
    try:
        kinds = await asyncio.gather(*(browse(kind, seconds / 2) for kind in KINDS))
    except ConfigError:  # without the extra `discovery`, that of this machine is all
        return []
    brokers = {(each.address, each.port) for kind in kinds for each in kind}
    found = await asyncio.gather(*(find_on(host, port, seconds / 2) for host, port in sorted(brokers)))
    return [device for devices in found for device in devices]
