"""Present names, as they are listed and as they change."""

import weakref

from pointit.api.feed import ReceiveBuffer


class PresentNames:
    """The names that are present, and those who follow them."""

    def __init__(self) -> None:
        self.names = frozenset[str]()
        self._gone = set[str]()
        self.buffers = weakref.WeakSet[ReceiveBuffer[frozenset[str]]]()

    def on_change(self, name: str, is_there: bool) -> None:  # noqa: FBT001 - the bus's signature
        """Keep that `name` has come or gone, and say who is present now."""
        (self._gone.discard if is_there else self._gone.add)(name)
        names = self.names | {name} if is_there else self.names - {name}
        if names != self.names:
            self.names = names
            for buffer in self.buffers:
                buffer.put(names, "")

    def merge(self, listed: set[str]) -> None:
        """Add who was listed while changes already came, except those who left meanwhile."""
        self.names |= listed - self._gone
