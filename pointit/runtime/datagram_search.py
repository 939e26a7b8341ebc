"""Search for devices by datagrams that are broadcast in every network of this machine."""

import asyncio
import contextlib
import socket
from collections.abc import Callable, Sequence

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.name_lookup import found_addresses
from pointit.schemas.text import system_reason

BROADCAST = "255.255.255.255"
MAX_FOUND = 1000


def open_datagram_socket(interface: str, port: int) -> socket.socket:
    """Return a socket of the address `interface`, or of all if it is `""`."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # other clients on this machine
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        sock.bind((interface, port))
    except BaseException:
        sock.close()
        raise
    return sock


async def search_by_datagrams(
    name: str,
    seconds: float,
    targets: Sequence[tuple[str, int]],
    request: Callable[[int], bytes],
    read: Callable[[bytes, str], FoundDevice | None],
    *,
    port: int = 0,
) -> Sequence[FoundDevice]:
    """Return the devices that answer within `seconds`, by their addresses.

    Args:
        name: kind of the devices in messages, a plural.
        seconds: time for the search.
        targets: addresses and ports to which the request is sent.
        request: returns the request, given the port to which the answer comes.
        read: returns the device that sent an answer from an address, or None if it is no such answer.
        port: UDP port to which all answers come, whatever port asks, or 0.

    Raises:
        ConfigError: If the request cannot be sent.
    """
    results: dict[str, FoundDevice] = {}
    loop = asyncio.get_running_loop()

    async def collect(sock: socket.socket) -> None:
        while True:
            await asyncio.sleep(0)  # a flood must not keep the time-out from ending this
            data, sender = await loop.sock_recvfrom(sock, 65536)
            device = read(data, str(sender[0]))
            has_room = len(results) < MAX_FOUND
            if device is not None and (has_room or device.address in results):
                results[device.address] = device

    # A broadcast leaves by one interface only, so each has a socket of its own. Answers may come to any.
    try:
        with contextlib.ExitStack() as opened:
            addresses = [] if port else found_addresses()
            opening = (open_datagram_socket(interface, port) for interface in addresses or [""])
            sockets = [opened.enter_context(sock) for sock in opening]
            for sock in sockets:
                for target in targets:
                    with contextlib.suppress(OSError):  # an interface without a cable
                        await loop.sock_sendto(sock, request(sock.getsockname()[1]), target)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(seconds), asyncio.TaskGroup() as group:
                    for sock in sockets:
                        group.create_task(collect(sock))
    except OSError as error:
        remedy = "check this machine's network"
        if port:
            remedy = f"end other programs on UDP port {port}"
        raise ConfigError(f"{name} cannot be searched ({system_reason(error)}); {remedy}") from error
    return [results[address] for address in sorted(results)]
