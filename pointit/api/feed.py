"""Messages as asynchronous iterators, the newest by topic and name, and functions called by pointing."""

import asyncio
import collections
import contextlib
import functools
import inspect
import itertools
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

from pointit.runtime.bus.contract import EVENT_CAPACITY, Subscription, SubscriptionStats
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import AccessDeniedError, NoMessageError, PointItError, VersionError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.service.carrier import Act, ActFailedError, Carrier, Target, check_carrier
from pointit.schemas import Environment, Message, SelectionEvent, ThingState, topics
from pointit.schemas.topics import ANY, Delivery, Topic
from pointit.site.site_state import SiteState

log = logging.getLogger(__name__)

T = TypeVar("T")

U = TypeVar("U")
M = TypeVar("M", bound=Message)
Reaction = Callable[[SelectionEvent], Awaitable[object] | object]
"""Called with an event: `thing`, `user` who pointed, `stamp_ns`, `confidence`, `cause` and `is_on`."""
F = TypeVar("F", bound=Reaction)

UNREADABLE_TIMEOUT_S = 1.0
"""Time without a readable message after which unreadable ones count as those of another version."""

MAX_INVALID_MESSAGES = 3
"""Number of unreadable messages that are tolerated before an error is raised."""
MESSAGE_TIMEOUT_S = 2.0
"""Time to wait for the first message, s."""
MAX_AT_ONCE = 8
"""Limit of calls of one function that run at once. Further events are left out, and named."""


class ReceiveBuffer(Generic[U]):
    """Holds what came, by name, until it is taken. Use in the event loop only."""

    def __init__(self, delivery: Delivery, *, one_writer: bool = False) -> None:
        self._keeps_all = delivery is Delivery.EVENT
        self._has_one_writer = one_writer and not self._keeps_all
        self._max_invalid_messages = 0 if delivery is Delivery.STATE else MAX_INVALID_MESSAGES
        self._items: collections.OrderedDict[object, tuple[str, U]] = collections.OrderedDict()
        """Items with their names, by name, or by number if it keeps all."""
        self._numbers = itertools.count()
        self._changed = asyncio.Event()
        self._is_closed = False
        self._error: Exception | None = None
        self._overflowed = 0
        self._has_received = False
        self._has_warned = False
        self.source: Subscription | None = None
        """The subscription that fills it."""

    def __len__(self) -> int:
        return len(self._items)

    @property
    def lost(self) -> int:
        """Return the number of events that were not received or not taken in time."""
        if not self._keeps_all or self.source is None:
            return 0
        return self._overflowed + self.source.traffic.lost + self.source.traffic.dropped

    def put(self, item: U, name: str) -> None:
        """Add a message of `name`. It replaces a pending one of `name`, unless all are queued."""
        self._has_received = True
        key = next(self._numbers) if self._keeps_all else name
        self._items[key] = (name, item)
        if self._keeps_all and len(self._items) > EVENT_CAPACITY:
            self._items.popitem(last=False)
            self._overflowed += 1
            if self._overflowed == 1:
                log.warning("events come faster than they are taken: the oldest ones are lost")
        self._changed.set()

    def close(self, error: Exception | None = None) -> None:
        """Stop adding. Readers get the pending messages, then `error` or the end."""
        if not self._is_closed:
            self._is_closed = True
            self._error = error
            self._changed.set()
            if self.source is not None:
                self.source.close()

    async def take(self) -> tuple[str, U]:
        """Return the oldest pending message, or wait for one.

        Raises:
            StopAsyncIteration: If the feed has ended.
            PointItError: If the feed ended with this error.
        """
        while not self._items:
            if self._is_closed:
                raise self._error or StopAsyncIteration
            self._changed.clear()
            await self._wait()
        return self._items.popitem(last=False)[1]

    async def _wait(self) -> None:
        # Until the first message, the reason of the silence may be that none can be read
        if self._has_received or self.source is None:
            await self._changed.wait()
            return
        try:
            async with asyncio.timeout(UNREADABLE_TIMEOUT_S):
                await self._changed.wait()
        except TimeoutError:
            if self.source.traffic.invalid > self._max_invalid_messages:
                self._report_unreadable(self.source.traffic)

    def _report_unreadable(self, stats: SubscriptionStats) -> None:
        if self._has_one_writer:
            self.close(VersionError(unreadable(stats)))
        elif not self._has_warned:  # others may write what can be read
            self._has_warned = True
            log.warning("%s", unreadable(stats))


def unreadable(stats: SubscriptionStats) -> str:
    """Return a message on a reader that gets only what it cannot read."""
    return (
        f"{stats.invalid} messages came and none could be read ({stats.last_error}); "
        "install the same version of PointIt here and on the site"
    )


class Feed(AsyncIterator[T], Generic[T]):
    """The messages of a topic from the call that made it on, one per step of `async for`.

    A slow loop gets the newest of each name, or of events every one, up to 1024 that wait. The loop ends when
    the site is closed, and goes on after a lost connection is back.

    Raises, in the loop:
        AccessDeniedError: If this identity may not read it.
        VersionError: If what arrives cannot be read, where one name writes all and not only events. Elsewhere
            a warning is logged and the loop goes on.
    """

    def __init__(
        self,
        buffer: ReceiveBuffer[Any],
        pick: Callable[[tuple[str, Any]], T],
        speed: Callable[[], float],
        duration_s: float | None = None,
    ) -> None:
        self._buffer = buffer
        self._pick = pick
        self._speed = speed
        self._duration_s = duration_s
        self._end_s: float | None = None
        self._remaining: int | None = None
        """Items to give after the end of the duration."""

    @property
    def lost(self) -> int:
        """Return the number of events that were lost on the way, or because the loop was too slow."""
        return self._buffer.lost

    def items(self) -> "Feed[tuple[str, T]]":
        """Return the same with the name of each item: the person, tracker, service or lamp."""
        pick = self._pick

        def pick_with_name(pair: tuple[str, Any]) -> tuple[str, T]:
            return pair[0], pick(pair)

        return Feed(self._buffer, pick_with_name, self._speed, self._duration_s)

    def during(self, seconds: float) -> "Feed[T]":
        """Return this feed with an end `seconds` of the site's time after the first step.

        `during(0)` yields only messages that have already arrived.
        """
        return Feed(self._buffer, self._pick, self._speed, seconds)

    def close(self) -> None:
        """Receive nothing more. Unnecessary where the site is closed, or nothing refers to it any more."""
        self._buffer.close()

    async def __anext__(self) -> T:
        now_s = asyncio.get_running_loop().time()
        if self._end_s is None and self._duration_s is not None:
            self._end_s = now_s + self._duration_s / self._speed()
        if self._end_s is None or now_s < self._end_s:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(self._end_s):
                    return self._pick(await self._buffer.take())
        # The time is over: what has come until now is still returned, but nothing that comes later
        if self._remaining is None:
            self._remaining = len(self._buffer)
        if not self._remaining or not len(self._buffer):
            raise StopAsyncIteration
        self._remaining -= 1
        return self._pick(await self._buffer.take())


class Newest(Mapping[str, M], Generic[M]):
    """The newest message of each present person, tracker, service or lamp, from the first use on.

    Nothing but `wait` waits, so `[name]`, `get` and `value` find nothing yet at the first use. On a secured
    site each name is received from its own first use on, since an identity may read only some.
    """

    def __init__(
        self, bus: MemoryBus, topic: Topic[M], check_open: Callable[[], None], state: SiteState
    ) -> None:
        self._bus = bus
        self._topic = topic
        self._check_open = check_open
        self._state = state
        self._values = state.all(topic)
        self._now_s = asyncio.get_running_loop().time
        self._changed = asyncio.Event()
        self._subscriptions: dict[str, Subscription] = {}

    def __getitem__(self, name: str) -> M:
        """Return the newest message of `name`.

        Raises:
            NoMessageError: If nothing has come yet, or the person, writer or tracker has left.
            BusClosedError: If the site is closed.
        """
        self._receive(name)
        if name in self._values:
            return self._values[name]
        raise NoMessageError(
            f"nothing has come on {self._topic.at(name)} yet, or it ended with its writer; `wait` for it"
        )

    def __iter__(self) -> Iterator[str]:
        self._receive(ANY)
        return iter(list(self._values))

    def __len__(self) -> int:
        self._receive(ANY)
        return len(self._values)

    @property
    def value(self) -> M:
        """The newest message of a topic that has one writer, such as the map. Raises as `[name]` does."""
        return self[""]

    async def wait(self, name: str = "", *, timeout_s: float = MESSAGE_TIMEOUT_S) -> M:
        """Return the newest message of `name`, or of the one writer, as soon as there is one.

        Raises:
            NoMessageError: If none has come within `timeout_s`.
            AccessDeniedError: If none has come since this identity may not read it.
            VersionError: If no received message can be decoded.
            BusClosedError: If the site is closed.
        """
        subscription = self._receive(name)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while name not in self._values:
                    self._changed.clear()
                    await self._changed.wait()
        self._check_open()
        if name in self._values:
            return self._values[name]

        # Nothing came: find out why, the most certain reason first
        if denied := await self._bus.denial_reason("reads", self._topic, name):
            raise AccessDeniedError(denied)
        if subscription.traffic.invalid and not self._values:
            raise VersionError(unreadable(subscription.traffic))
        key = self._topic.at(name)
        raise NoMessageError(f"nothing came on {key} within {timeout_s:g} s; see `pointit doctor`")

    def _receive(self, name: str) -> Subscription:
        self._check_open()
        self._state.tick(self._now_s())
        self._topic.at(name)
        # With access rules, a reader may be allowed one name only
        reader_name = ANY
        if self._bus.is_restricted and name:
            reader_name = name
        if reader_name not in self._subscriptions:
            subscription = self._bus.subscribe(self._topic, self._on_message, reader_name)
            self._subscriptions[reader_name] = subscription
        return self._subscriptions[reader_name]

    def _on_message(self, message: M, name: str) -> None:
        self._state.take(self._topic, name, message, self._now_s())
        self._changed.set()


class Latest:
    """The newest messages of a site. Each topic is received from its first use on."""

    def __init__(self, bus: MemoryBus, check_open: Callable[[], None], state: SiteState) -> None:
        self.cursor = Newest(bus, topics.CURSOR, check_open, state)
        """Cursors by person."""
        self.ray = Newest(bus, topics.RAY, check_open, state)
        """Pointing rays by person."""
        self.hover = Newest(bus, topics.HOVER, check_open, state)
        """Objects under cursors by person."""
        self.pose = Newest(bus, topics.POSE, check_open, state)
        """Poses by person."""
        self.interaction = Newest(bus, topics.INTERACTION, check_open, state)
        """States of the interaction by person."""
        self.objects = Newest(bus, topics.OBJECTS, check_open, state)
        """Objects by tracker."""
        self.robot = Newest(bus, topics.ROBOT_STATE, check_open, state)
        """States by robot."""
        self.health = Newest(bus, topics.HEALTH, check_open, state)
        """Reports by service instance."""
        self.lamp = Newest(bus, topics.LAMP_COLOR, check_open, state)
        """Colours by lamp."""
        self.selection = Newest(bus, topics.SELECTION, check_open, state)
        """All selected objects."""
        self.map = Newest(bus, topics.MAP, check_open, state)
        """The room."""
        self.conveyor = Newest(bus, topics.CONVEYOR_STATE, check_open, state)
        """The state of the conveyor."""


def is_reaction(event: SelectionEvent, names: Collection[str], room: Environment | None) -> bool:
    """Return True if `event` is of a thing among `names`, or of any without names: it fired, or was switched.

    Before the map has come nothing is deselected.
    """
    if names and event.object_id not in names:
        return False
    if room is None:
        return bool(names) and event.is_reaction("button")
    for thing in room.things:
        if thing.id == event.object_id and event.is_reaction(thing.mode):
            return True
    return False


async def react(
    feed: Feed[SelectionEvent], function: Reaction, fail: Callable[[PointItError], object]
) -> None:
    """Call `function` with each event: a plain one in a thread, so that it holds up nothing.

    `fail` gets the error that ends the events, such as a thing that the map does not have.
    """
    name = getattr(function, "__qualname__", repr(function))
    running: set[asyncio.Task[None]] = set()
    try:
        async for event in feed:
            if len(running) >= MAX_AT_ONCE:
                log.warning("%s still runs %d times: left out %s", name, len(running), event.object_id)
                continue
            task = asyncio.create_task(_called(function, event, name), name=f"reaction {name}")
            running.add(task)
            task.add_done_callback(running.discard)
            for _ in range(2):  # a call that ends at once has ended for the next event
                await asyncio.sleep(0)
    except PointItError as error:
        fail(error)
    finally:
        # calls in threads go on: a thread cannot be cancelled
        ending = list(running)
        for task in ending:
            task.cancel()
        await asyncio.gather(*ending, return_exceptions=True)


class FunctionTarget:
    """A function that carries out acts. Its return means that the act is done."""

    def __init__(self, function: Reaction, limit_s: float) -> None:
        self._function = function
        self._limit_s = limit_s
        self._name = getattr(function, "__name__", repr(function))
        self._running: dict[asyncio.Task[None], Act] = {}
        """Calls that run, also those in threads whose act has ended: a thread cannot be cancelled."""

    @property
    def state(self) -> ThingState:
        """Return the limit of its acts."""
        return ThingState(id="", limit_s=self._limit_s)

    async def carry_out(self, act: Act) -> None:
        """Call the function, after calls that switch the thing the other way.

        Raises:
            ActFailedError: If it raises.
        """
        # A call of a thread may go on after its act has ended: without the wait, it could switch back later
        earlier: list[asyncio.Task[None]] = []
        for running_call, running_act in self._running.items():
            is_same_thing = running_act.thing == act.thing
            if is_same_thing and running_act.on != act.on:
                earlier.append(running_call)
        if earlier:
            await asyncio.wait(earlier)
        act.check_in_time()
        call = asyncio.create_task(_call(self._function, act.event, self._name))
        self._running[call] = act
        call.add_done_callback(self._running.pop)
        try:
            await (call if inspect.iscoroutinefunction(self._function) else asyncio.shield(call))
        except ActFailedError:
            raise
        except Exception as error:
            log.exception("%s failed for %s", self._name, act.thing)
            cause = f"{type(error).__name__}: {error}"
            raise ActFailedError("error", f"{self._name} failed ({cause})") from error


async def carry(
    bus: MemoryBus, clock: Clock, name: str, targets: Mapping[str, Sequence[Target]], check: Awaitable[None]
) -> None:
    """Carry out the acts on the things of `targets` as the carrier `name` until cancelled, after `check`.

    Raises:
        AccessDeniedError: If this identity may not.
        ConfigError: If another process or function does.
    """
    await check
    await check_carrier(bus, name)
    carrier = Carrier(bus, clock, name)
    try:
        carrier.use(targets)
        await asyncio.Event().wait()
    finally:
        await carrier.close()


async def _called(function: Reaction, event: SelectionEvent, name: str) -> None:
    try:
        await _call(function, event, name)
    except Exception:
        log.exception("%s failed for %s", name, event.object_id)


async def _call(function: Reaction, event: SelectionEvent, name: str) -> None:
    if inspect.iscoroutinefunction(function):
        await function(event)
        return
    call = functools.partial(_checked, function, event)
    result = await in_daemon_thread(call, f"reaction {name}")
    if inspect.isawaitable(result):
        await result


def _checked(function: Reaction, event: SelectionEvent) -> object:
    """Call `function`; `sys.exit` would end its thread without a result."""
    try:
        return function(event)
    except SystemExit as error:
        raise RuntimeError("sys.exit() in a thread does not end the program") from error
