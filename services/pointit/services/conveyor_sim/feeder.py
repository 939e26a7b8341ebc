"""What is fed next, where and when."""

from collections.abc import Sequence


class Feeder:
    """Goes through a sequence of kinds and round the lanes, one object an interval."""

    def __init__(
        self, sequence: Sequence[str], *, interval_s: float, length_m: float = 0.3, count: int = 0
    ) -> None:
        """Start at once with the first kind; `count` 0 never ends, an empty `sequence` never begins."""
        self.length_m = length_m
        self._sequence = tuple(sequence)
        self._interval_s = interval_s
        self._count = count
        self.restart()

    def restart(self) -> None:
        """Begin again: the first kind, the first lane, at once."""
        self.taken = 0
        """Objects taken since the start."""
        self.due_s = 0.0
        """Time until the next object, s; 0 or less when it waits to be taken."""

    @property
    def is_done(self) -> bool:
        """Return whether there is nothing more to feed."""
        return not self._sequence or 0 < self._count <= self.taken

    def pass_time(self, elapsed_s: float) -> None:
        """Let time go by; an object that waits for room does not pile up others behind it."""
        self.due_s = max(0.0, self.due_s - elapsed_s)

    def take(self) -> str:
        """Return the next kind; the one after it is due an interval from now.

        Raises:
            ValueError: there is nothing more to feed.
        """
        if self.is_done:
            raise ValueError("there is nothing more to feed")
        kind = self._sequence[self.taken % len(self._sequence)]
        self.taken += 1
        self.due_s = self._interval_s
        return kind
