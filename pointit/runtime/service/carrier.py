"""Carriers of acts: they carry out selection events of things that have targets, and report the results."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import Clock
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import AccessDeniedError, ConfigError, NoAnswerError, PointItError
from pointit.runtime.service.pause_watch import PauseWatch
from pointit.schemas import (
    NS_PER_S,
    ActResult,
    BeginAct,
    Environment,
    SelectionEvent,
    ThingState,
    ThingStates,
)
from pointit.schemas.selection import REPEATED_REASON, FailureCode, ResultKind, TargetState
from pointit.schemas.text import hide_secrets, one_line
from pointit.schemas.topics import ACT_RESULTS, BEGIN_ACT, CARRIER_ALIVE, SELECTION_EVENTS, THING_STATES

log = logging.getLogger(__name__)

MAX_AT_ONCE = 8
"""Maximum number of acts on one thing that run at once. Further ones fail as `busy`."""
MAX_ACT_AGE_S = 6.0
"""Largest age of an event that is carried out if nobody is to be asked, s, by two machines' clocks."""
ASK_TIMEOUT_S = 2.0
"""Time within which the selector has to answer whether an act may begin, s. It takes a carrier for dead after
3 s without a sign, so what it has answered less than 2 s after it was asked still holds."""
ASK_AGAIN_S = 0.1
"""Pause before it is asked again, s: none may be there, as it starts again."""
MAX_TEXT = 300


class ActFailedError(PointItError):
    """An act was not done. Its text is one sentence with the remedy, its code the kind of failure."""

    def __init__(self, code: FailureCode, text: str) -> None:
        super().__init__(text)
        self.code: FailureCode = code


def _ignore() -> None:
    """Do nothing."""


@dataclass(frozen=True)
class Act:
    """Requested change of a thing."""

    event: SelectionEvent
    tell_started: Callable[[], None] = _ignore
    """Reports that the act has started. A target calls it if the act takes long."""
    check_in_time: Callable[[], None] = _ignore
    """To be called by a target before each try, and when it has waited. Raises ActFailedError if people may
    have been told by now that the act failed. What is taken back is always in time."""

    @property
    def thing(self) -> str:
        """Return the thing."""
        return self.event.object_id

    @property
    def on(self) -> bool:
        """Return the wanted state. True if a button fired."""
        return self.event.is_on


class Target(Protocol):
    """Counterpart of a thing: a web server, a program, an entity of Home Assistant, a function."""

    @property
    def state(self) -> ThingState:
        """Return its present state, with any id, and the limit of its acts."""
        ...

    async def carry_out(self, act: Act, /) -> None:
        """Return when it is done. Raise ActFailedError if it is not. It is cancelled at the limit."""
        ...


class Carrier:
    """Carries out the acts on the things of some targets, within a limit each, and reports the results."""

    def __init__(self, bus: Bus, clock: Clock, name: str) -> None:
        """Declare it as `name`. It has no things before `use`."""
        self._bus = bus
        self._clock = clock
        self._name = name
        self._targets: Mapping[str, Sequence[Target]] = {}
        self._running: dict[asyncio.Task[None], Act] = {}
        self._waiting: dict[tuple[str, int], Collection[asyncio.Task[None]]] = {}
        """Acts that have not begun, by object and stamp, and the earlier acts that they have ended."""
        self._pause_watch = PauseWatch()
        """Watches this process while an act runs."""
        self._results: dict[str, ActResult] = {}
        """Result of the last act on each thing that has ended."""
        self._failed: dict[str, Sequence[Target]] = {}
        """Targets of each thing that have reported that they did not do its last act."""
        self._last_states: tuple[ThingState, ...] | None = None
        self._life_ns = clock.now_ns()
        """Name of this life in the reports, whatever the clock does."""
        self._reports = 0
        """Number of reports, results and states together, by which readers put them in order."""
        self._states = bus.publisher(THING_STATES, name)
        self._result_publisher = bus.publisher(ACT_RESULTS, name)
        self._subscription = bus.subscribe(SELECTION_EVENTS, self._on_event)
        self._presence = bus.announce(CARRIER_ALIVE, name)
        self.done = 0
        """Number of acts that were done."""
        self.failed = 0
        """Number of acts that failed."""

    def use(self, targets: Mapping[str, Sequence[Target]]) -> None:
        """Use these targets of each thing from now on."""
        self._targets = {name: own for name, own in targets.items() if own}
        for name in self._results.keys() - self._targets.keys():
            del self._results[name]
        for name in self._failed.keys() - self._targets.keys():
            del self._failed[name]
        self.tell()

    def tell(self) -> None:
        """Publish the states of all things, if one has changed."""
        states: list[ThingState] = []
        for name, targets in self._targets.items():
            state = _merged(name, targets)
            last_result = self._results.get(name)
            states.append(state.model_copy(update={"last": last_result}))
        things = tuple(states)
        if things != self._last_states:
            self._last_states = things
            self._reports += 1
            states_message = ThingStates(
                stamp_ns=self._clock.now_ns(),
                things=things,
                life_ns=self._life_ns,
                report=self._reports,
                asks_first=True,
            )
            self._states.put(states_message)

    async def close(self) -> None:
        """End all acts, which have then failed, and leave: its things have no carrier any more."""
        self._subscription.close()
        acts = list(self._running)
        for task in acts:
            self._cancel_act(task, ActFailedError("error", f"{self._name} ended before it was done"))
        await asyncio.gather(*acts, return_exceptions=True)
        self._pause_watch.stop()
        with contextlib.suppress(PointItError):  # the bus is closed
            self.use({})
        self._presence.close()

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        if self._name not in event.carriers or event.reason.endswith(REPEATED_REASON):
            return  # whether it was carried out before the selector was started again is not known
        # An event that was long on its way would surprise: people have pointed again by now, or given up. The
        # selector knows, and is asked. If nobody decides on it, its age counts
        age_s = (self._clock.now_ns() - event.stamp_ns) / NS_PER_S / max(1.0, self._clock.speed)
        is_decided_by_age = event.begin_within_s is None and not event.takes_back
        if is_decided_by_age and age_s > MAX_ACT_AGE_S:
            self._failed[event.object_id] = self._targets.get(event.object_id, ())
            late = (
                f"it reached {self._name} {age_s:.0f} s late: point again, or set the clocks of both machines"
            )
            self._tell_result(event, ActFailedError("no_answer", late))
            return
        received_s = asyncio.get_running_loop().time()
        act = Act(
            event,
            tell_started=lambda: self._put_result(event, "started"),
            check_in_time=lambda: self._check_in_time(event, received_s),
        )

        # Acts on the same thing that still run. Those for its other state are replaced by this one.
        acts: list[tuple[asyncio.Task[None], Act]] = []
        for task, running_act in self._running.items():
            if running_act.thing == act.thing:
                acts.append((task, running_act))
        if len(acts) >= MAX_AT_ONCE:
            self._tell_result(event, ActFailedError("busy", f"{MAX_AT_ONCE} acts on it still run: wait"))
            return
        replaced: list[asyncio.Task[None]] = []
        for task, running_act in acts:
            if running_act.on != act.on or task.cancelling():
                replaced.append(task)
        for task in replaced:
            self._cancel_act(task, ActFailedError("replaced", "it was switched again before it was done"))

        # The new one waits for their ends by itself, so that this handler returns at once
        self._pause_watch.start()
        work = self._carry_out(act, replaced, received_s)
        task = asyncio.create_task(work, name=f"act on {act.thing}")
        self._running[task] = act
        self._waiting[_key(event)] = replaced
        task.add_done_callback(self._on_act_ended)

    def _on_act_ended(self, task: asyncio.Task[None]) -> None:
        act = self._running.pop(task)
        self._waiting.pop(_key(act.event), None)
        if not self._running:
            self._pause_watch.stop()

    def _check_in_time(self, event: SelectionEvent, received_s: float) -> None:
        """Check that the act of `event` has not been reported as failed.

        Raises:
            ActFailedError: If its limit is over, or this process stood still until others took it for dead.
        """
        if event.takes_back:
            return
        if self._pause_watch.has_paused_since(received_s):
            raise ActFailedError("no_answer", f"{self._name} stood still before it was done: point again")
        targets = self._targets.get(event.object_id, ())
        limit_s = _merged(event.object_id, targets).limit_s if targets else 0.0
        if asyncio.get_running_loop().time() - received_s >= limit_s:
            raise ActFailedError("no_answer", f"not done within {limit_s:g} s")

    def _cancel_act(self, task: asyncio.Task[None], problem: ActFailedError) -> None:
        if task.cancelling() or not task.cancel():
            return
        act = self._running[task]
        earlier = self._waiting.pop(_key(act.event), None)
        if earlier is not None:
            self._note_not_begun(act, earlier)
        self._tell_result(act.event, problem)

    async def _ask_selector(self, event: SelectionEvent) -> None:
        """Return when the selector lets the act of `event` begin.

        Only it knows what people were told: this process may have been cut off, or the event long on its way.

        Raises:
            ActFailedError: If the act was given up, or the selector does not answer until it would do so.
        """
        if event.begin_within_s is None or event.takes_back:
            return
        loop = asyncio.get_running_loop()
        query = BeginAct(object_id=event.object_id, event_ns=event.stamp_ns)
        end_s = loop.time() + event.begin_within_s
        problem: PointItError | None = None
        while loop.time() < end_s:
            asked_s = loop.time()
            try:
                reply = await self._bus.call(BEGIN_ACT, query, self._name, timeout_s=ASK_TIMEOUT_S)
            except AccessDeniedError as error:
                raise ActFailedError(
                    "error", f"this carrier may not ask whether it may begin: {error}"
                ) from error
            except NoAnswerError as error:  # the selector is being started, or the link is cut
                problem = error
                await asyncio.sleep(ASK_AGAIN_S)
                continue
            except PointItError as error:
                raise ActFailedError("error", f"the selector did not let it begin: {error}") from error
            is_outdated = loop.time() - asked_s > ASK_TIMEOUT_S  # this process stood still
            if is_outdated:
                continue
            if reply.code:
                raise ActFailedError(reply.code, reply.message)
            return
        text = "the selector did not say whether it may begin: point again"
        raise ActFailedError("no_answer", text) from problem

    async def _wait_for_turn(self, act: Act, earlier: Collection[asyncio.Task[None]]) -> None:
        """Return when an act may begin: now, or when the `earlier` ones on its thing have ended.

        Raises:
            ActFailedError: If it was given up before.
        """
        await self._ask_selector(act.event)
        if not earlier:
            return
        # The newest one counts: none of them may change its target after it. That may take them long, so
        # whether it still counts is asked again
        await asyncio.wait(earlier)
        await self._ask_selector(act.event)

    async def _carry_out(self, act: Act, earlier: Collection[asyncio.Task[None]], received_s: float) -> None:
        problem: ActFailedError | None = None
        try:
            await self._wait_for_turn(act, earlier)
        except ActFailedError as error:
            problem = error
        self._waiting.pop(_key(act.event), None)
        targets = self._targets.get(act.thing, ())
        failed = self._failed.pop(act.thing, ())
        if act.event.takes_back:
            # a target that has not done the act has nothing to take back
            targets = [target for target in targets if target not in failed]
            if not targets:
                return
        if not targets:
            gone = ActFailedError("unavailable", "it has no target any more: point again")
            self._tell_result(act.event, gone)
            return
        problem = problem or self._late_problem(act)
        if problem is not None:
            self._note_not_begun(act, earlier)
            self._tell_result(act.event, problem)
            return
        limit_s = _merged(act.thing, targets).limit_s
        end_s = received_s + limit_s
        results: list[BaseException | None] = []
        try:
            # An undo has no limit: nobody waits for it, and the act before it may still have to end
            async with asyncio.timeout_at(None if act.event.takes_back else end_s):
                actions = [target.carry_out(act) for target in targets]
                results = await asyncio.gather(*actions, return_exceptions=True)
        except TimeoutError:
            results = [ActFailedError("no_answer", f"not done within {limit_s:g} s")]
        else:
            outcomes = zip(targets, results, strict=True)
            self._failed[act.thing] = [target for target, error in outcomes if error]

        # The thing has one result: the first failure stands for all
        first_error = next(filter(None, results), None)
        failure = None if first_error is None else _failure(act, first_error)
        self._tell_result(act.event, failure)

    def _late_problem(self, act: Act) -> ActFailedError | None:
        """Return the problem of an act that has waited too long for its turn, or None."""
        try:
            act.check_in_time()
        except ActFailedError as error:
            return error
        return None

    def _note_not_begun(self, act: Act, earlier: Collection[asyncio.Task[None]]) -> None:
        """Note that an act was not begun, so that there is nothing to take back.

        If it has ended `earlier` ones, the state that these have left is to be taken back.
        """
        if not earlier:
            self._failed[act.thing] = self._targets.get(act.thing, ())

    def _tell_result(self, event: SelectionEvent, problem: ActFailedError | None) -> None:
        self.done += problem is None
        self.failed += problem is not None
        if problem is not None:
            log.warning("%s: %s", event.object_id, problem)
        self._put_result(event, "done" if problem is None else "failed", problem)

    def _put_result(
        self, event: SelectionEvent, result: ResultKind, problem: ActFailedError | None = None
    ) -> None:
        targets = self._targets.get(event.object_id, ())
        state: TargetState = _merged(event.object_id, targets).state if targets else "unavailable"
        code: FailureCode = ""
        text = ""
        if problem is not None:
            code = problem.code
            text = one_line(hide_secrets(str(problem)), MAX_TEXT)
        self._reports += 1
        act_result = ActResult(
            stamp_ns=self._clock.now_ns(),
            object_id=event.object_id,
            event_ns=event.stamp_ns,
            result=result,
            state=state,
            code=code,
            text=text,
            life_ns=self._life_ns,
            report=self._reports,
        )
        if targets and result != "started":
            self._results[event.object_id] = act_result
        with contextlib.suppress(PointItError):  # the bus is closed
            self._result_publisher.put(act_result)
            self.tell()  # after the result, which then ends an act that waits for it


async def check_carrier(bus: MemoryBus, name: str) -> None:
    """Check that this identity may be the carrier `name`, and that none is: two would act on each event.

    Raises:
        AccessDeniedError: If it may not.
        ConfigError: If another process is.
    """
    if denied := await bus.denial_reason("writes", THING_STATES, name):
        raise AccessDeniedError(denied)
    if name in await bus.list_present(CARRIER_ALIVE):
        raise ConfigError(f"{name} carries out acts on these things already: end the other process")


def _key(event: SelectionEvent) -> tuple[str, int]:
    """Return the number of the act of an event: its object and stamp."""
    return event.object_id, event.stamp_ns


def _failure(act: Act, error: BaseException) -> ActFailedError:
    """Return the failure of one target. The traceback of an unexpected error is logged."""
    if isinstance(error, ActFailedError):
        return error
    log.error("act on %s failed", act.thing, exc_info=error)
    cause = f"{type(error).__name__}: {error}"
    return ActFailedError("error", f"stopped by an unexpected error ({cause})")


def _merged(name: str, targets: Sequence[Target]) -> ThingState:
    """Return the state of a thing with several targets: unavailable if one is, else the first one."""
    states = [target.state for target in targets]
    merged = _decisive_state(states)
    limit_s = max(state.limit_s for state in states)
    return merged.model_copy(update={"id": name, "limit_s": limit_s})


def _decisive_state(states: Sequence[ThingState]) -> ThingState:
    """Return the first of `states` that is unavailable, else the first known one, else the first."""
    for state in states:
        if state.state == "unavailable":
            return state
    for state in states:
        if state.state:
            return state
    return states[0]


def check_things(names: Collection[str], room: Environment) -> None:
    """Check that the map has things of these names.

    Raises:
        ConfigError: If it has not. The message names similar ones.
    """
    known = [thing.id for thing in room.things]
    for name in names:
        if name not in known:
            similar = nearest(name, known) if known else "it has none: add a section `things`"
            raise ConfigError(f"the map has no thing {name!r}; {similar}")
