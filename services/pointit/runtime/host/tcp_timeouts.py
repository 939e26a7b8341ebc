"""Socket options for Zenoh, so that lost peers are detected within their lease and sockets close at once.

Zenoh closes a link after a lease without messages, but first waits for a pending write (1.10). To a
disconnected peer, that write ends only when TCP gives up, after 15 minutes. Until then an unreachable user
would seem present, and their own machine would not report the lost router. Zenoh has no setting for this
timeout. On Linux, sockets have one, and accepted sockets inherit it from the listening socket.

When Zenoh closes a connection, it also waits until the peer has acknowledged all data (`SO_LINGER`), 40 ms or
more, in the thread that reads all accepted connections of a router. A hundred rejected peers would block all
others for seconds. Without lingering, the system completes the closing in the background.
"""

import contextlib
import socket
import struct
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

OPEN_FILES = Path("/proc/self/fd")
LINGER = struct.Struct("ii")
"""True if it is set, and its duration, s."""


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
