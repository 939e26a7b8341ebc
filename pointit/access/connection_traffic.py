"""Traffic of each identity that no log explains, and connections whose clients do not read. Pure.

A segment, or `BYTES_OF_MESSAGE` bytes, is as much as a message. What the log has counted explains as many
segments as it has operations, and comes up to `EXPLAINED_S` after the bytes. The rest is what no log has:
fragments, ends of answers, long messages.
"""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

BYTES_OF_MESSAGE = 400
"""Bytes whose load is that of a message. A person with an IMU of 200 Hz sends 1400 messages, and 500 kB, a
second at most."""
BYTES_OF_CONNECTION = 12_000
"""Bytes of a new connection: certificates, keys, and the first messages of Zenoh."""
EXPLAINED_S = 1.0
"""Time for which the log may be behind the bytes, s."""
UNEXPLAINED_FACTOR = 2.0
"""Weight of what the log does not explain: it may be many short messages in one segment."""
FORMER_FACTOR = 10.0
"""The same of somebody whose certificate was revoked or replaced, and who has no rights."""
FULL_S = 0.5
"""Time for which a client may read nothing of what waits for it, s."""
FULL_COST = 2000.0
"""Load of a client that did not read, in messages: five of them are a flood."""


@dataclass(frozen=True, kw_only=True)
class ConnectionCounters:
    """Counters of one connection since it opened."""

    account: str
    address: str
    received_bytes: int
    received_segments: int
    is_peer_full: bool


@dataclass(kw_only=True)
class TrafficStep:
    """Result of one step."""

    unexplained: dict[str, float]
    """Load by account, in messages."""
    full: list[str]
    """Addresses of connections whose clients do not read."""


class ConnectionTraffic:
    """Compares the counters of connections with those of before, and with the log."""

    def __init__(self) -> None:
        self._previous: dict[str, ConnectionCounters] = {}
        """By address."""
        self._full_since_s: dict[str, float] = {}
        """By address."""
        self._unexplained: dict[str, float] = {}
        """Load by account that the log may explain still, in messages."""
        self._step_s: float | None = None

    def step(
        self,
        connections: Sequence[ConnectionCounters],
        logged: Mapping[str, float],
        former: Collection[str],
        now_s: float,
    ) -> TrafficStep:
        """Return what has come since the last step and is not explained by `logged`, operations by account.

        `former` are accounts of revoked and replaced certificates.
        """
        elapsed_s = 0.0 if self._step_s is None else max(0.0, now_s - self._step_s)
        self._step_s = now_s
        traffic: defaultdict[str, float] = defaultdict(float)
        for connection in connections:
            traffic[connection.account] += self._messages_of(connection)
        full = self._full_connections(connections, now_s)
        self._previous = {connection.address: connection for connection in connections}

        unexplained: dict[str, float] = {}
        for account in {*self._unexplained, *traffic, *logged}:
            waiting = self._unexplained.get(account, 0.0) + traffic[account] - logged.get(account, 0.0)
            waiting = max(0.0, waiting)
            counted = waiting * min(1.0, elapsed_s / EXPLAINED_S)
            self._unexplained[account] = waiting - counted
            if counted:
                unexplained[account] = counted * (FORMER_FACTOR if account in former else UNEXPLAINED_FACTOR)
        # What is less than a message is of accounts that have left
        self._unexplained = {name: load for name, load in self._unexplained.items() if load >= 1.0}
        for connection in connections:
            if connection.address in full:
                unexplained[connection.account] = unexplained.get(connection.account, 0.0) + FULL_COST
        return TrafficStep(unexplained=unexplained, full=full)

    def _messages_of(self, connection: ConnectionCounters) -> float:
        """Return what a connection has received since the last step, in messages."""
        previous = self._previous.get(connection.address)
        received_bytes = connection.received_bytes
        segments = connection.received_segments
        is_same = previous is not None and previous.received_bytes <= received_bytes
        if previous is not None and is_same:
            received_bytes -= previous.received_bytes
            segments -= previous.received_segments
        else:
            # Its handshake is counted as a new connection elsewhere
            received_bytes = max(0, received_bytes - BYTES_OF_CONNECTION)
            segments = min(segments, received_bytes)
        return max(received_bytes / BYTES_OF_MESSAGE, float(segments))

    def _full_connections(self, connections: Sequence[ConnectionCounters], now_s: float) -> list[str]:
        since_s: dict[str, float] = {}
        for connection in connections:
            if connection.is_peer_full:
                since_s[connection.address] = self._full_since_s.get(connection.address, now_s)
        self._full_since_s = since_s
        return [address for address, began_s in since_s.items() if now_s - began_s >= FULL_S]
