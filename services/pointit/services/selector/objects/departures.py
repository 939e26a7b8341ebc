"""Which of the selected objects have left: listed no longer, or not seen for too long."""

from collections.abc import Container, Iterable

from pointit.schemas import NS_PER_S

OWN = ""
"""The clock of the one who asks; others have the name of whose they are."""


class Departures:
    """Gives objects that are missed some time to come back.

    Whose tracker lists them no longer has left after `left_after_s`; those that were selected before a
    restart and have not been seen since are waited for, for `unseen_after_s`. That time passes on a single
    clock, whichever comes first: trackers on other machines have clocks of their own.
    """

    def __init__(self, left_after_s: float, unseen_after_s: float) -> None:
        self._left_ns = round(left_after_s * NS_PER_S)
        self._unseen_ns = round(unseen_after_s * NS_PER_S)
        self._missed: dict[str, tuple[int, dict[str, int]]] = {}
        """By object: how long it is waited for, ns, and since when it is missed on each clock."""

    def expect(self, object_ids: Iterable[str], now_ns: int) -> None:
        """Wait for `object_ids` to be seen for the first time; `now_ns` is on our own clock."""
        for object_id in object_ids:
            self._missed[object_id] = (self._unseen_ns, {OWN: now_ns})

    def step(
        self, selected: Iterable[str], present: Container[str], now_ns: int, clock: str = OWN
    ) -> list[str]:
        """Return those `selected` that have left by `now_ns` of `clock`, of which `present` are there."""
        left: list[str] = []
        for object_id in selected:
            if object_id in present:
                self._missed.pop(object_id, None)
                continue
            wait_ns, since_ns = self._missed.setdefault(object_id, (self._left_ns, {}))
            began_ns = since_ns.setdefault(clock, now_ns)
            if began_ns > now_ns + NS_PER_S:  # the clock was set back
                since_ns[clock] = now_ns
            elif now_ns - began_ns >= wait_ns:
                del self._missed[object_id]
                left.append(object_id)
        return left
