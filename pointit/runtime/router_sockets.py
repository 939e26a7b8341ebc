"""Sockets of a router in this process: those of clients are closed, ports of listeners are released.

A closed QUIC listener of Zenoh keeps its UDP port until its last connection ends. Connections of clients that
returned during the closing were never accepted, and end after 30 s.
"""

import contextlib
import ctypes
import ipaddress
import os
import socket
import struct
from collections.abc import Collection

from pointit.runtime.zenoh.session import own_sockets

Peer = tuple[str, int]
"""Address and port, as `peer` returns them."""

SO_ATTACH_FILTER = 26
KEEP_HEADERS = struct.pack("HBBI", 6, 0, 0, 1)
"""Linux's filter of one instruction, by which a connection takes acknowledgements and no data."""
MAX_DISCARDED_BYTES = 16 * 1024 * 1024
"""Above Linux's limit of what waits on a connection, which is discarded without being copied."""


def peer(host: str, port: int) -> Peer:
    """Return one spelling of an address: without zone, and IPv4 as such.

    Raises:
        ValueError: If `host` is no address.
    """
    address = ipaddress.ip_address(host.partition("%")[0])
    return str(getattr(address, "ipv4_mapped", None) or address), port


def cut(peers: Collection[Peer]) -> int:
    """End the connections of this process from `peers`, each address and port; return how many were.

    Nothing more is read of them, so Zenoh closes them. What has come or comes is discarded: Linux still
    passes it on, so a flood would keep its connection. If they could not be written either, Zenoh might wait
    5 s for one of them, and with it all others: measured in one of three floods.
    """
    return _discard(peers, should_end=True)


def hold(peers: Collection[Peer]) -> int:
    """Discard what comes from `peers` until Zenoh closes their connections, a lease (3 s) later.

    A peer that is cut off connects again within milliseconds. A peer that is held needs a lease for each new
    connection.

    Returns:
        Number of connections.
    """
    return _discard(peers, should_end=False)


def _discard(peers: Collection[Peer], *, should_end: bool) -> int:
    count = 0
    program = ctypes.create_string_buffer(KEEP_HEADERS)
    for connection in own_sockets():
        with contextlib.suppress(OSError, ValueError):  # closed meanwhile, nothing has come, or it listens
            if peer(*connection.getpeername()[:2]) not in peers:
                continue
            count += 1
            if should_end:
                connection.shutdown(socket.SHUT_RD)
            with contextlib.suppress(OSError):  # no such filter here: what has come is discarded anyway
                filter_program = struct.pack("HP", 1, ctypes.addressof(program))
                connection.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, filter_program)
            connection.recv(MAX_DISCARDED_BYTES, socket.MSG_DONTWAIT | socket.MSG_TRUNC)
    return count


def release_udp_ports(ports: Collection[int]) -> int:
    """Release the UDP ports of closed listeners by moving their descriptors to sockets without a port.

    No other code of this process may open or close files meanwhile, since a descriptor could be reused.

    Returns:
        Number of sockets that had one of `ports`, 0 where they cannot be found.
    """
    count = 0
    for listener in own_sockets(socket.SOCK_DGRAM):
        with contextlib.suppress(OSError), socket.socket(listener.family, socket.SOCK_DGRAM) as empty:
            empty.setblocking(False)
            if listener.getsockname()[1] in ports:  # looked at last: its owner may close it meanwhile
                os.dup2(empty.fileno(), listener.fileno(), inheritable=False)
                count += 1
    return count
