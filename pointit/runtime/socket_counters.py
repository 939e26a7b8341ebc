"""Counters of the system for each TCP connection of this process: what has come, and what is not read.

Zenoh logs what access control decides on, which is not all that messages make it do: no log has fragments,
interests, or the end of an answer. The system counts every byte and segment, of whatever kind and whether
permitted or denied. Linux (4.13 and newer) has these counters; elsewhere there are none.
"""

import contextlib
import socket
import struct
import sys
from collections.abc import Collection
from dataclasses import dataclass

from pointit.runtime.router_sockets import Peer, peer
from pointit.runtime.zenoh.session import own_sockets

TCP_INFO_BYTES = 256
RETRANSMITS_OFFSET = 2
BYTES_RECEIVED_OFFSET = 128
NOT_SENT_OFFSET = 144
DATA_SEGMENTS_OFFSET = 152
SEND_WINDOW_OFFSET = 228
"""Offsets in Linux's `struct tcp_info`, to which fields are only appended. The last one is of Linux 5.4."""


@dataclass(frozen=True, kw_only=True)
class SocketCounters:
    """Counters of one connection since it opened."""

    received_bytes: int
    received_segments: int
    """Number of segments with data."""
    is_peer_full: bool
    """True if something waits to be sent and the peer, which answers, takes nothing: it does not read."""


def has_counters() -> bool:
    """Return True if this system counts for each connection."""
    return sys.platform == "linux"


def socket_counters(ports: Collection[int]) -> dict[Peer, SocketCounters]:
    """Return the counters of the connections to own `ports`, by the address of the peer."""
    counters: dict[Peer, SocketCounters] = {}
    if not has_counters():
        return counters
    for connection in own_sockets():
        with contextlib.suppress(OSError, ValueError):  # it listens, or was closed meanwhile
            if connection.getsockname()[1] not in ports:
                continue
            address = peer(*connection.getpeername()[:2])
            info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, TCP_INFO_BYTES)
            parsed = _parse(info)
            if parsed is not None:
                counters[address] = parsed
    return counters


def _parse(info: bytes) -> SocketCounters | None:
    """Return the counters in a `struct tcp_info`, or None if an older system does not have them."""
    if len(info) < DATA_SEGMENTS_OFFSET + 4:
        return None
    (received_bytes,) = struct.unpack_from("Q", info, BYTES_RECEIVED_OFFSET)
    (not_sent,) = struct.unpack_from("I", info, NOT_SENT_OFFSET)
    (segments,) = struct.unpack_from("I", info, DATA_SEGMENTS_OFFSET)
    is_peer_full = False
    if len(info) >= SEND_WINDOW_OFFSET + 4:
        (window,) = struct.unpack_from("I", info, SEND_WINDOW_OFFSET)
        # A lost link retransmits instead: its window is as large as it was
        is_peer_full = not_sent > 0 and window == 0 and info[RETRANSMITS_OFFSET] == 0
    return SocketCounters(
        received_bytes=received_bytes, received_segments=segments, is_peer_full=is_peer_full
    )
