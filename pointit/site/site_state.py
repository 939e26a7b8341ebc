"""The site now: the newest message of each key, who is present, and what is no longer valid; pure.

The bus does not report that a message has lost its writer. All that show a site go by these rules:

- All that is a person's ends with them.
- What only services of the process table write ends with the last of them, and a service's accounts with it.
- The things of a carrier of acts end with it.
- States return with their person or writer, who do not repeat them. A new process replaces them at its start.
- Late messages of people and services that have left are not shown.
- Selection events with carriers are shown when these have told the result: a failed one as refused.
- Trackers, which anybody may be, end when they are silent. A deployment without services is over. Rooms stay.

Whose presence was never seen counts as present. Times in seconds are of any monotonic clock.
"""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from pointit.schemas import ActOutcome, Deployment, Message, SelectionEvent
from pointit.schemas.system import split_instance
from pointit.schemas.table_types import Delivery, Topic
from pointit.schemas.topics import ACCOUNTS, DEPLOYMENT, MAP, OBJECTS, SELECTION_EVENTS, THING_STATES
from pointit.services.registry import PROCESSES, present_writers

M = TypeVar("M", bound=Message)
Key = tuple[Topic[Any], str]
K = TypeVar("K")
V = TypeVar("V")

MAX_TRACKER_AGE_S = 3.0
"""A tracker without messages for longer (s) is gone. It sends 25 a second."""
MAX_KEYS = 65_536
"""Maximum number of keys; the number of names is unbounded."""
MAX_FORMER = 1000
"""Maximum number of people, services and keys that are remembered after their end; the oldest go first."""


@dataclass(frozen=True, slots=True)
class Change:
    """A message to show, or one that is no longer valid."""

    topic: Topic[Any]
    name: str
    message: Message | None
    """None: the previous one is no longer valid."""
    previous: Message | None = None
    """The message that it replaces, or that is no longer valid."""


def ends_with_writers(topic: Topic[Any]) -> bool:
    """Return True if messages of `topic` are invalid without a present writer."""
    if topic is MAP or topic.delivery is Delivery.EVENT:  # the walls still stand; what happened, happened
        return False
    if topic in ACCOUNTS:
        return True
    services = {row.name for row in PROCESSES}
    return services.issuperset(topic.writers)


def is_personal(topic: Topic[Any]) -> bool:
    """Return True if messages of `topic` end with the person of their key."""
    return topic.placeholder == "user" and topic.delivery is not Delivery.EVENT


@dataclass(slots=True)
class _PendingEvent:
    """A selection event without a final outcome."""

    event: SelectionEvent
    is_shown: bool = False
    """True once a carrier has started it."""


class ActResults:
    """Selection events whose carriers have reported the result: acts that were done, not only requested."""

    def __init__(self) -> None:
        self._pending: OrderedDict[tuple[str, int], _PendingEvent] = OrderedDict()
        """By object and stamp."""
        self._early_outcomes: OrderedDict[tuple[str, int], ActOutcome] = OrderedDict()
        """Outcomes that were read before their events: two topics have no common order."""

    @property
    def pending(self) -> int:
        """Return the number of events without a final outcome, at most `MAX_FORMER`."""
        return len(self._pending)

    def event_to_show(self, message: SelectionEvent | ActOutcome) -> SelectionEvent | None:
        """Return the event to show now, which has no carriers any more, or None if there is none."""
        if isinstance(message, SelectionEvent):
            return self._on_event(message)
        return self._on_outcome(message)

    def _on_event(self, event: SelectionEvent) -> SelectionEvent | None:
        if event.takes_back:
            return None
        if not event.carriers:
            return event
        key = event.object_id, event.stamp_ns
        _remember(self._pending, key, _PendingEvent(event))
        outcome = self._early_outcomes.pop(key, None)
        if outcome is None:
            return None
        return self._on_outcome(outcome)

    def _on_outcome(self, outcome: ActOutcome) -> SelectionEvent | None:
        key = outcome.object_id, outcome.event_ns
        pending = self._pending.get(key)
        if pending is None:
            _remember(self._early_outcomes, key, outcome)
            return None
        if outcome.result == "failed":
            del self._pending[key]
            refusal = {
                "event": "refused", "reason": outcome.text, "carriers": (), "status": outcome.status
            }  # fmt: skip
            return pending.event.model_copy(update=refusal)

        was_shown = pending.is_shown
        pending.is_shown = True
        if outcome.result == "started":
            self._pending.move_to_end(key)
        else:
            del self._pending[key]
        if was_shown:
            return None
        return pending.event.model_copy(update={"carriers": (), "status": outcome.status})


class SiteState:
    """Newest messages of a site, without those that are no longer valid."""

    def __init__(
        self,
        on_change: Callable[[Change], object] | None = None,
        *,
        on_person: Callable[[str, bool], object] | None = None,
        on_service: Callable[[str, bool], object] | None = None,
        max_keys: int = MAX_KEYS,
    ) -> None:
        """Create an empty state.

        Args:
            on_change: called with each message to show, also events, and each that is no longer valid.
            on_person: called with each change of presence, before what returns with a person, and after what
                ends with them.
            on_service: the same, of service instances.
            max_keys: maximum number of keys.
        """
        self._on_change = on_change or _ignore
        self._on_person = on_person or _ignore
        self._on_service = on_service or _ignore
        self._max_keys = max_keys
        self._size = 0
        self.act_results = ActResults()
        self._messages: dict[Topic[Any], dict[str, Message]] = {}
        self._received_s: dict[Key, float] = {}
        self._services: set[str] = set()
        self._people: set[str] = set()
        self._former_services: OrderedDict[str, None] = OrderedDict()
        self._former_people: OrderedDict[str, None] = OrderedDict()
        self._orphans: OrderedDict[Key, None] = OrderedDict()
        """Keys that have lost their last writer. Those whose writers were never seen are valid."""
        self._hidden: OrderedDict[Key, tuple[Message, float]] = OrderedDict()
        """States that are invalid until their person or writer comes, and the times of their receipt."""

    @property
    def services(self) -> frozenset[str]:
        """Return the service instances that are present."""
        return frozenset(self._services)

    @property
    def former_services(self) -> frozenset[str]:
        """Return the service instances that were present, and are not."""
        return frozenset(self._former_services)

    @property
    def people(self) -> frozenset[str]:
        """Return the people who are present."""
        return frozenset(self._people)

    @property
    def former_people(self) -> frozenset[str]:
        """Return the people who were present, and are not."""
        return frozenset(self._former_people)

    def all(self, topic: Topic[M]) -> dict[str, M]:
        """Return the newest messages of `topic` by name: a live view, to be read only."""
        return cast("dict[str, M]", self._messages.setdefault(topic, {}))

    def get(self, topic: Topic[M], name: str = "") -> M | None:
        """Return the newest message of `topic` at `name`, or None."""
        return self.all(topic).get(name)

    def received_s(self, topic: Topic[Any], name: str = "") -> float | None:
        """Return the time of the newest message of `topic` at `name`, or None without one."""
        return self._received_s.get((topic, name))

    def take(self, topic: Topic[Any], name: str, message: Message, now_s: float) -> bool:
        """Store a message. Return False if there is no room for its key."""
        if topic.delivery is Delivery.EVENT:
            self._show_event(topic, name, message)
            return True
        if isinstance(message, Deployment):
            message = message.believed(name)
            if not message.services:
                self.forget(DEPLOYMENT, name)
                return True

        # A state is perhaps of a new writer, whose presence is not known yet.
        if self._is_invalid(topic, name):
            if topic.delivery is Delivery.STATE:
                _remember(self._hidden, (topic, name), (message, now_s))
            return True

        messages = self._messages.setdefault(topic, {})
        previous = messages.get(name)
        if previous is None:
            if self._size >= self._max_keys:
                return False
            self._size += 1
        messages[name] = message
        self._received_s[topic, name] = now_s
        self._on_change(Change(topic, name, message, previous))
        return True

    def forget(self, topic: Topic[Any], name: str) -> Message | None:
        """Remove the message of `topic` at `name`, which is over, and return it."""
        message = self._messages.get(topic, {}).pop(name, None)
        if message is not None:
            self._size -= 1
            del self._received_s[topic, name]
            self._on_change(Change(topic, name, None, message))
        return message

    def set_service(self, instance: str, *, present: bool) -> None:
        """Update the presence of `instance`."""
        was_present = instance in self._services
        is_known = was_present or instance in self._former_services
        if present == was_present and is_known:
            return
        if present:
            self._services.add(instance)
            self._former_services.pop(instance, None)
            self._on_service(instance, True)

            # Messages return after their writer
            for topic, name in list(self._orphans):
                if present_writers(topic, name, (instance,)):
                    del self._orphans[topic, name]
            self._show_valid()
            return

        # Messages end before their writer
        self._services.discard(instance)
        _remember(self._former_services, instance, None)
        service, _ = split_instance(instance)
        for topic in list(self._messages):
            if topic in ACCOUNTS:
                self._hide(topic, instance)
            elif service in topic.writers and ends_with_writers(topic):
                self._hide_orphans(topic, instance)
        self._on_service(instance, False)

    def _hide_orphans(self, topic: Topic[Any], former_writer: str) -> None:
        """Hide the messages of `topic` that only `former_writer` wrote."""
        for name in list(self._messages[topic]):
            if not present_writers(topic, name, (former_writer,)):
                continue
            if not present_writers(topic, name, self._services):
                _remember(self._orphans, (topic, name), None)
                self._hide(topic, name)

    def set_person(self, user: str, *, present: bool) -> None:
        """Update the presence of `user`."""
        was_present = user in self._people
        is_known = was_present or user in self._former_people
        if present == was_present and is_known:
            return
        if present:
            self._people.add(user)
            self._former_people.pop(user, None)
            self._on_person(user, True)
            self._show_valid()
            return

        self._people.discard(user)
        _remember(self._former_people, user, None)
        for topic in list(self._messages):
            if is_personal(topic):
                self._hide(topic, user)
        self._on_person(user, False)

    def set_carrier(self, name: str, *, present: bool) -> None:
        """Update the presence of the carrier `name`."""
        if present:
            self._orphans.pop((THING_STATES, name), None)
            self._show_valid()
        else:
            _remember(self._orphans, (THING_STATES, name), None)
            self._hide(THING_STATES, name)

    def tick(self, now_s: float) -> None:
        """Remove trackers that have been silent for too long."""
        for name in list(self.all(OBJECTS)):
            if now_s - self._received_s[OBJECTS, name] > MAX_TRACKER_AGE_S:
                self.forget(OBJECTS, name)

    def _show_event(self, topic: Topic[Any], name: str, message: Message) -> None:
        """Show an event. Selection events are shown when their carriers have reported the result."""
        if not isinstance(message, SelectionEvent):
            self._on_change(Change(topic, name, message))
        if isinstance(message, SelectionEvent | ActOutcome):
            event = self.act_results.event_to_show(message)
            if event is not None:
                self._on_change(Change(SELECTION_EVENTS, name, event))

    def _is_invalid(self, topic: Topic[Any], name: str) -> bool:
        if topic in ACCOUNTS:
            return name in self._former_services
        if is_personal(topic) and name in self._former_people:
            return True
        return (topic, name) in self._orphans

    def _hide(self, topic: Topic[Any], name: str) -> None:
        received_s = self._received_s.get((topic, name), 0.0)
        message = self.forget(topic, name)
        if message is not None and topic.delivery is Delivery.STATE:
            _remember(self._hidden, (topic, name), (message, received_s))

    def _show_valid(self) -> None:
        for topic, name in list(self._hidden):
            if not self._is_invalid(topic, name):
                message, received_s = self._hidden.pop((topic, name))
                self.take(topic, name, message, received_s)


def _ignore(*_: object) -> None:
    pass


def _remember(ordered: OrderedDict[K, V], key: K, value: V) -> None:
    # The oldest entry is evicted first, which bounds memory
    ordered[key] = value
    ordered.move_to_end(key)
    if len(ordered) > MAX_FORMER:
        ordered.popitem(last=False)
