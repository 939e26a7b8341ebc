"""Search for Art-Net nodes: a broadcast question, which every node of the network answers."""

import asyncio
import contextlib
import ipaddress
import socket
from collections.abc import Sequence

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.runtime.host import extras
from pointit.services.led_driver.output.dmx.artnet_protocol import PORT, Node, poll_packet, read_reply

PACKET_BYTES = 1500
MAX_NODES = 1000


async def find_nodes(seconds: float) -> Sequence[FoundDevice]:
    """Return the nodes that answer within `seconds`.

    Raises:
        ConfigError: If the question cannot be sent.
    """
    addresses = broadcast_addresses()
    loop = asyncio.get_running_loop()
    found: dict[tuple[str, tuple[int, ...]], Node] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        try:
            sock.bind(("", PORT))  # where nodes send their answers, whatever port asks
        except OSError as error:
            raise ConfigError(
                f"Art-Net nodes cannot be searched ({error}); end other programs on UDP port {PORT}"
            ) from error
        for address in addresses:
            with contextlib.suppress(OSError):  # an interface without a cable
                await loop.sock_sendto(sock, poll_packet(), (address, PORT))
        try:
            async with asyncio.timeout(seconds):
                while len(found) < MAX_NODES:
                    await asyncio.sleep(0)  # a flood must not keep the time-out from ending this
                    node = read_reply(await loop.sock_recv(sock, PACKET_BYTES))
                    if node is not None:
                        found[node.address, node.universes] = node
        except TimeoutError:
            pass
    return [_device(node) for _, node in sorted(found.items())]


def broadcast_addresses() -> list[str]:
    """Return the broadcast address of each network that this machine is in, without its own loopback.

    Raises:
        ConfigError: If an extra is missing.
    """
    try:
        import ifaddr  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ConfigError(
            f"Art-Net nodes cannot be searched without the extra `discovery`; {extras.remedy('discovery')} "
            "installs it"
        ) from error
    own = [ip for adapter in ifaddr.get_adapters() for ip in adapter.ips if ip.is_IPv4]
    interfaces = [ipaddress.IPv4Interface(f"{ip.ip}/{ip.network_prefix}") for ip in own]
    return [str(each.network.broadcast_address) for each in interfaces if not each.is_loopback]


def _device(node: Node) -> FoundDevice:
    universes = ", ".join(str(universe) for universe in sorted(set(node.universes)))
    label = f"{node.name or 'Art-Net node'}, {f'universes {universes}' if universes else 'no outputs'}"
    return FoundDevice(node.address, label, {"universes": universes, "report": node.report})
