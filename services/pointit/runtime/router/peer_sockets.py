"""Sockets of a router's clients: closed, and what waits in them; and ports of closed listeners.

A QUIC listener that Zenoh has closed keeps its UDP port until its last connection has ended: those of clients
that came back while it closed were never accepted, and end after 30 s.
"""

import contextlib
import ipaddress
import os
import socket
import struct
import sys
from collections.abc import Collection

from pointit.runtime.host.tcp_timeouts import own_sockets, tcp_sockets

COUNT = struct.Struct("i")

Peer = tuple[str, int]
"""Address and port, as `peer` returns them."""


def peer(host: str, port: int) -> Peer:
    """Return one spelling of an address: without zone, and IPv4 as such.

    Raises:
        ValueError: If `host` is no address.
    """
    address = ipaddress.ip_address(host.partition("%")[0])
    return str(getattr(address, "ipv4_mapped", None) or address), port


def unread() -> dict[Peer, int]:
    """Return the unacknowledged bytes (`TIOCOUTQ`) of each connection, by peer address and port."""
    found: dict[Peer, int] = {}
    if sys.platform != "linux":
        return found
    import fcntl  # noqa: PLC0415 - other systems have none
    import termios  # noqa: PLC0415 - as above

    for each in tcp_sockets():
        with contextlib.suppress(OSError, ValueError):  # closed meanwhile, or it listens
            (count,) = COUNT.unpack(fcntl.ioctl(each, termios.TIOCOUTQ, bytes(COUNT.size)))
            found[peer(*each.getpeername()[:2])] = count
    return found


def cut(peers: Collection[Peer]) -> int:
    """End the connections of this process from `peers`, each address and port; return how many were.

    Nothing more is read of them, so Zenoh closes them. If they could not be written either, Zenoh might wait
    5 s for one of them, and with it all others: measured in one of three floods.
    """
    count = 0
    for found in tcp_sockets():
        with contextlib.suppress(OSError, ValueError):  # closed meanwhile, or it listens
            if peer(*found.getpeername()[:2]) in peers:
                found.shutdown(socket.SHUT_RD)
                count += 1
    return count


def release_udp_ports(ports: Collection[int]) -> int:
    """Take away the UDP ports of closed listeners: sockets without a port get their descriptors.

    Nothing else of this process may open or close files meanwhile, on whose descriptor one could fall.

    Returns:
        Number of sockets that had one of `ports`, 0 where they cannot be found.
    """
    count = 0
    for found in own_sockets(socket.SOCK_DGRAM):
        with contextlib.suppress(OSError), socket.socket(found.family, socket.SOCK_DGRAM) as empty:
            empty.setblocking(False)
            if found.getsockname()[1] in ports:  # looked at last: its owner may close it meanwhile
                os.dup2(empty.fileno(), found.fileno(), inheritable=False)
                count += 1
    return count
