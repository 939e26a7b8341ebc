"""Reads cursors and objects, writes what is hovered and what is selected."""

from typing import ClassVar, Literal

from pointit.runtime import Context, Publisher, Service, sleep
from pointit.runtime.service import Scope
from pointit.schemas import (
    ClearSelection,
    Cursor,
    Done,
    Feedback,
    Hover,
    SelectionEvent,
    TrackedObjects,
)
from pointit.schemas.topics import (
    CLEAR_SELECTION,
    CURSOR,
    FEEDBACK,
    HOVER,
    OBJECTS,
    SELECTION,
    SELECTION_EVENTS,
    USER_ALIVE,
)
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.dwell import Dwell
from pointit.services.selector.hover import Whereabouts
from pointit.services.selector.ledger import Ledger

JUDGE_S = 1.0
"""How often it is looked whether a tracker has fallen silent."""

_CUES: dict[str, Literal["selected", "deselected", "refused"]] = {
    "selected": "selected",
    "deselected": "deselected",
    "refused": "refused",
}


class _Person:
    """One person who points: their dwell, and where their messages go."""

    def __init__(self, dwell: Dwell, hovers: Publisher[Hover], feedback: Publisher[Feedback]) -> None:
        self.dwell = dwell
        self.hovers = hovers
        self.feedback = feedback
        self.seq = 0
        self.cues = 0


class Selector(Service[SelectorConfig]):
    """Turns cursors that stay on objects into selections, for everybody."""

    NAME: ClassVar[str] = "selector"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = SelectorConfig

    def __init__(self, config: SelectorConfig, context: Context) -> None:
        super().__init__(config, context)
        self._whereabouts = Whereabouts(margin_m=config.margin_m, stale_after_s=config.objects_stale_after_s)
        self._ledger = Ledger()
        self._people: dict[str, _Person] = {}
        self._present: set[str] = set()
        self._selections = self.bus.publisher(SELECTION)
        self._events = self.bus.publisher(SELECTION_EVENTS)
        self._selections.put(self._ledger.selection(self.clock.now_ns()))
        self.bus.serve(CLEAR_SELECTION, self._on_clear)
        self.bus.subscribe(OBJECTS, self._on_objects)
        self.bus.subscribe(CURSOR, self._on_cursor)
        self.bus.watch(USER_ALIVE, self._on_presence)

    async def run(self) -> None:
        """Mind the trackers that fall silent."""
        while True:
            await sleep(self.clock, JUDGE_S)
            self._mind_silence(self.clock.now_ns())

    def _on_presence(self, user: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if present:
            self._present.add(user)
            self._ledger.set_gone(user, gone=False)
        else:
            self._present.discard(user)
            wait_s = self.config.ownerless_after_s / self.clock.speed
            self.bus.call_later(wait_s, lambda: self._disown(user))

    def _disown(self, user: str) -> None:
        if user not in self._present:
            self._ledger.set_gone(user, gone=True)

    def _on_objects(self, message: TrackedObjects, tracker: str) -> None:
        self._whereabouts.update(tracker, message)
        if self._ledger.keep(self._whereabouts.kinds):
            self._selections.put(self._ledger.selection(message.stamp_ns))

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        person = self._people.get(user) or self._welcome(user)
        tracked = self._whereabouts.under(cursor)
        object_id = None if tracked is None else tracked.id
        toggled = person.dwell.step(cursor.stamp_ns, object_id)
        person.seq += 1
        person.hovers.put(
            Hover(
                stamp_ns=cursor.stamp_ns,
                seq=person.seq,
                object_id=object_id or "",
                progress=person.dwell.progress(object_id),
            )
        )
        kind = None if toggled is None else self._whereabouts.kinds.get(toggled)
        if toggled is not None and kind is not None:  # it may have left in the meantime
            self._tell(self._ledger.toggle(toggled, kind, user, cursor.stamp_ns))

    async def _on_clear(self, _query: ClearSelection, user: str) -> Done:
        events = self._ledger.clear(user, self.clock.now_ns())
        for event in events:
            self._tell(event)
        return Done(message=f"{len(events)} of {user}'s objects deselected")

    def _welcome(self, user: str) -> _Person:
        config = self.config
        dwell = Dwell(
            config.method,
            window_s=config.window_s,
            timestep_s=config.timestep_s,
            fraction=config.fraction,
            release_s=config.release_s,
        )
        person = _Person(dwell, self.bus.publisher(HOVER, user), self.bus.publisher(FEEDBACK, user))
        self._people[user] = person
        return person

    def _tell(self, event: SelectionEvent) -> None:
        if event.event != "refused":
            self._selections.put(self._ledger.selection(event.stamp_ns))
        self._events.put(event)
        person = self._people.get(event.user) or self._welcome(event.user)
        person.cues += 1
        person.feedback.put(
            Feedback(
                stamp_ns=event.stamp_ns,
                seq=person.cues,
                cue=_CUES[event.event],
                text=event.reason or f"{event.kind or 'object'} {event.event}",
            )
        )

    def _mind_silence(self, now_ns: int) -> None:
        if self._whereabouts.forget(now_ns) and self._ledger.keep(self._whereabouts.kinds):
            self._selections.put(self._ledger.selection(now_ns))
        silent = self._whereabouts.silent(now_ns)
        if silent:
            names = ", ".join(sorted(silent))
            self.bus.warn(
                "objects",
                f"no news of objects from {names}; nothing of theirs can be hovered: is it running?",
            )
        else:
            self.bus.clear("objects")


SERVICE = Selector
