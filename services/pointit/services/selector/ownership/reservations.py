"""What somebody is about to select: theirs while they stay on it, and a moment longer."""

from pointit.schemas import NS_PER_S, ReservedObject


class Reservations:
    """Keeps who was the first to point at an object steadily; others see it as taken."""

    def __init__(self, reserve_s: float) -> None:
        self._for_ns = int(reserve_s * NS_PER_S)
        self._held: dict[str, tuple[str, int]] = {}
        """By object: who, and until when, ns."""

    def holder(self, object_id: str) -> str:
        """Return who has reserved `object_id`; empty: nobody."""
        held = self._held.get(object_id)
        return "" if held is None else held[0]

    def reserve(self, object_id: str, user: str, now_ns: int) -> bool:
        """Reserve `object_id` for `user`, or hold it on; return whether that is news.

        What somebody else has reserved stays theirs.
        """
        held = self._held.get(object_id)
        if held is not None and held[0] != user:
            return False
        self._held[object_id] = (user, now_ns + self._for_ns)
        return held is None

    def free(self, object_id: str) -> bool:
        """Free `object_id`; return whether it was reserved."""
        return self._held.pop(object_id, None) is not None

    def expire(self, now_ns: int) -> bool:
        """Free what nobody holds any more; return whether there was anything.

        What is held for longer than can be was held by a clock that has been set back since.
        """
        if not self._held:
            return False
        over = [
            object_id
            for object_id, (_, until_ns) in self._held.items()
            if until_ns < now_ns or until_ns > now_ns + self._for_ns + NS_PER_S
        ]
        for object_id in over:
            del self._held[object_id]
        return bool(over)

    def objects(self) -> tuple[ReservedObject, ...]:
        """Return what is reserved."""
        return tuple(
            ReservedObject(id=object_id, user=user, until_ns=until_ns)
            for object_id, (user, until_ns) in self._held.items()
        )
