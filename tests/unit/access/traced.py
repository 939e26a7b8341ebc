"""A router's log, read as a router does: its lines become denied operations and loads."""

from collections.abc import Collection

from pointit.access.connection_limits import loads_of
from pointit.access.denied_operations import DeniedOperations
from pointit.access.identity_load import Load
from pointit.access.zenoh_trace import TraceCounts, ZenohTrace


class TracedOperations:
    """Reader of lines, with what is told of them and their load."""

    def __init__(self) -> None:
        self.known = 0
        """Number of times that a connection became known."""
        self.trace = ZenohTrace(self._on_identity)
        self.denied = DeniedOperations()
        self.counts = TraceCounts()
        """Counts of the last time that sentences were taken."""

    def take(self, line: str, times: int = 0) -> None:
        self.trace.take(line, times)

    def take_sentences(self, elapsed_s: float, former: Collection[str] = ()) -> dict[str, str]:
        self.counts = self.trace.pop()
        self.denied.add(self.counts)
        return self.denied.take_sentences(elapsed_s, former)

    def loads(self, former: Collection[str] = ()) -> dict[str, Load]:
        """Return the loads of the last time that sentences were taken, by account."""
        return loads_of(self.counts, {}, former)

    def sizes(self) -> dict[str, float]:
        """Return the same in messages."""
        return {account: load.messages + load.started for account, load in self.loads().items()}

    def _on_identity(self) -> None:
        self.known += 1
