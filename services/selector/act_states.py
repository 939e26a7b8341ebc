"""What is known of the last act of each person on each object, for all who tell people of it. Pure."""

from collections import Counter, OrderedDict
from collections.abc import Collection
from typing import Literal

from pointit.schemas import ActOutcome, ActState
from pointit.services.selector.selection_publisher import ACTIONS, Record

MAX_ACT_STATES = 64
"""Maximum number of acts whose states are published. The oldest go first, of the person who has most: nobody
makes room by acts that are refused."""

Key = tuple[str, str, bool]
"""Object, person, and whether the person pointed at it: a hover names the last act by pointing."""


class ActStates:
    """States of acts. An act on a thing without a carrier is done at once."""

    def __init__(self) -> None:
        self._states: OrderedDict[Key, ActState] = OrderedDict()

    def all(self) -> tuple[ActState, ...]:
        """Return the states, that of the newest act last."""
        return tuple(self._states.values())

    def is_asked(self, object_id: str) -> bool:
        """Return True if an act on the object was told as asked, and as nothing else yet."""
        return any(state.object_id == object_id and state.status == "asked" for state in self.all())

    def begin(self, record: Record, asked_ns: int) -> None:
        """Note an act that a person asked for at `asked_ns`, and that was begun or refused."""
        status = record.status
        if status is None:  # it is no act: its object has left
            return
        state = ActState(
            object_id=record.object_id,
            user=record.user,
            event_ns=record.stamp_ns,
            asked_ns=asked_ns,
            effect=record.effect,
            status=status,
            code="refused" if status == "failed" else "",
            text=record.reason if status == "failed" else "",
        )
        self._add(_key(record), state)

    def _add(self, key: Key, state: ActState) -> None:
        self._states[key] = state
        self._states.move_to_end(key)
        if len(self._states) > MAX_ACT_STATES:
            self._evict()

    def _evict(self) -> None:
        """Forget the oldest state of the person who has most."""
        numbers = Counter(user for _object_id, user, _is_pointed in self._states)
        most = max(numbers.values())
        for key in self._states:
            _object_id, user, _is_pointed = key
            if numbers[user] == most:
                del self._states[key]
                return

    def conclude(self, record: Record, outcome: ActOutcome) -> None:
        """Note what came of the act of `record`, unless the person did a newer one on its object."""
        key = _key(record)
        state = self._states.get(key)
        if state is None or state.event_ns != record.stamp_ns:
            return
        result = {"status": outcome.status, "code": outcome.code, "text": outcome.text}
        self._states[key] = state.model_copy(update=result)

    def restore(self, outcome: ActOutcome) -> None:
        """Note an act of before a restart, unless a newer one is noted. It is taken for one by pointing."""
        effects: dict[str, Literal["select", "deselect"]] = {"selected": "select", "deselected": "deselect"}
        key = outcome.object_id, outcome.user, True
        newer = self._states.get(key)
        if newer is not None and newer.event_ns > outcome.event_ns:
            return
        state = ActState(
            object_id=outcome.object_id,
            user=outcome.user,
            event_ns=outcome.event_ns,
            asked_ns=outcome.event_ns,
            effect=effects[outcome.event],
            status=outcome.status,
            code=outcome.code,
            text=outcome.text,
        )
        self._add(key, state)

    def forget(self, object_ids: Collection[str]) -> None:
        """Forget the acts on objects that have left."""
        for key in list(self._states):
            object_id, _user, _is_pointed = key
            if object_id in object_ids:
                del self._states[key]


def _key(record: Record) -> Key:
    return record.object_id, record.user, record.cause in ACTIONS
