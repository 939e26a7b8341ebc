"""Host names and announced services in the network, looked up so that nothing else is delayed."""

import asyncio
import contextlib
import ipaddress
import socket
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.interfaces import interface_addresses
from pointit.runtime.host.threads import in_daemon_thread

Resolved = tuple[socket.AddressFamily, tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes]]
"""Family, and the address that sockets of this family take, with the scope of a link-local one."""

_TOWARDS = ("192.0.2.1", "10.255.255.254", "172.31.255.254", "192.168.255.254", "169.254.255.254")
"""Destinations of route look-ups, the default route first: 192.0.2.1 is of no machine (RFC 5737)."""

_TOWARDS_IPV6 = ("2001:db8::1", "fd00::1")
"""The same for IPv6: 2001:db8::1 is of no machine (RFC 3849)."""
MAX_SERVICES = 256
"""Maximum number of services of a kind whose addresses are queried. Further ones are ignored."""


def lan_addresses() -> list[str]:
    """Return this machine's IPv4 addresses as `found_addresses`; those of IPv6 where it has no others."""
    return found_addresses() or found_addresses(socket.AF_INET6)


def found_addresses(family: socket.AddressFamily = socket.AF_INET) -> list[str]:
    """Return this machine's addresses in networks it has routes to, that of the default route first.

    If no such route exists, these are the IPv4 addresses of its interfaces.
    A UDP socket is connected, which sends nothing: it only makes the system choose an interface.
    """
    addresses: list[str] = []
    for towards in _TOWARDS if family == socket.AF_INET else _TOWARDS_IPV6:
        try:
            with socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect((towards, 9))
                address: str = probe.getsockname()[0]
        except OSError:
            continue
        if address not in addresses and is_reachable(address):
            addresses.append(address)
    if addresses or family != socket.AF_INET:
        return addresses
    # a network without a default route, such as that of an access point in a hall
    return [address for address in interface_addresses() if is_reachable(address)]


def own_address(otherwise: str) -> str:
    """Return the first of `found_addresses`, or `otherwise` if there is none."""
    return next(iter(found_addresses()), otherwise)


def is_reachable(address: str) -> bool:
    """Return True if other machines could reach `address`."""
    parsed = ipaddress.ip_address(address)
    if parsed.is_loopback or parsed.is_multicast:
        return False
    is_scoped = parsed.version == 6 and parsed.is_link_local  # it needs the name of an interface
    return not (parsed.is_unspecified or is_scoped)


def resolve(host: str, port: int, kind: socket.SocketKind) -> list[Resolved]:
    """Return the addresses of `host`, a name or an address, those of IPv4 first. Blocks.

    Devices with a name for both often listen at IPv4 alone. `""` is all addresses of this machine.

    Raises:
        OSError: If there is none.
    """
    try:
        answers = socket.getaddrinfo(host or "0.0.0.0", port, socket.AF_UNSPEC, kind)  # noqa: S104 - asked for
    except UnicodeError as error:  # a label of more than 63 characters
        raise OSError(str(error)) from error
    addresses: list[Resolved] = []
    for family, _, _, _, address in answers:
        addresses.append((family, address))
    return sorted(addresses, key=lambda resolved: resolved[0] != socket.AF_INET)


async def look_up(host: str, port: int = 0) -> Sequence[Resolved]:
    """Return the addresses for datagrams that `resolve` finds.

    A thread of the loop's own would delay the end of the loop until the resolver answers.

    Raises:
        OSError: If there is none.
    """
    with contextlib.suppress(ValueError):
        return [(socket.AF_INET, (str(ipaddress.IPv4Address(host)), port))]
    task_name = f"look up {host}"
    return await in_daemon_thread(lambda: resolve(host, port, socket.SOCK_DGRAM), task_name)


class NetworkService(NamedTuple):
    """A service in the local network."""

    name: str
    """Name of the instance, such as `wled-desk`."""
    address: str
    """IPv4 address, or that of IPv6 if the service announces no other, with the scope of a link-local one."""
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
    # a device of both may announce its IPv6 address alone, also by IPv4
    version = IPVersion.All if found_addresses(socket.AF_INET6) else IPVersion.V4Only
    if not found_addresses():
        version = IPVersion.V6Only
    # Names first, then their addresses: half of the time for each
    with contextlib.suppress(OSError):  # a machine without a network finds nothing
        async with AsyncZeroconf(ip_version=version) as zeroconf:
            browser = AsyncServiceBrowser(zeroconf.zeroconf, full_kind, handlers=[on_change])
            await asyncio.sleep(seconds / 2)
            infos = [AsyncServiceInfo(full_kind, name) for name in sorted(names)]
            timeout_ms = 500 * seconds
            await asyncio.gather(*(info.async_request(zeroconf.zeroconf, timeout_ms) for info in infos))
            await browser.async_cancel()
            for info in infos:
                addresses = [ipaddress.ip_address(text) for text in info.parsed_scoped_addresses()]
                if not addresses:
                    continue
                best = min(addresses, key=lambda address: (address.version, address.is_link_local))
                name = info.name.removesuffix(f".{full_kind}")
                host = (info.server or "").rstrip(".")
                port = info.port or 0
                services.append(NetworkService(name, str(best), port, host, info.decoded_properties))
    return services
