"""Reservations of objects that a person is about to select, until shortly after they leave them."""

from collections.abc import Iterable

from pointit.schemas import NS_PER_S, ReservedObject


class Reservations:
    """The first person to point steadily at each object. Others see the object as taken."""

    def __init__(self, reserve_s: float) -> None:
        self._for_ns = int(reserve_s * NS_PER_S)
        self._held: dict[str, tuple[str, int]] = {}
        """By object: user, and end of the reservation, ns."""

    def holder(self, object_id: str) -> str:
        """Return the user who has reserved `object_id`, or `""`."""
        held = self._held.get(object_id)
        return "" if held is None else held[0]

    def reserve(self, object_id: str, user: str, now_ns: int) -> bool:
        """Reserve `object_id` for `user`, or extend it. Return True if it was free before.

        A reservation of another user stays.
        """
        held = self._held.get(object_id)
        if held is not None and held[0] != user:
            return False
        self._held[object_id] = (user, now_ns + self._for_ns)
        return held is None

    def keep_last(self, user: str, count: int) -> bool:
        """Free `user`'s reservations but the last `count`. Return True if there were any."""
        own = [object_id for object_id, (holder, _) in self._held.items() if holder == user]
        for object_id in own[:-count]:
            del self._held[object_id]
        return len(own) > count

    def extend(self, user: str, object_id: str, now_ns: int) -> bool:
        """Extend `user`'s reservation of `object_id`. Return False if they have none."""
        return self.holder(object_id) == user and not self.reserve(object_id, user, now_ns)

    def restore(self, reserved: Iterable[ReservedObject]) -> None:
        """Replace all reservations by `reserved`."""
        self._held = {one.id: (one.user, one.until_ns) for one in reserved}

    def free(self, object_id: str) -> bool:
        """Free `object_id`. Return True if it was reserved."""
        return self._held.pop(object_id, None) is not None

    def expire(self, now_ns: int) -> bool:
        """Free expired reservations. Return True if there were any.

        A reservation that ends later than possible was made by another machine's clock.
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
        """Return all reservations."""
        return tuple(
            ReservedObject(id=object_id, user=user, until_ns=until_ns)
            for object_id, (user, until_ns) in self._held.items()
        )
