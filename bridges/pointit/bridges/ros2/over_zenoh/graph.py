"""Nodes and endpoints in the ROS graph, from their liveliness tokens."""

import collections
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph

MAX_TOKENS = 20_000
"""Maximum number of stored foreign tokens; further ones are only counted."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Content of a token: a node, or one of its endpoints with `endpoint`."""

    node: str
    domain: int
    endpoint: Endpoint | None = None
    bridge_gid: bytes | None = None
    """Gid in messages of this endpoint if it is another PointIt's."""


class LivelinessDirectory:
    """The tokens that are alive."""

    def __init__(self, read: Callable[[str], Seen], domain: int, on_change: Callable[[], None]) -> None:
        """Create an empty graph.

        Args:
            read: parses a token; raises `ValueError` if it cannot.
            domain: our ROS_DOMAIN_ID.
            on_change: called when the graph has changed.
        """
        self._read = read
        self._on_change = on_change
        self._domain = domain
        self._seen: dict[str, Seen] = {}
        self._unreadable: set[str] = set()
        self._own: collections.Counter[str] = collections.Counter()
        self.bridged: set[bytes] = set()
        """Gids in messages of other PointIts, of any domain."""
        self._exchanged: frozenset[tuple[EndpointKind, str]] = frozenset()
        self._unseen: frozenset[tuple[EndpointKind, str]] = frozenset()

    def announce(self, token: str) -> None:
        """Add a token of ours. It stays even if others report its end, as lost routers do."""
        self._own[token] += 1
        self.change({token: True})

    def retract(self, token: str) -> None:
        """Remove a token of ours."""
        self._own[token] -= 1
        if not self._own[token]:
            del self._own[token]
            self.change({token: False})

    def change(self, tokens: Mapping[str, bool]) -> None:
        """Add tokens (True) or remove them (False)."""
        before = len(self._unreadable)
        changed = False
        for token, present in tokens.items():
            if not present and token in self._own:
                continue
            if not present:
                gone = self._seen.pop(token, None)
                if gone is not None:
                    changed = True
                    self.bridged -= {gone.bridge_gid}
                self._unreadable.discard(token)
            elif token not in self._seen and len(self._seen) + len(self._unreadable) < MAX_TOKENS:
                try:
                    seen = self._seen[token] = self._read(token)
                except ValueError:
                    self._unreadable.add(token)
                else:
                    changed = True
                    if seen.bridge_gid is not None:
                        self.bridged.add(seen.bridge_gid)
        if changed or len(self._unreadable) != before:
            self._on_change()

    def exchange(self, ends: Collection[tuple[EndpointKind, str]]) -> None:
        """Set kind and topic of the endpoints that others must have, since messages are exchanged with them.

        One without a token in any domain counts as unseen from the second call on: tokens may come later.
        """
        named = {
            (seen.endpoint.kind, seen.endpoint.name)
            for token, seen in self._seen.items()
            if seen.endpoint is not None and token not in self._own
        }
        before, self._exchanged = self._exchanged, frozenset(ends) - named
        unseen = before & self._exchanged
        if unseen != self._unseen:
            self._unseen = unseen
            self._on_change()

    def graph(self) -> Graph:
        """Return the graph: the nodes of our domain, the endpoints of every domain."""
        return Graph(
            nodes=frozenset(seen.node for seen in self._seen.values() if seen.domain == self._domain),
            endpoints=frozenset(seen.endpoint for seen in self._seen.values() if seen.endpoint is not None),
            unreadable=len(self._unreadable),
            unseen=self._unseen,
        )
