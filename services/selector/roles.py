"""The selector on the bus: of a whole site, or of a shard that lives beside people.

No core: it publishes, serves and waits for its timers.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence
from typing import Literal

from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S, Publisher
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import site_folder
from pointit.schemas import (
    ActOutcome,
    ActResult,
    BeginAct,
    BeginActReply,
    Claim,
    ClearSelection,
    ConveyorState,
    Done,
    Feedback,
    ReleaseObject,
    Selection,
    SelectionEvent,
    SelectionManner,
    SetMethod,
    SetMethodReply,
    SetThing,
    UndoSelection,
    topics,
)
from pointit.schemas.problems import REFUSED_ACTS, UNWRITABLE
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.journal import History, Journal, JournalContents
from pointit.services.selector.methods.pointer import MakeMethod, is_by_angle, is_ours
from pointit.services.selector.selection_engine import NO_ARBITER, SelectionEngine, ShardEngine
from pointit.services.selector.selection_methods import METHODS
from pointit.services.selector.selection_publisher import OutgoingMessage, event_of

log = logging.getLogger(__name__)

Put = Callable[[list[OutgoingMessage]], list[OutgoingMessage]]
"""Publishes outputs and returns them."""

Use = Callable[[str | None, float | None], SelectorConfig]
"""Changes the method or its time, and returns the parameters in use. Raises ValueError or ConfigError."""

_ActKey = tuple[str, int]
"""Object and stamp of the event of an act."""

MAX_UNKNOWN_S = 1.0
"""Time after the start until which requests wait for map, objects and carriers, s. Some may never come."""
MAX_ANSWER_S = 0.6 * REQUEST_TIMEOUT_S
"""Time after which a caller of `set_thing` gets a reply without the result of the act, s."""


class SiteRole:
    """The one selector of a site: it decides, keeps the journal and answers requests."""

    def __init__(
        self, config: SelectorConfig, bus: ServiceBus, clock: Clock, *, make: MakeMethod, put: Put, use: Use
    ) -> None:
        """Declare the publishers. Nothing is restored before `begin`."""
        self._bus = bus
        self._clock = clock
        self._put = put
        self._use = use

        # The journal, which gets each event of the engine
        self._has_journal = config.journal.enabled
        self._journal = Journal(
            site_folder(bus.site, "selector"),
            keep_days=config.journal.keep_days,
            restore_within_s=config.journal.restore_within_s,
            max_mb=config.journal.max_mb,
        )
        self.engine = SelectionEngine(config, self._journal.add, make)

        # Messages
        self._selections = bus.publisher(topics.SELECTION)
        self._events = bus.publisher(topics.SELECTION_EVENTS)
        self._outcomes = bus.publisher(topics.OUTCOMES)
        self._manners = bus.publisher(topics.MANNER)
        self._manner: SelectionManner | None = None
        """Last one that was published, without its stamp and number."""
        self._waiting: dict[_ActKey, asyncio.Future[ActOutcome]] = {}
        """Callers that wait for the outcome of an event, by its object and stamp."""
        self._carrier_warnings: dict[str, str] = {}
        """Warnings in force about carriers that cannot act, by carrier."""

        # What requests wait for just after the start
        self._has_map = False
        self._known_by_s = 0.0
        """Time of the loop from which requests wait no longer, s."""
        self._changed = asyncio.Event()
        """Set when something was received, while requests wait."""

    def begin(self) -> None:
        """Restore the selection from before a restart, republish possibly unpublished events, and serve."""
        # What was selected. A journal that cannot be read is reported, and nothing is selected
        now_ns = self._clock.now_ns()
        contents = self._journal.begin(now_ns) if self._has_journal else JournalContents()
        if self._journal.problem:
            log.error("%s", self._journal.problem)
        self.engine.restore(
            contents.entries,
            contents.events,
            now_ns,
            decided=contents.decided,
            pending=contents.pending,
            carried=contents.carried,
        )
        repeated_outcomes = self.engine.repeat_outcomes(contents.untold)  # the selection has them, too
        self._selections.put(self.engine.selection(now_ns))

        # Events and outcomes that were committed, but perhaps not published, before the end of the last run
        for record in contents.unpublished:
            event = event_of(record, record.seq or 0, again=True)
            if event is not None:
                self._put([OutgoingMessage("", event)])
        self._put(repeated_outcomes)
        self._maintain_journal(now_ns)

        # Requests are answered from what was restored, once it is known who carries it out
        self._known_by_s = asyncio.get_running_loop().time() + MAX_UNKNOWN_S
        self._bus.serve(topics.CLEAR_SELECTION, self._clear)
        self._bus.serve(topics.UNDO_SELECTION, self._undo)
        self._bus.serve(topics.RELEASE_OBJECT, self._release)
        self._bus.serve(topics.SET_THING, self._set_thing)
        self._bus.serve(topics.BEGIN_ACT, self._begin_act)
        self._bus.serve(topics.SET_METHOD, self._set_method)
        history = History(self._journal.path if self._has_journal else None)
        self._bus.serve(topics.READ_HISTORY, history.answer)

    def subscribe(self) -> None:
        """Subscribe to departures, claims of shards and results of acts."""
        self._bus.subscribe(topics.CONVEYOR_STATE, self._on_conveyor)
        self._bus.subscribe(topics.CLAIM, self._on_claim)
        self._bus.subscribe(topics.ACT_RESULTS, self._on_result)

    def commit(self, outputs: Sequence[OutgoingMessage]) -> None:
        """Write events and outcomes to the journal, before they are published."""
        for _user, message in outputs:
            if isinstance(message, ActOutcome) and message.result != "started":
                self._journal.add(message)
        self._journal.keep_carried(self.engine.acts.carried)
        self._journal.commit(self._clock.now_ns())
        self._changed.set()

    def publish(self, _user: str, message: Selection | SelectionEvent | Claim | ActOutcome) -> None:
        """Publish what `engine` returned."""
        if isinstance(message, Selection):
            self._selections.put(message)
        elif isinstance(message, SelectionEvent):
            self._events.put(message)
            self._journal.mark_published(message.seq)
        elif isinstance(message, ActOutcome):
            self._outcomes.put(message)
            if message.result != "started":
                self._journal.mark_told(message)
            caller = self._waiting.get((message.object_id, message.event_ns))
            if caller is not None and not caller.done():
                caller.set_result(message)

    def on_map(self, now_ns: int) -> None:
        """Publish how people select in the new room, before anybody points there."""
        self._has_map = True
        self._publish_manner(now_ns)

    def check(self, now_ns: int) -> None:
        """Maintain the journal, and warn about excessive claims and refused acts. Called periodically."""
        self._bus.warn("claims", self.engine.excess(now_ns))
        previous_warnings = self._carrier_warnings
        self._carrier_warnings = self.engine.acts.carrier_warnings()
        for carrier in {**previous_warnings, **self._carrier_warnings}:  # in their order, not that of a set
            self._bus.warn(REFUSED_ACTS, self._carrier_warnings.get(carrier, ""), carrier)
        self._publish_manner(now_ns)
        self._maintain_journal(now_ns)

    def _publish_manner(self, now_ns: int) -> None:
        """Publish how people select here, if it has changed."""
        manner = self.engine.manner(now_ns)
        plain = manner.model_copy(update={"stamp_ns": 0})
        if plain != self._manner:
            self._manner = plain
            self._manners.put(manner)

    def close(self) -> None:
        """Close the journal."""
        self._maintain_journal(self._clock.now_ns())
        self._journal.close()

    def _maintain_journal(self, now_ns: int) -> None:
        self._journal.maintain(now_ns, is_selected=self.engine.has_selected)
        self._bus.warn(UNWRITABLE, self._journal.problem, "journal")

    def _on_conveyor(self, state: ConveyorState, _name: str) -> None:
        self._put(self.engine.on_conveyor(state))

    def _on_result(self, result: ActResult, carrier: str) -> None:
        self._put(self.engine.on_result(carrier, result, self._clock.now_ns()))

    def _on_claim(self, claim: Claim, user: str) -> None:
        self._put(self.engine.on_claim(user, claim, self._clock.now_ns()))

    async def _know_things(self, *things: str) -> None:
        """Return when map, objects and carriers are known, `MAX_UNKNOWN_S` after the start at the latest.

        Without it, a thing that has a carrier would count as one without: nobody would carry out its act.
        """
        loop = asyncio.get_running_loop()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout_at(self._known_by_s):
                while loop.time() < self._known_by_s and not self._knows_things(things):
                    self._changed.clear()
                    await self._changed.wait()

    def _knows_things(self, things: Sequence[str]) -> bool:
        return self._has_map and self.engine.knows_things(*things)

    async def _clear(self, _query: ClearSelection, user: str) -> Done:
        answer_by_s = asyncio.get_running_loop().time() + MAX_ANSWER_S
        await self._know_things()
        outputs = self._put(self.engine.clear(user, self._clock.now_ns()))
        deselected = [event for event in _events(outputs) if event.event == "deselected"]
        return await self._reply(outputs, f"{len(deselected)} of {user}'s objects deselected", answer_by_s)

    async def _undo(self, _query: UndoSelection, user: str) -> Done:
        answer_by_s = asyncio.get_running_loop().time() + MAX_ANSWER_S
        await self._know_things()
        outputs = self._put(self.engine.undo(user, self._clock.now_ns()))
        return await self._reply(outputs, _done_message(outputs), answer_by_s)

    async def _release(self, query: ReleaseObject, user: str) -> Done:
        answer_by_s = asyncio.get_running_loop().time() + MAX_ANSWER_S
        await self._know_things()
        now_ns = self._clock.now_ns()
        outputs = self._put(self.engine.release(user, query.object_id, query.take_over, now_ns))
        return await self._reply(outputs, _done_message(outputs), answer_by_s)

    async def _set_thing(self, query: SetThing, user: str) -> Done:
        answer_by_s = asyncio.get_running_loop().time() + MAX_ANSWER_S
        await self._know_things(query.thing)
        outputs = self._put(self.engine.set_thing(user, query, self._clock.now_ns()))
        if outputs:
            return await self._reply(outputs, _done_message(outputs), answer_by_s)
        state = "on" if query.on else "off"
        if self.engine.acts.is_pending(query.thing):
            message = f"{query.thing} is being switched {state}: its result is not told yet"
            return Done(message=message, status="asked")
        return Done(message=f"{query.thing} is {state} already", status="done")

    async def _reply(self, outputs: Sequence[OutgoingMessage], message: str, answer_by_s: float) -> Done:
        """Return the reply to a request that has led to `outputs`, with what its carriers have told.

        Raises:
            RefusedError: If an act has failed. The message gives the reason.
        """
        events = [event for event in _events(outputs) if not event.takes_back and event.event != "refused"]
        acts = [event for event in events if event.carriers]
        if not acts:
            return Done(message=message, status="done" if events else None)

        # Acts that have failed are no part of what was done
        outcomes = await self._wait_for_outcomes(acts, answer_by_s)
        failures: list[str] = []
        for event in acts:
            outcome = outcomes.get(_key(event))
            if outcome is not None and outcome.result == "failed":
                failures.append(f"{event.kind or event.object_id}: {outcome.text}")
        if failures:
            raise RefusedError("; ".join(failures))
        silent_carriers: set[str] = set()
        for event in acts:
            if _key(event) not in outcomes:
                silent_carriers.update(event.carriers)
        if silent_carriers:
            names = ", ".join(sorted(silent_carriers))
            return Done(message=f"{message}; {names} did not tell the result yet", status="asked")
        has_started = any(outcome.result == "started" for outcome in outcomes.values())
        if has_started:
            return Done(message=f"{message}: started", status="pending")
        return Done(message=message, status="done")

    async def _wait_for_outcomes(
        self, acts: Sequence[SelectionEvent], until_s: float
    ) -> dict[_ActKey, ActOutcome]:
        """Return the first outcome of each act that comes until `until_s` of the loop's time."""
        futures: dict[_ActKey, asyncio.Future[ActOutcome]] = {}
        for event in acts:
            futures[_key(event)] = asyncio.get_running_loop().create_future()
        self._waiting.update(futures)
        try:
            remaining_s = until_s - asyncio.get_running_loop().time()
            await asyncio.wait(futures.values(), timeout=max(0.0, remaining_s))
        finally:
            for key in futures:
                del self._waiting[key]
        return {key: future.result() for key, future in futures.items() if future.done()}

    async def _begin_act(self, query: BeginAct, carrier: str) -> BeginActReply:
        code, reason = self.engine.acts.allow(carrier, query)
        return BeginActReply(message=reason or "it may begin", code=code)

    async def _set_method(self, query: SetMethod, _name: str) -> SetMethodReply:
        try:
            config = self._use(query.name or query.method, query.dwell_s)
        except (ValueError, ConfigError) as error:
            raise RefusedError(str(error)) from error

        # Callers that know the methods of this project only get the most similar one
        similar_method: Literal["hold", "fraction", "gauge"] = "hold"
        if is_ours(config.method):
            similar_method = config.method
        elif is_by_angle(config):
            similar_method = "gauge"
        return SetMethodReply(
            message=f"staying on an object for {config.dwell_s:g} s selects it: {config.method}",
            method=similar_method,
            dwell_s=config.dwell_s,
            name=config.method,
            installed=METHODS.names,
        )


def _key(event: SelectionEvent) -> _ActKey:
    return event.object_id, event.stamp_ns


def _events(outputs: Sequence[OutgoingMessage]) -> list[SelectionEvent]:
    events: list[SelectionEvent] = []
    for output in outputs:
        if isinstance(output.message, SelectionEvent):
            events.append(output.message)
    return events


def _done_message(outputs: Sequence[OutgoingMessage]) -> str:
    """Return a message of what was done.

    Raises:
        RefusedError: If nothing was done. The message gives the reason.
    """
    phrases: list[str] = []
    for event in _events(outputs):
        if event.event != "refused":
            words = (event.kind or "object", event.object_id, event.event)
            phrases.append(" ".join(dict.fromkeys(words)))  # without repetition: a kind may be the name
    if phrases:
        return ", ".join(phrases)

    # Nothing was done: the first cue gives the reason
    for output in outputs:
        if isinstance(output.message, Feedback):
            raise RefusedError(output.message.text)
    raise RefusedError("nothing can be done")


class ShardRole:
    """The selector of some people: it claims what they point at, and follows the decisions."""

    def __init__(
        self, config: SelectorConfig, bus: ServiceBus, clock: Clock, *, make: MakeMethod, put: Put, use: Use
    ) -> None:
        self._bus = bus
        self._clock = clock
        self._put = put
        self._use = use
        self.engine = ShardEngine(config, make)
        self._claims: dict[str, Publisher[Claim]] = {}
        for user in config.people:
            self._claims[user] = bus.publisher(topics.CLAIM, user)
        self._parameters: tuple[str | None, float | None] = (None, None)

    def begin(self) -> None:
        """Do nothing: there is nothing to restore."""

    def subscribe(self) -> None:
        """Subscribe to the selection and its events, and watch the site's selector."""
        self._bus.subscribe(topics.SELECTION, self._on_selection)
        self._bus.subscribe(topics.SELECTION_EVENTS, self._on_event)
        self._bus.watch(topics.SERVICE_ALIVE, self._on_service)

    def commit(self, outputs: Sequence[OutgoingMessage]) -> None:
        """Do nothing: the site's selector keeps the journal."""

    def publish(self, user: str, message: Selection | SelectionEvent | Claim | ActOutcome) -> None:
        """Publish the claims that `engine` returned."""
        if isinstance(message, Claim):
            self._claims[user].put(message)

    def on_map(self, _now_ns: int) -> None:
        """Do nothing: the site's selector publishes how people select."""

    def check(self, _now_ns: int) -> None:
        """Show in health if the site's selector cannot be reached. Called periodically."""
        self._warn_of_missing_arbiter()

    def close(self) -> None:
        """Do nothing: there is no journal."""

    def _on_service(self, instance: str, *, present: bool) -> None:
        if instance == "selector":
            self.engine.set_arbiter(present=present)
            self._warn_of_missing_arbiter()

    def _warn_of_missing_arbiter(self) -> None:
        problem = ""
        if not self.engine.has_arbiter:
            problem = f"{NO_ARBITER}: start it, or mend the network"
        self._bus.warn("arbiter", problem, "selector")

    def _on_selection(self, selection: Selection, _name: str) -> None:
        self.engine.on_selection(selection)
        parameters = selection.method, selection.dwell_s
        if selection.method is None or parameters == self._parameters:
            return
        self._parameters = parameters
        try:
            self._use(*parameters)
            self._bus.clear("follow")
        except (ValueError, ConfigError) as error:
            problem = f"method {selection.method} of the site's selector cannot be used here: {error}"
            log.error("%s", problem)  # noqa: TRY400 - the sentence says all
            self._bus.warn("follow", problem)

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self._put(self.engine.on_event(event))
