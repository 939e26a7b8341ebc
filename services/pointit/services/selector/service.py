"""Subscribes to cursors, objects, departures, buttons and the map; publishes hovers and the selection."""

import logging
from collections.abc import Sequence
from typing import ClassVar

from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import sleep
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.service.service import Context, Scope, Service
from pointit.runtime.service.stall_watch import watch_for_stalls
from pointit.schemas import (
    ButtonEvent,
    ClearSelection,
    ConveyorState,
    Cursor,
    Done,
    Environment,
    Feedback,
    Hover,
    ReleaseObject,
    Selection,
    SelectionEvent,
    SetMethod,
    SetMethodReply,
    TrackedObjects,
    UndoSelection,
)
from pointit.schemas.topics import (
    BUTTON,
    CLEAR_SELECTION,
    CONVEYOR_STATE,
    CURSOR,
    FEEDBACK,
    HOVER,
    MAP,
    OBJECTS,
    READ_HISTORY,
    RELEASE_OBJECT,
    SELECTION,
    SELECTION_EVENTS,
    SET_METHOD,
    UNDO_SELECTION,
    USER_ALIVE,
)
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.method import apply_method, is_by_angle, is_ours
from pointit.services.selector.outputs import Output, event_of
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_methods import METHODS, PersonMethod
from pointit.services.selector.store.history import History
from pointit.services.selector.store.journal import Journal, JournalContents

log = logging.getLogger(__name__)

CHECK_PERIOD_S = 0.5
"""Period of checks for what ends without a message, s."""


class Selector(Service[SelectorConfig]):
    """Turns cursors that stay on objects into selections, for all people of a site."""

    NAME: ClassVar[str] = "selector"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = SelectorConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    @classmethod
    def discard_saved_state(cls, site: str, now_ns: int) -> None:
        """Close all selections in the journal of `site`. The audit stays."""
        folder = site_folder(site, cls.NAME)
        if folder.is_dir():
            journal = Journal(folder, restore_within_s=0.0)
            journal.begin(now_ns)
            if journal.problem:
                log.error("%s", journal.problem)
            journal.close()

    def __init__(self, config: SelectorConfig, context: Context) -> None:
        super().__init__(config, context)
        kept = config.journal
        self._journal = Journal(
            site_folder(self.bus.site, self.NAME),
            keep_days=kept.keep_days,
            restore_within_s=kept.restore_within_s,
        )
        self._in_use = config
        self._told = ""
        """Last reported fault of the method."""
        self._engine = SelectionEngine(config, self._journal.add, self._make_method)
        self._people: dict[str, tuple[Publisher[Hover], Publisher[Feedback]]] = {}
        self._selections = self.bus.publisher(SELECTION)
        self._events = self.bus.publisher(SELECTION_EVENTS)
        self._begin(self.clock.now_ns())
        self.bus.serve(CLEAR_SELECTION, self._clear)
        self.bus.serve(UNDO_SELECTION, self._undo)
        self.bus.serve(RELEASE_OBJECT, self._release)
        self.bus.serve(SET_METHOD, self._set_method)
        self.bus.serve(READ_HISTORY, History(self._journal.path if kept.enabled else None).answer)
        self.bus.subscribe(MAP, self._on_map)
        self.bus.subscribe(OBJECTS, self._on_objects)
        self.bus.subscribe(CONVEYOR_STATE, self._on_conveyor)
        self.bus.subscribe(SELECTION_EVENTS, self._on_event)
        # a cursor without a point only resets the hover, which is never too late
        self.bus.subscribe(CURSOR, self._on_cursor, drops_late=lambda cursor: cursor.point_m is not None)
        self.bus.subscribe(BUTTON, self._on_button)
        self.bus.watch(USER_ALIVE, self._on_presence)

    async def run(self) -> None:
        """Check periodically for what ends without a message, and maintain the journal.

        Close it at the end.
        """
        try:
            while True:
                await sleep(self.clock, CHECK_PERIOD_S)
                now_ns = self.clock.now_ns()
                self._put(self._engine.tick(now_ns))
                self._check_trackers(now_ns)
                self._check_method()
                self._maintain_journal(now_ns)
        finally:
            self._maintain_journal(self.clock.now_ns())
            self._journal.close()

    def _begin(self, now_ns: int) -> None:
        """Restore what was selected before a restart, and republish possibly unpublished events."""
        kept = self._journal.begin(now_ns) if self.config.journal.enabled else JournalContents()
        if self._journal.problem:
            log.error("%s", self._journal.problem)
        self._engine.restore(kept.entries, kept.events, now_ns)
        self._selections.put(self._engine.selection(now_ns))
        for record in kept.unpublished:
            event = event_of(record, record.seq or 0, again=True)
            if event is not None:
                self._put([Output("", event)])
        self._maintain_journal(now_ns)

    def _maintain_journal(self, now_ns: int) -> None:
        self._journal.maintain(now_ns, is_selected=self._engine.has_selected)
        self.bus.warn("journal", self._journal.problem)

    def _on_map(self, environment: Environment, _name: str) -> None:
        self._put(self._engine.on_map(environment))

    def _on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        self._put(self._engine.on_objects(tracker, objects))

    def _on_conveyor(self, state: ConveyorState, _name: str) -> None:
        self._put(self._engine.on_conveyor(state))

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self._put(self._engine.on_event(event))

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        self._put(self._engine.on_cursor(user, cursor))

    def _on_button(self, button: ButtonEvent, user: str) -> None:
        self._put(self._engine.on_button(user, button))

    def _on_presence(self, user: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        self._put(self._engine.set_present(user, present, self.clock.now_ns()))

    async def _clear(self, _query: ClearSelection, user: str) -> Done:
        events = _events(self._put(self._engine.clear(user, self.clock.now_ns())))
        done = [event for event in events if event.event == "deselected"]
        return Done(message=f"{len(done)} of {user}'s objects deselected")

    async def _undo(self, _query: UndoSelection, user: str) -> Done:
        outputs = self._put(self._engine.undo(user, self.clock.now_ns()))
        return Done(message=_done_message(outputs))

    async def _release(self, query: ReleaseObject, user: str) -> Done:
        now_ns = self.clock.now_ns()
        outputs = self._put(self._engine.release(user, query.object_id, query.take_over, now_ns))
        return Done(message=_done_message(outputs))

    async def _set_method(self, query: SetMethod, _name: str) -> SetMethodReply:
        try:
            wanted = apply_method(self.config, self._in_use, query.name or query.method, query.dwell_s)
        except (ValueError, ConfigError) as error:
            raise RefusedError(str(error)) from error
        if wanted != self._in_use:
            self._in_use = wanted
            self._engine.use(wanted)
        method = wanted.method
        return SetMethodReply(
            message=f"staying on an object for {wanted.dwell_s:g} s selects it: {method}",
            method=method if is_ours(method) else "gauge" if is_by_angle(wanted) else "hold",
            dwell_s=wanted.dwell_s,
            name=method,
            installed=METHODS.names,
        )

    def _make_method(self, config: SelectorConfig, user: str) -> PersonMethod:
        watch_for_stalls(METHODS.module(config.method), METHODS.label(config.method), self.bus)
        around = self.surroundings(METHODS.kind, config.method, user)
        return METHODS.get(config.method).make(config.section(config.method), around)

    def _check_method(self) -> None:
        fault = self._engine.fault()
        name = self._in_use.method
        problem = f"{METHODS.label(name)} failed ({fault}): choose another one, or update it" if fault else ""
        if problem and problem != self._told:
            log.error("%s", problem)
        self._told = problem
        self.bus.warn("method", problem)

    def _put(self, outputs: list[Output]) -> list[Output]:
        """Publish `outputs`, after the journal has committed them, and return them."""
        self._journal.commit(self.clock.now_ns())
        for output in outputs:
            message = output.message
            if isinstance(message, Hover):
                self._person(output.user)[0].put(message)
            elif isinstance(message, Feedback):
                self._person(output.user)[1].put(message)
            elif isinstance(message, Selection):
                self._selections.put(message)
            else:
                self._events.put(message)
                self._journal.mark_published(message.seq)
        return outputs

    def _person(self, user: str) -> tuple[Publisher[Hover], Publisher[Feedback]]:
        person = self._people.get(user)
        if person is None:
            person = self._people[user] = (
                self.bus.publisher(HOVER, user),
                self.bus.publisher(FEEDBACK, user),
            )
        return person

    def _check_trackers(self, now_ns: int) -> None:
        silent = ", ".join(sorted(self._engine.stale_trackers(now_ns)))
        problem = (
            f"no objects from {silent}, so theirs cannot be hovered: is it running, and is its clock right?"
        )
        self.bus.warn("objects", problem if silent else "")


def _events(outputs: Sequence[Output]) -> list[SelectionEvent]:
    return [output.message for output in outputs if isinstance(output.message, SelectionEvent)]


def _done_message(outputs: Sequence[Output]) -> str:
    """Return a message of what was done.

    Raises:
        RefusedError: If nothing was done. The message gives the reason.
    """
    done = [event for event in _events(outputs) if event.event != "refused"]
    if not done:
        cues = [output.message.text for output in outputs if isinstance(output.message, Feedback)]
        raise RefusedError(cues[0] if cues else "nothing can be done")
    return ", ".join(f"{event.kind or 'object'} {event.object_id} {event.event}" for event in done)


SERVICE = Selector
