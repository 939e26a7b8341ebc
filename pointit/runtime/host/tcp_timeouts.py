"""Socket options for Zenoh, so that lost peers are detected within their lease.

Zenoh closes a link after a lease without messages, but first waits for a pending write (1.10). To a
disconnected peer, that write ends only when TCP gives up, after 15 minutes. Until then an unreachable user
would seem present, and their own machine would not report the lost router. Zenoh has no setting for this
timeout. On Linux, sockets have one, and accepted sockets inherit it from the listening socket.
"""

import contextlib
import socket
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

OPEN_FILES = Path("/proc/self/fd")


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
    for found in own_sockets():
        with contextlib.suppress(OSError):  # closed meanwhile
            if not ports_of_socket(found).isdisjoint(ports):
                found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, after_ms)
                count += 1
    return count


def own_sockets(kind: socket.SocketKind = socket.SOCK_STREAM) -> Iterator[socket.socket]:
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


def ports_of_socket(found: socket.socket) -> set[int]:
    """Return the own port of a socket, and that of its peer if it is connected."""
    ports = {found.getsockname()[1]}
    with contextlib.suppress(OSError):  # it listens
        ports.add(found.getpeername()[1])
    return ports
