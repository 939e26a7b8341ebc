"""Selected objects that have left: no longer listed, or not seen for too long."""

from collections.abc import Container, Iterable

from pointit.schemas import NS_PER_S

OWN = ""
"""Name of the selector's own clock. Others have the names of their trackers."""


class Departures:
    """Gives missing objects some time to come back.

    An object that its tracker no longer lists has left after `left_after_s`. One that was selected before a
    restart and has not been seen since has left after `unseen_after_s`. The time must pass on one clock,
    whichever is first, since trackers on other machines have clocks of their own.
    """

    def __init__(self, left_after_s: float, unseen_after_s: float) -> None:
        self._left_ns = round(left_after_s * NS_PER_S)
        self._unseen_ns = round(unseen_after_s * NS_PER_S)
        self._missed: dict[str, tuple[int, dict[str, int]]] = {}
        """By object: time to wait, ns, and by clock the time since which it is missing, ns."""

    def expect(self, object_ids: Iterable[str], now_ns: int) -> None:
        """Wait for `object_ids` to be seen for the first time. `now_ns` is on our own clock."""
        for object_id in object_ids:
            self._missed[object_id] = (self._unseen_ns, {OWN: now_ns})

    def step(
        self, selected: Iterable[str], present: Container[str], now_ns: int, clock: str = OWN
    ) -> list[str]:
        """Return those of `selected` that have left by `now_ns` of `clock`, given the `present` objects."""
        left: list[str] = []
        for object_id in selected:
            if object_id in present:
                self._missed.pop(object_id, None)
                continue
            wait_ns, since_ns = self._missed.setdefault(object_id, (self._left_ns, {}))
            began_ns = since_ns.setdefault(clock, now_ns)
            if began_ns > now_ns + NS_PER_S:  # the tracker's clock was set back
                since_ns[clock] = now_ns
            elif now_ns - began_ns >= wait_ns:
                del self._missed[object_id]
                left.append(object_id)
        return left
