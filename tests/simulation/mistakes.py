"""Mistakes that can be planted in the product, to see how many seeds it takes to find each.

Each replaces one function or constant, in the child process that runs a seed.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pointit.runtime.bus.mailbox import Mailbox
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.service import carrier
from pointit.runtime.service.carrier import ActFailedError, Carrier
from pointit.schemas.requests import Done
from pointit.services.conveyor_sim.service import ConveyorSim
from pointit.services.keeper.retained_states import RetainedStates
from pointit.services.keeper.service import Keeper
from pointit.services.led_driver.lamps import ThingLamps
from pointit.services.led_driver.strip_content import StripContent
from pointit.services.selector import acts, roles
from pointit.services.selector.acts import Acts
from pointit.services.selector.arbiter import Arbiter
from pointit.services.selector.journal import Journal
from pointit.services.selector.ownership import Ledger
from pointit.services.selector.selection_publisher import SelectionPublisher
from pointit.services.selector.service import Selector
from tests.simulation.promises import promise
from tests.simulation.promises.promise import Promise

Function = Callable[..., Any]


@dataclass(frozen=True)
class Mistake:
    """A mistake, and a promise that it breaks."""

    text: str
    breaks: Promise
    plant: Callable[[], object]
    faults: tuple[str, ...] = ()
    """Faults by which it is found, for one that needs rare faults."""


MISTAKES: dict[str, Mistake] = {}


def _mistake(
    name: str, text: str, breaks: Promise, *faults: str
) -> Callable[[Callable[[], object]], Callable[[], object]]:
    """Add the decorated function as a mistake."""

    def add(plant: Callable[[], object]) -> Callable[[], object]:
        MISTAKES[name] = Mistake(text, breaks, plant, faults)
        return plant

    return add


def _replaced(owner: object, name: str, function: Function) -> None:
    """Replace a function by one that gets the original before its arguments."""
    original = getattr(owner, name)

    def replacement(*arguments: Any, **options: Any) -> Any:
        return function(original, *arguments, **options)

    setattr(owner, name, replacement)


def _returning(owner: object, name: str, make_result: Callable[[], object]) -> None:
    """Replace a function by one that does nothing but return a result."""

    def replacement(*_arguments: Any, **_options: Any) -> object:
        return make_result()

    setattr(owner, name, replacement)


def _nothing() -> None:
    return None


# Carriers


async def _ask_nobody(_carrier: Carrier, _event: Any) -> None:
    """Begin an act without asking the selector whether it still waits for it."""


@_mistake("late-acts", "a carrier carries out an act that arrives late", promise.NOT_LATE, "8,cut,far,0,8,")
def _carry_out_late() -> None:
    vars(carrier)["MAX_ACT_AGE_S"] = 600.0
    _returning(Carrier, "_check_in_time", _nothing)
    _begin_unasked()


@_mistake(
    "unasked", "a carrier begins an act that was told as failed", promise.FAILED_IS_OVER, "8,cut,far,0,4,"
)
def _begin_unasked() -> None:
    setattr(Carrier, "_ask_selector", _ask_nobody)  # noqa: B010


@_mistake(
    "repeated-acts",
    "a carrier carries out an event again that is told again",
    promise.NOT_TWICE,
    "8,kill at,selector,1,1,after selection/events",
)
def _carry_out_repeated() -> None:
    vars(carrier)["REPEATED_REASON"] = "never"


@_mistake("always-done", "a carrier reports a failed act as done", promise.DONE_IS_DONE)
def _report_success() -> None:
    def tell(original: Function, self: Carrier, event: Any, _problem: ActFailedError | None) -> None:
        original(self, event, None)

    _replaced(Carrier, "_tell_result", tell)


@_mistake("done-at-once", "a carrier reports an act as done before it begins", promise.DONE_IS_DONE)
def _report_early() -> None:
    async def carry_out(original: Function, self: Carrier, act: Any, *arguments: Any) -> None:
        self._put_result(act.event, "done")
        await original(self, act, *arguments)

    _replaced(Carrier, "_carry_out", carry_out)


@_mistake("all-acts", "a carrier carries out acts that do not name it", promise.ONLY_TOLD)
def _carry_out_all() -> None:
    def on_event(original: Function, self: Carrier, event: Any, name: str) -> None:
        is_own = event.object_id in self._targets and event.event in ("selected", "deselected")
        carriers = (self._name,) if is_own else ()
        original(self, event.model_copy(update={"carriers": carriers}), name)

    _replaced(Carrier, "_on_event", on_event)


@_mistake(
    "states-once",
    "a carrier tells the states of its things only once",
    promise.FOLLOWS_TARGET,
    "27.5,by hand,home-assistant/heater,0,0,",
)
def _tell_once() -> None:
    def tell(original: Function, self: Carrier) -> None:
        if not self._last_states:
            original(self)

    _replaced(Carrier, "tell", tell)


@_mistake("unhandled", "a handler of a carrier raises an error at an undo", promise.NO_EXCEPTION)
def _raise_at_undo() -> None:
    async def carry_out(original: Function, self: Carrier, act: Any, *arguments: Any) -> None:
        if act.event.cause == "undo":
            raise KeyError(act.thing)
        await original(self, act, *arguments)

    _replaced(Carrier, "_carry_out", carry_out)


@_mistake("task-left", "a carrier does not end what it began", promise.NO_TASK_LEFT)
def _leave_tasks() -> None:
    left: list[asyncio.Task[None]] = []

    async def close(original: Function, self: Carrier) -> None:
        left.append(asyncio.create_task(asyncio.sleep(60.0), name="left"))
        await original(self)

    _replaced(Carrier, "close", close)


# The selector's acts


@_mistake(
    "forgotten-acts",
    "a restarted selector does not wait for acts",
    promise.OUTCOME_FOLLOWS,
    "8,kill,selector,2,0,",
)
def _forget_acts() -> None:
    def restore(original: Function, self: Arbiter, *arguments: Any, **options: Any) -> None:
        options["pending"] = ()
        original(self, *arguments, **options)

    _replaced(Arbiter, "restore", restore)


@_mistake(
    "forgotten-outcomes",
    "the journal does not keep outcomes",
    promise.OUTCOME_FOLLOWS,
    "8,kill at,selector,2,2,committed",
)
def _forget_outcomes() -> None:
    def begin(original: Function, self: Journal, now_ns: int) -> Any:
        contents = original(self, now_ns)
        contents.untold.clear()
        return contents

    _replaced(Journal, "begin", begin)


@_mistake(
    "forgotten-carriers",
    "a start does not wait for carriers",
    promise.WAITS_FOR_CARRIERS,
    "8,kill,selector,0.3,0,",
)
def _forget_carriers() -> None:
    def restore(original: Function, self: Arbiter, *arguments: Any, **options: Any) -> None:
        options["carried"] = ()
        original(self, *arguments, **options)

    _replaced(Arbiter, "restore", restore)
    _returning(roles.SiteRole, "_knows_things", lambda: True)


@_mistake("no-timeout", "the selector waits for a result for ever", promise.OUTCOME_FOLLOWS)
def _wait_for_ever() -> None:
    _returning(Acts, "expire", list)


@_mistake("pending-for-ever", "a done act stays pending in the selection", promise.NOT_PENDING)
def _stay_pending() -> None:
    def is_pending(original: Function, self: Acts, object_id: str) -> bool:
        return object_id in ("heater", "washers") or original(self, object_id)

    _replaced(Acts, "is_pending", is_pending)


@_mistake("no-take-back", "a switch whose act failed stays as it was asked for", promise.GOES_BACK)
def _keep_failed() -> None:
    _returning(Arbiter, "_take_back", list)


@_mistake("no-follow", "a switch does not follow its target", promise.FOLLOWS_TARGET)
def _ignore_targets() -> None:
    _returning(Arbiter, "_follow_targets", list)


@_mistake("one-carrier", "an act names one carrier only", promise.NAMES_CARRIERS)
def _name_one_carrier() -> None:
    def begin(original: Function, self: Acts, record: Any, mode: Any) -> Any:
        record = original(self, record, mode)
        return record._replace(carriers=record.carriers.split(" ")[0])

    _replaced(Acts, "begin", begin)


@_mistake(
    "refuses-returned",
    "a carrier that has ended once stays refused",
    promise.CAN_SWITCH,
    "8,kill,home-assistant,1,0,",
)
def _refuse_returned() -> None:
    def on_presence(original: Function, self: Acts, name: str, *, present: bool) -> Any:
        known = self._carriers.get(name)
        if known is not None and known.is_present is False:
            return []
        return original(self, name, present=present)

    _replaced(Acts, "on_presence", on_presence)
    vars(acts)["MAX_ABSENCE_NS"] = 10**15


@_mistake("early-cue", "a person is told of success when the act begins", promise.CUE_AFTER_DONE)
def _cue_early() -> None:
    def publish(original: Function, self: Arbiter, user: str, changes: Any, now_ns: int) -> Any:
        outputs = original(self, user, changes, now_ns)
        for change in changes:
            for record in change.records:
                text = f"{record.kind or record.object_id} {record.event}"
                if record.event in ("selected", "deselected"):
                    outputs.append(self._publisher.cue(user, record.event, text, now_ns))
        return outputs

    _replaced(Arbiter, "_publish", publish)


@_mistake("early-reply", "a request is answered before the act is done", promise.REPLY_AFTER_DONE)
def _reply_early() -> None:
    async def set_thing(_original: Function, self: Any, query: Any, user: str) -> Done:
        outputs = self._put(self.engine.set_thing(user, query, self._clock.now_ns()))
        return Done(message=roles._done_message(outputs))

    _replaced(roles.SiteRole, "_set_thing", set_thing)


@_mistake("two-results", "a failed act is told as done, too", promise.ONE_RESULT)
def _tell_two_results() -> None:
    def publish(original: Function, self: Any, user: str, message: Any) -> None:
        original(self, user, message)
        if getattr(message, "result", "") == "failed":
            original(self, user, message.model_copy(update={"result": "done", "code": "", "text": ""}))

    _replaced(roles.SiteRole, "publish", publish)


@_mistake("other-number", "an outcome has the time of its result as its number", promise.KNOWN_OUTCOME)
def _number_by_result() -> None:
    def outcome(original: Function, self: SelectionPublisher, message: Any) -> Any:
        return original(self, message.model_copy(update={"event_ns": message.stamp_ns}))

    _replaced(SelectionPublisher, "outcome", outcome)


# Events and owners


def _commit_nothing(_outputs: Any) -> None:
    """Write nothing to the journal."""


@_mistake(
    "publish-first",
    "the journal is written after publishing",
    promise.ONE_EVENT_A_NUMBER,
    "8,kill at,selector,2,1,after selection/events",
)
def _publish_first() -> None:
    def put(original: Function, self: Any, outputs: list[Any]) -> list[Any]:
        commit = self._role.commit
        self._role.commit = _commit_nothing
        try:
            original(self, outputs)
        finally:
            self._role.commit = commit
        if not self._is_over:
            commit(outputs)
        return outputs

    _replaced(Selector, "_put", put)


@_mistake(
    "numbers-anew",
    "a restarted selector begins to number anew",
    promise.ONE_EVENT_A_NUMBER,
    "8,kill,selector,1,0,",
)
def _number_anew() -> None:
    _returning(SelectionPublisher, "resume_numbering", _nothing)


@_mistake("swapped-events", "two events of one step are told in the wrong order", promise.IN_ORDER)
def _swap_events() -> None:
    def put(original: Function, self: Any, outputs: list[Any]) -> list[Any]:
        return original(self, outputs[::-1])

    _replaced(Selector, "_put", put)


@_mistake(
    "silent-repetition",
    "a repeated event does not say so",
    promise.REPEATED_SAYS_SO,
    "8,kill at,selector,1,1,after selection/events",
)
def _repeat_silently() -> None:
    def event_of(original: Function, record: Any, seq: int, *, again: bool = False) -> Any:
        del again
        return original(record, seq)

    _replaced(roles, "event_of", event_of)


@_mistake(
    "equal-stamps",
    "an event has the time of its clock as stamp",
    promise.STAMPS_INCREASE,
    "6,coarse clock,hub,0,16,",
    "8,burst,heater,60,0,set",
)
def _stamp_by_clock() -> None:
    def stamp_ns(_original: Function, _self: Ledger, _object_id: str, now_ns: int) -> int:
        return now_ns

    _replaced(Ledger, "_next_stamp_ns", stamp_ns)


@_mistake("selected-twice", "what somebody has is selected again", promise.ONE_OWNER)
def _select_twice() -> None:
    def toggle(original: Function, self: Ledger, object_id: str, *arguments: Any, **options: Any) -> Any:
        self._entries.pop(object_id, None)
        return original(self, object_id, *arguments, **options)

    _replaced(Ledger, "toggle", toggle)


@_mistake("cleared-twice", "clear tells each end twice", promise.DESELECTS_SELECTED)
def _clear_twice() -> None:
    def clear(original: Function, self: Ledger, user: str, now_ns: int) -> Any:
        changes = original(self, user, now_ns)
        return [*changes, *changes]

    _replaced(Ledger, "clear", clear)


@_mistake("any-owner", "anybody ends the claim of another person", promise.OWNER_DECIDES)
def _ignore_owner() -> None:
    _returning(Ledger, "blocking_owner", str)


@_mistake("undo-oldest", "undo takes the oldest step", promise.UNDO_IS_EXACT)
def _undo_oldest() -> None:
    def undo(original: Function, self: Ledger, user: str, *arguments: Any) -> Any:
        steps = self._steps.get(user)
        if steps:
            steps.rotate(-1)
        return original(self, user, *arguments)

    _replaced(Ledger, "undo", undo)


def _claim_mode(_object_id: str) -> Any:
    return "claim"


@_mistake("undo-fires", "undo takes back the end of a button", promise.UNDO_FIRES_NOTHING)
def _undo_buttons() -> None:
    def remember(original: Function, self: Ledger, user: str, step: Any) -> None:
        mode = self._mode
        self._mode = _claim_mode
        try:
            original(self, user, step)
        finally:
            self._mode = mode

    _replaced(Ledger, "_remember", remember)


# Lights, states, presence


@_mistake("light-stays", "a thing that is not selected any more stays lit", promise.LIT_FOR_SOMEBODY)
def _keep_light() -> None:
    def set_selection(original: Function, self: StripContent, selection: Any) -> None:
        if selection.objects:
            original(self, selection)

    _replaced(StripContent, "set_selection", set_selection)


@_mistake("lamp-stays", "a lamp that is not selected any more stays lit", promise.LIT_FOR_SOMEBODY)
def _keep_lamp() -> None:
    def set_selection(original: Function, self: ThingLamps, selection: Any) -> bool:
        return original(self, selection) if selection.objects else False

    _replaced(ThingLamps, "set_selection", set_selection)


@_mistake("dark-lamp", "a selected lamp is lit by the first selection only", promise.SELECTED_IS_LIT)
def _forget_lamp() -> None:
    def set_selection(original: Function, self: ThingLamps, selection: Any) -> bool:
        only = [each for each in selection.objects if each.id != "heater"]
        return original(self, selection.model_copy(update={"objects": tuple(only)}))

    _replaced(ThingLamps, "set_selection", set_selection)


@_mistake(
    "keeper-forgets", "the keeper does not read its file", promise.OBSERVERS_AGREE, "8,kill,keeper,1,0,"
)
def _forget_states() -> None:
    _returning(Keeper, "_restore", _nothing)


@_mistake("keeper-keeps-first", "the keeper keeps the first value of a state", promise.OBSERVERS_AGREE)
def _keep_first() -> None:
    def take(original: Function, self: RetainedStates, topic: Any, name: str, *arguments: Any) -> None:
        if all(known != name for known, _message in self.lookup(topic)):
            original(self, topic, name, *arguments)

    _replaced(RetainedStates, "take", take)


@_mistake("retained-first", "a retained state replaces a living writer's", promise.OBSERVERS_ARE_CURRENT)
def _prefer_retained() -> None:
    def offer_retained(original: Function, self: Mailbox, name: str, message: Any) -> None:
        self._live.discard(name)
        original(self, name, message)

    _replaced(Mailbox, "offer_retained", offer_retained)


@_mistake("stale-warning", "a warning is never cleared", promise.DOCTOR_IS_CONTENT)
def _keep_warnings() -> None:
    def warn(
        original: Function, self: ServiceBus, code: str, sentence: str, *rest: Any, **options: Any
    ) -> None:
        if sentence:
            original(self, code, sentence, *rest, **options)

    _replaced(ServiceBus, "warn", warn)
    _returning(ServiceBus, "clear", _nothing)


# Life


@_mistake("ends-by-itself", "a service ends 20 s after its start", promise.NONE_ENDS)
def _end_by_itself() -> None:
    async def run(original: Function, self: Any) -> None:
        async with asyncio.timeout(20.0):
            await original(self)

    _replaced(ConveyorSim, "run", run)


@_mistake("does-not-end", "a service does not end when it is asked", promise.ENDS_WHEN_ASKED)
def _ignore_end() -> None:
    async def run(original: Function, self: Any) -> None:
        try:
            await original(self)
        finally:
            await asyncio.sleep(600.0)

    _replaced(ConveyorSim, "run", run)


@_mistake("spins", "a timer that has ended starts again at once", promise.GOES_ON)
def _spin() -> None:
    async def run(original: Function, self: Any) -> None:
        timer = asyncio.get_running_loop()

        def again() -> None:
            timer.call_soon(again)

        timer.call_later(30.0, again)
        await original(self)

    _replaced(ConveyorSim, "run", run)
