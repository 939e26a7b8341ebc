"""Sockets of Zenoh: a vanished peer is noticed within its lease, and what is closed is closed at once.

Zenoh gives a link up when nothing came for a lease, but first waits for a pending write (1.10). To a peer
that was cut off that write ends when TCP gives up, after 15 minutes: until then an unreachable person would
be present, and their own machine would not report the lost router. Zenoh has no setting for it. On Linux
the sockets have one, and those that a listening socket accepts inherit it.

Where Zenoh closes a connection, it waits likewise until the other end has acknowledged all (`SO_LINGER`),
40 ms or more, in a thread that reads all connections that a router has accepted: a hundred rejected
strangers would block all others for seconds. Without it the system does the rest in the background.

A QUIC listener that Zenoh has closed keeps its UDP port until its last connection has ended: those of clients
that came back while it closed were never accepted, and end after 30 s.
"""

import contextlib
import ipaddress
import os
import socket
import struct
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

OPEN_FILES = Path("/proc/self/fd")
COUNT = struct.Struct("i")
LINGER = struct.Struct("ii")
"""Whether, and for how long, s."""


def set_user_timeout(ports: Collection[int], after_ms: int) -> int:
    """Set TCP to end connections from or to `ports` with nothing acknowledged for `after_ms`.

    It applies to the present sockets of this process, and to those that they will accept. Any thread may
    call it.

    Returns:
        Number of sockets set, 0 where the system has no such option.
    """
    if sys.platform != "linux":
        return 0
    count = 0
    for found in tcp_sockets():
        with contextlib.suppress(OSError):  # closed meanwhile
            if not _ports_of(found).isdisjoint(ports):
                found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, after_ms)
                count += 1
    return count


def disable_linger(ports: Collection[int]) -> int:
    """Set connections from or to `ports` to close at once. Written data are sent all the same.

    Zenoh sets each connection to linger when it is accepted, so this must be called repeatedly.

    Returns:
        Number of sockets set, 0 where they cannot be found.
    """
    if sys.platform != "linux":
        return 0
    count = 0
    for found in tcp_sockets():
        with contextlib.suppress(OSError):  # closed meanwhile
            lingers, _ = LINGER.unpack(found.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.size))
            if lingers and not _ports_of(found).isdisjoint(ports):
                found.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(0, 0))
                count += 1
    return count


def unread() -> dict[tuple[str, int], int]:
    """Return the unacknowledged bytes (`TIOCOUTQ`) of each connection, by peer address and port."""
    found: dict[tuple[str, int], int] = {}
    if sys.platform != "linux":
        return found
    import fcntl  # noqa: PLC0415 - other systems have none
    import termios  # noqa: PLC0415 - as above

    for each in tcp_sockets():
        with contextlib.suppress(OSError):  # closed meanwhile, or it listens
            host, port = each.getpeername()[:2]
            (count,) = COUNT.unpack(fcntl.ioctl(each, termios.TIOCOUTQ, bytes(COUNT.size)))
            found[host.removeprefix("::ffff:"), port] = count
    return found


def cut(peers: Collection[tuple[str, int]]) -> int:
    """End the connections of this process from `peers`, each address and port; return how many were."""
    wanted = {(ipaddress.ip_address(host), port) for host, port in peers}
    count = 0
    for found in tcp_sockets():
        with contextlib.suppress(OSError, ValueError):  # closed meanwhile, or it listens
            host, port = found.getpeername()[:2]
            address = ipaddress.ip_address(host)
            if (getattr(address, "ipv4_mapped", None) or address, port) in wanted:
                found.shutdown(socket.SHUT_RDWR)
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


def tcp_sockets() -> Iterator[socket.socket]:
    """Yield this process's TCP sockets, as `own_sockets` does."""
    yield from own_sockets(socket.SOCK_STREAM)


def own_sockets(kind: socket.SocketKind) -> Iterator[socket.socket]:
    """Yield this process's sockets of a `kind`, Zenoh's too, each only for the current iteration.

    Yields none where they cannot be listed: no /proc, or no descriptor left to read it by.

    No descriptor is duplicated and closed again: closing any descriptor of a file gives up all locks that the
    process has on it (POSIX), such as those by which SQLite excludes other writers.
    """
    try:
        entries = list(OPEN_FILES.iterdir())
    except OSError:
        return
    for entry in entries:
        try:
            found = socket.socket(fileno=int(entry.name))
        except OSError:  # not a socket, or closed meanwhile
            continue
        try:
            if found.type == kind and found.family in (socket.AF_INET, socket.AF_INET6):
                yield found
        finally:
            found.detach()  # its owner closes it


def _ports_of(found: socket.socket) -> set[int]:
    ports = {found.getsockname()[1]}
    with contextlib.suppress(OSError):  # it listens
        ports.add(found.getpeername()[1])
    return ports
