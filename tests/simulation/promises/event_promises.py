"""Promises of single selection events: numbers, order, owners, carriers."""

from typing import Any

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import topics
from pointit.schemas.selection import REPEATED_REASON
from tests.simulation.kernel.process import Process
from tests.simulation.promises import promise
from tests.simulation.promises.breaches import Breaches
from tests.simulation.promises.history import GONE_EVENTS, History
from tests.simulation.world.room import BUTTONS, SWITCHES
from tests.simulation.world.world import World

KNOWN_AFTER_S = 3.0
"""Time after which a selector and a carrier on good links know each other, s."""
PERSONAL_CAUSES = ("dwell", "button")
ACT_CAUSES = ("", "dwell", "button", "clear")


class EventPromises:
    """Checks each selection event when it is told."""

    def __init__(self, world: World, history: History, breaches: Breaches) -> None:
        self._world = world
        self._history = history
        self._breaches = breaches
        self._by_number: dict[int, Any] = {}
        self._max_number = 0
        self._owners: dict[str, str] = {}
        """Owner of each selected object, by the events."""
        self._stamps_ns: dict[str, int] = {}
        """Stamp of the newest event of each object, ns."""
        self._has_been_absent: set[str] = set()
        """Selected objects that were missing in a selection: they left, or their event follows."""

    def on_put(self, process: Process, topic: AnyTopic, _name: str, message: Any) -> None:
        """Check an event or a selection."""
        if topic is topics.SELECTION:
            self._check_selection(message)
        elif topic is topics.SELECTION_EVENTS:
            if message.event in GONE_EVENTS:
                self._owners.pop(message.object_id, None)
            else:
                self._check_event(process, message)

    def _check_selection(self, selection: Any) -> None:
        things = {each.id for each in selection.objects}
        if len(things) != len(selection.objects):
            self._breaches.add(promise.ONE_OWNER, f"{selection!r}")
        self._has_been_absent.update(thing for thing in self._owners if thing not in things)

    def _check_event(self, process: Process, event: Any) -> None:
        is_repeated = event.reason.endswith(REPEATED_REASON)
        previous = self._by_number.get(event.seq)
        if previous is not None:
            self._check_repeated(previous, event, is_repeated=is_repeated)
            return
        if event.seq <= self._max_number:
            self._breaches.add(promise.IN_ORDER, f"{event.seq} after {self._max_number}")
        self._max_number = max(self._max_number, event.seq)
        self._by_number[event.seq] = event
        if event.event == "refused":
            return
        if event.stamp_ns <= self._stamps_ns.get(event.object_id, 0):
            self._breaches.add(promise.STAMPS_INCREASE, f"{event.seq} {event.event} {event.object_id}")
        self._stamps_ns[event.object_id] = event.stamp_ns
        self._check_owner(event, is_repeated=is_repeated)
        if is_repeated:
            return
        self._check_carriers(process, event)
        is_fired = event.event == "selected" and event.object_id in BUTTONS
        if is_fired and event.cause == "undo":
            text = f"{event.object_id} of {event.user}, by {' '.join(event.carriers)}"
            self._breaches.add(promise.UNDO_FIRES_NOTHING, text)

    def _check_repeated(self, previous: Any, event: Any, *, is_repeated: bool) -> None:
        is_same = (
            previous.event == event.event
            and previous.object_id == event.object_id
            and previous.stamp_ns == event.stamp_ns
            and previous.user == event.user
        )
        if not is_same:
            self._breaches.add(promise.ONE_EVENT_A_NUMBER, f"{event.seq}: {previous!r} and {event!r}")
        if not is_repeated:
            self._breaches.add(promise.REPEATED_SAYS_SO, f"{event.seq} {event.object_id}")

    def _check_owner(self, event: Any, *, is_repeated: bool) -> None:
        thing = event.object_id
        owner = self._owners.get(thing)
        if event.event == "selected":
            if owner is not None and not is_repeated and thing not in self._has_been_absent:
                self._breaches.add(promise.ONE_OWNER, f"{thing} of {owner} is selected by {event.user}")
            self._owners[thing] = event.user
            self._has_been_absent.discard(thing)
            return
        is_claim = thing not in BUTTONS and thing not in SWITCHES
        is_of_person = event.cause in PERSONAL_CAUSES and not is_repeated
        if owner is not None and owner != event.user and is_claim and is_of_person:
            if self._is_present(owner):
                self._breaches.add(promise.OWNER_DECIDES, f"{thing} of {owner} is ended by {event.user}")
        if owner is None and not is_repeated:
            self._breaches.add(promise.DESELECTS_SELECTED, f"{thing} by {event.user}: {event.reason}")
        self._owners.pop(thing, None)

    def _is_present(self, user: str) -> bool:
        """Return True if the processes of a person run well."""
        units = [unit for unit in self._world.units.values() if unit.user == user]
        for unit in units:
            if unit.process is None or unit.process.is_still:
                return False
            if self._world.simulation.now_s - unit.process.began_s < KNOWN_AFTER_S:
                return False
            if not self._world.network.router.link(unit.host.name).is_good:
                return False
        return bool(units)

    def _check_carriers(self, selector: Process, event: Any) -> None:
        """Check that an act names the carriers that have been within reach for a while."""
        is_act = event.event == "selected" or event.object_id in SWITCHES
        is_of_person = event.user in self._world.people and event.cause in ACT_CAUSES and not event.reason
        if not is_act or not is_of_person:
            return
        for name, (process, since_s) in self._history.carriers.items():
            if name in event.carriers or self._world.device(name, event.object_id) is None:
                continue
            age_s = self._reachable_for_s(selector, process, since_s)
            text = f"{event.event} {event.object_id} of {event.user}: {name} is there for {age_s:.3f} s"
            lives_s = self._world.simulation.now_s - selector.began_s
            if min(age_s, lives_s) > KNOWN_AFTER_S:
                self._breaches.add(promise.NAMES_CARRIERS, text)
            elif age_s > lives_s:
                self._breaches.add(promise.WAITS_FOR_CARRIERS, text)

    def _reachable_for_s(self, selector: Process, carrier: Process, since_s: float) -> float:
        """Return the time for which a carrier has been within reach, s. 0 if a link is bad."""
        sessions = self._world.network.router.sessions
        for process in (selector, carrier):
            session = sessions.get(process)
            if session is None or process.is_still or not session.is_connected or not session.link.is_good:
                return 0.0
        reachable_s = max(since_s, sessions[carrier].connected_at_s)
        selector_session = sessions[selector]
        if selector_session.number > 1:  # it was cut off, and sees everything anew
            reachable_s = max(reachable_s, selector_session.connected_at_s)
        return self._world.simulation.now_s - reachable_s
