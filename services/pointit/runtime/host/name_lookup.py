"""Lookup of host names in a thread of its own, so that a slow resolver delays nothing else."""

import asyncio
import contextlib
import ipaddress
import socket
import threading
from collections.abc import Sequence

_TOWARDS = ("192.0.2.1", "10.255.255.254", "172.31.255.254", "192.168.255.254", "169.254.255.254")
"""Destinations of route look-ups, the default route first: 192.0.2.1 is of no machine (RFC 5737)."""


def found_addresses() -> list[str]:
    """Return this machine's IPv4 addresses in networks it has routes to, that of the default route first.

    A UDP socket is connected, which sends nothing: it only makes the system choose an interface.
    """
    found: list[str] = []
    for towards in _TOWARDS:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect((towards, 9))
            except OSError:
                continue
            address: str = probe.getsockname()[0]
        if address not in found and is_reachable(address):
            found.append(address)
    return found


def own_address(otherwise: str) -> str:
    """Return the first of `found_addresses`, or `otherwise` if there is none."""
    return next(iter(found_addresses()), otherwise)


def is_reachable(address: str) -> bool:
    """Return True if other machines could reach `address`."""
    parsed = ipaddress.ip_address(address)
    return not (parsed.is_loopback or parsed.is_unspecified or parsed.is_multicast)


Resolved = tuple[socket.AddressFamily, tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes]]
"""Family, and the address that sockets of this family take, with the scope of a link-local one."""


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
    addresses: list[Resolved] = [(family, address) for family, _, _, _, address in answers]
    return sorted(addresses, key=lambda each: each[0] != socket.AF_INET)


async def look_up(host: str, port: int = 0) -> Sequence[Resolved]:
    """Return the addresses for datagrams that `resolve` finds.

    The thread ends with the resolver's answer, or with the process: unlike a thread of the loop's own, it
    delays no end of the loop.

    Raises:
        OSError: If there is none.
    """
    with contextlib.suppress(ValueError):
        return [(socket.AF_INET, (str(ipaddress.IPv4Address(host)), port))]
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[Sequence[Resolved]] = loop.create_future()

    def settle(addresses: Sequence[Resolved], error: Exception | None) -> None:
        if answer.done():  # cancelled
            return
        if error is None:
            answer.set_result(addresses)
        else:
            answer.set_exception(error)

    def ask() -> None:
        addresses: Sequence[Resolved] = ()
        error = None
        try:
            addresses = resolve(host, port, socket.SOCK_DGRAM)
        except OSError as raised:
            error = raised
        with contextlib.suppress(RuntimeError):  # the loop is gone
            loop.call_soon_threadsafe(settle, addresses, error)

    threading.Thread(target=ask, name=f"look up {host}", daemon=True).start()
    return await answer
