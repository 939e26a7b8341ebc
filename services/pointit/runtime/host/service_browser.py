"""Search for services that announce themselves in the local network (DNS-SD, as Bonjour and Avahi do)."""

import asyncio
import contextlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

MAX_SERVICES = 256
"""Maximum number of services of a kind whose addresses are asked for. Further ones are ignored."""


class NetworkService(NamedTuple):
    """A service in the local network."""

    name: str
    """Name of the instance, such as `wled-desk`."""
    address: str
    """IPv4 address."""
    port: int
    host: str
    """Name of the machine, such as `wled-desk.local`, or `""`."""
    properties: Mapping[str, str | None] = MappingProxyType({})
    """Values of its TXT record, by key."""


async def browse(kind: str, seconds: float) -> list[NetworkService]:
    """Return the services of a `kind`, such as `_wled._tcp`, that answer within `seconds`.

    Raises:
        ConfigError: If the extra `discovery` is not installed.
    """
    try:
        from zeroconf import IPVersion, ServiceStateChange, Zeroconf  # noqa: PLC0415 - an extra
        from zeroconf.asyncio import AsyncServiceBrowser, AsyncServiceInfo, AsyncZeroconf  # noqa: PLC0415
    except ImportError as error:
        raise ConfigError(f"the search in the network needs an extra: run {remedy('discovery')}") from error
    full_kind = f"{kind}.local."
    names: set[str] = set()

    def on_change(zeroconf: Zeroconf, service_type: str, name: str, state_change: ServiceStateChange) -> None:
        del zeroconf, service_type
        if state_change is not ServiceStateChange.Removed and len(names) < MAX_SERVICES:
            names.add(name)

    services: list[NetworkService] = []
    with contextlib.suppress(OSError):  # a machine without a network finds nothing
        async with AsyncZeroconf(ip_version=IPVersion.V4Only) as zeroconf:
            browser = AsyncServiceBrowser(zeroconf.zeroconf, full_kind, handlers=[on_change])
            await asyncio.sleep(seconds / 2)
            infos = [AsyncServiceInfo(full_kind, name) for name in sorted(names)]
            await asyncio.gather(*(info.async_request(zeroconf.zeroconf, 500 * seconds) for info in infos))
            await browser.async_cancel()
            for info in infos:
                for address in info.parsed_addresses(IPVersion.V4Only)[:1]:
                    name = info.name.removesuffix(f".{full_kind}")
                    host = (info.server or "").rstrip(".")
                    properties = info.decoded_properties
                    services.append(NetworkService(name, address, info.port or 0, host, properties))
    return services
