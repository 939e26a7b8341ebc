"""A site as asyncio code sees it."""

import asyncio
import contextlib
import functools
import re
import weakref
import zlib
from collections import defaultdict
from collections.abc import AsyncGenerator, Awaitable, Callable, Collection, Coroutine, Sequence
from operator import itemgetter
from typing import Any, Literal, Self, TypeVar

from pointit.api import requests
from pointit.api.feed import F, Feed, FunctionTarget, Latest, ReceiveBuffer, carry, is_reaction, react
from pointit.api.inputs import Tracker, press
from pointit.api.loop_thread import closed_error
from pointit.api.requests import Lamp
from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S, Closable, Subscription
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import Clock, wait_up_to
from pointit.runtime.errors import AccessDeniedError, NoMessageError, PointItError
from pointit.runtime.service.carrier import check_things
from pointit.schemas import (
    AddPackageReply,
    Cursor,
    Done,
    Environment,
    Health,
    HomeSetup,
    Hover,
    Interaction,
    LampColor,
    Message,
    PointingRay,
    Query,
    ReadHistoryReply,
    Referents,
    Reply,
    SelectionEvent,
    SetMethodReply,
    SetMountingReply,
    SetToleranceReply,
    Speech,
    TrackedObjects,
    UseMapReply,
    UserPose,
    Word,
    topics,
)
from pointit.schemas.selection import MAX_ACT_S
from pointit.schemas.topics import ANY, Delivery, Presence, Request, Topic, check_name
from pointit.site.following import follow_site
from pointit.site.site_state import SiteState

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)


class Site:
    """A joined site. Use it in the event loop that joined it, until the block of `connect` or `run` ends.

    Iterators begin with the call that makes them and survive a lost connection. `user`, `tracker` and
    `service` name one of many. Without them an iterator has all, and `items()` tells whose each item is.
    """

    def __init__(self, bus: MemoryBus, clock: Clock) -> None:
        """Use `bus`, which stays open; `on` is the way in."""
        self._bus = bus
        self._clock = clock
        self._buffers = weakref.WeakSet[ReceiveBuffer[Any]]()
        self._trackers = set[Tracker]()
        self._failure: Exception | None = None
        self._is_closed = False
        self._ended = asyncio.Event()

        def on_person(*_: object) -> None:
            self._publish_names(topics.USER_ALIVE)

        def on_service(*_: object) -> None:
            self._publish_names(topics.SERVICE_ALIVE)

        self._state = SiteState(on_person=on_person, on_service=on_service)
        self._followers: defaultdict[Presence, weakref.WeakSet[ReceiveBuffer[frozenset[str]]]] = defaultdict(
            weakref.WeakSet
        )
        self._watches: list[Closable] = []
        self._reactions = set[asyncio.Task[None]]()
        self._speech = functools.cache(functools.partial(bus.publisher, topics.SPEECH))
        self.latest = Latest(bus, self._check_open, self._state)
        """The newest messages by topic and name."""
        # Requests by the service that answers them, with the types of their replies
        send = self.call
        self.select = requests.SelectRequests[
            Awaitable[Done], Awaitable[SetMethodReply], Awaitable[ReadHistoryReply]
        ](send)
        self.conveyor = requests.ConveyorRequests[Awaitable[Done], Awaitable[AddPackageReply]](send)
        self.localizer = requests.LocalizerRequests[Awaitable[Done]](send)
        self.profile = requests.ProfileRequests[Awaitable[Done]](send)
        self.pui = requests.PuiRequests[
            Awaitable[Done], Awaitable[SetToleranceReply], Awaitable[UseMapReply]
        ](send)
        self.robots = requests.RobotsRequests[Awaitable[Done]](send)
        self.goal = requests.GoalRequests[Awaitable[Done]](send)
        self.listener = requests.ListenerRequests[Awaitable[Done], Awaitable[Referents]](send)
        self.run = requests.RunRequests[Awaitable[Done]](send)
        self.leds = requests.LedsRequests[Awaitable[Done]](send)
        self.imu = requests.ImuRequests[Awaitable[Done], Awaitable[SetMountingReply]](send)
        self.feedback = requests.FeedbackRequests[Awaitable[Done]](send)
        self.home = requests.HomeRequests[Awaitable[Done], Awaitable[HomeSetup]](send)

    @classmethod
    @contextlib.asynccontextmanager
    async def on(cls, bus: MemoryBus, clock: Clock) -> AsyncGenerator[Self]:
        """Yield the site of `bus`, as soon as the present people and services are known."""
        site = cls(bus, clock)
        try:
            # Listed after the watch has begun, so that no arrival is missed in between
            site._watches += follow_site(site._state, bus, asyncio.get_running_loop().time, ())
            for user in await bus.list_present(topics.USER_ALIVE) - site._state.former_people:
                site._state.set_person(user, present=True)
            for instance in await bus.list_present(topics.SERVICE_ALIVE) - site._state.former_services:
                site._state.set_service(instance, present=True)
            yield site
        finally:
            site._close()
            for task in site._reactions:
                task.cancel()
            await asyncio.gather(*site._reactions, return_exceptions=True)

    @property
    def name(self) -> str:
        """The name of the site."""
        return self._bus.site

    @property
    def problem(self) -> str:
        """A message if the connection has a problem, such as a lost router, else `""`."""
        return self._bus.problem

    def now_ns(self) -> int:
        """Return the site's time, Unix ns: wall time, simulated or virtual."""
        return self._clock.now_ns()

    async def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of the site's time.

        Raises:
            BusClosedError: If the site is closed meanwhile, at once.
            PointItError: If a service of `run` fails meanwhile, at once.
        """
        self._check_open()
        await wait_up_to(self._ended, seconds / self._clock.speed)
        self._check_open()

    async def wait(self) -> None:
        """Wait until the site is closed, while functions of `on_pointed` are called. Raises as `sleep`."""
        await self._ended.wait()
        self._check_open()

    def cursors(self, user: str | None = None) -> Feed[Cursor]:
        """Return an iterator over cursors: where the ray meets the room. Newest wins."""
        return self.messages(topics.CURSOR, user)

    def rays(self, user: str | None = None) -> Feed[PointingRay]:
        """Return an iterator over pointing rays in the person's frame {H}. Newest wins."""
        return self.messages(topics.RAY, user)

    def hovers(self, user: str | None = None) -> Feed[Hover]:
        """Return an iterator over the objects under cursors, and the progress of selecting. Newest wins."""
        return self.messages(topics.HOVER, user)

    def poses(self, user: str | None = None) -> Feed[UserPose]:
        """Return an iterator over poses, the last one at once. Newest wins."""
        return self.messages(topics.POSE, user)

    def objects(self, tracker: str | None = None) -> Feed[TrackedObjects]:
        """Return an iterator over the objects of trackers. Newest wins."""
        return self.messages(topics.OBJECTS, tracker)

    def health(self, service: str | None = None) -> Feed[Health]:
        """Return an iterator over the reports of services, such as `pointing.anna`. Newest wins."""
        return self.messages(topics.HEALTH, service)

    def selections(self, user: str | None = None) -> Feed[SelectionEvent]:
        """Return an iterator over every event of objects: selected, deselected, refused, left, dispatched."""
        if user is None:
            return self.messages(topics.SELECTION_EVENTS)
        check_name(user, "user")
        return self._feed(topics.SELECTION_EVENTS, "", lambda event: event.user == user)

    def pointed(self, *things: str) -> Feed[SelectionEvent]:
        """Return an iterator over what people did by pointing at things of the map, all without names.

        `thing` is its id. `is_on` is False when a switch goes off.

        Raises, at once, or in the loop if the map comes later:
            ConfigError: If the map has no such thing.
        """
        return self._pointed(things, self._check_things(things))

    def _pointed(self, things: Sequence[str], later_check: Coroutine[Any, Any, None]) -> Feed[SelectionEvent]:
        """Return an iterator over the events of things. `later_check` is used if the map has not come yet."""
        check: Coroutine[Any, Any, None] | None = None
        room = self.latest.map.get("")  # received from now on
        if room is None and things:
            check = later_check
        else:
            later_check.close()
        if room is not None:
            check_things(things, room)

        def is_wanted(event: SelectionEvent) -> bool:
            return is_reaction(event, things, self.latest.map.get(""))

        return self._feed(topics.SELECTION_EVENTS, "", is_wanted, check)

    def on_pointed(self, *things: str) -> Callable[[F], F]:
        """Return a decorator: call the function with each event of `pointed(*things)`.

        A plain function is called in a thread, so that it may take its time; at most 8 calls run at once. One
        that fails is logged. If the map comes later and lacks a thing, this ends all iterators, `sleep` and
        `wait`.
        """

        def register(function: F) -> F:
            events = self._pointed(things, self._check_things_later(things))
            self._start(react(events, function, self.fail))
            return function

        return register

    def carries(self, *things: str, limit_s: float = 5.0) -> Callable[[F], F]:
        """Return a decorator: the function carries out the acts on these things, each within `limit_s`.

        Its return means that the act is done, and people learn that. If it raises, or takes longer, they
        get the error as a cue, and a switch goes back. On a secured site only operators may do this. Acts are
        carried out from when the map has come. If it lacks a thing, this ends all iterators, `sleep` and
        `wait`.

        Raises:
            ValueError: If `limit_s` is not above 0 s, or above 3600 s.
        """
        if not 0.0 < limit_s <= MAX_ACT_S:
            given = f"limit_s is {limit_s:g} s"
            raise ValueError(f"{given}; give more than 0 s, and at most {MAX_ACT_S:g} s")

        def register(function: F) -> F:
            function_name = getattr(function, "__name__", "")
            letters = re.sub(r"[^A-Za-z0-9]", "", function_name)[:40]
            number = zlib.crc32(" ".join(things).encode())
            name = f"{letters or 'function'}-{number:08x}"  # the same after a restart
            target = FunctionTarget(function, limit_s)
            targets = dict.fromkeys(things, (target,))
            check = self._check_things_later(things)
            self._start(carry(self._bus, self._clock, name, targets, check))
            return function

        return register

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        """Run `work` until the site is closed. An error in it ends all iterators."""
        task = asyncio.get_running_loop().create_task(self._guarded(work))
        self._reactions.add(task)
        task.add_done_callback(self._reactions.discard)

    async def _guarded(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except PointItError as error:
            self.fail(error)

    async def _check_things(self, things: Collection[str]) -> None:
        check_things(things, await self.latest.map.wait())

    async def _check_things_later(self, things: Collection[str]) -> None:
        """Check things when the map comes, however late: a program with functions may start before the site.

        Raises:
            ConfigError: If the map has no such thing.
        """
        while True:
            with contextlib.suppress(NoMessageError):
                await self._check_things(things)
                return

    def people(self) -> Feed[frozenset[str]]:
        """Return an iterator over the people who are present: now, and after each change."""
        return self._presence(topics.USER_ALIVE)

    def services(self) -> Feed[frozenset[str]]:
        """Return an iterator over the service instances that are present: now, and after each change."""
        return self._presence(topics.SERVICE_ALIVE)

    def messages(self, topic: Topic[M], name: str | None = None) -> Feed[M]:
        """Return an iterator over the messages of any row of the topic table, or of a plug-in's own."""
        if name is None:
            name = ANY if topic.placeholder else ""
        else:
            topic.at(name)
        return self._feed(topic, name, None)

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply to any row of the request table, or of a plug-in's own.

        Raises:
            RefusedError: If the service refuses. Gives the reason.
            NoAnswerError: If no service answers within `timeout_s`.
            AccessDeniedError: If this identity may not ask.
        """
        self._check_open()
        return await self._bus.call(request, query, name, timeout_s=timeout_s)

    async def hear(self, user: str, words: Sequence[Word], *, is_final: bool = True) -> None:
        """Publish words of `user` from a speech recogniser. `is_final` is False while they may change.

        Raises:
            AccessDeniedError: If this identity may not speak for them.
        """
        self._check_open()
        if denied := await self._bus.denial_reason("writes", topics.SPEECH, user):
            raise AccessDeniedError(denied)
        stamp_ns = words[-1].end_ns if words else self._clock.now_ns()
        speech = Speech(stamp_ns=stamp_ns, words=tuple(words), is_final=is_final, recogniser="api")
        self._speech(user).put(speech)

    async def referents(self, user: str, at_ns: int | None = None, within_s: float = 1.0) -> Referents:
        """Return the candidates for a word of `user` at `at_ns`; see `listener.referents`.

        Raises:
            NoAnswerError: If no service `listener` runs for `user` (`pointit run ... --with listener`).
            AccessDeniedError: If this identity is neither `user` nor an operator.
            RefusedError: If that time is gone, or not yet there.
        """
        return await self.listener.referents(user, at_ns, within_s)

    def tracker(
        self, name: str, *, frame: str = "", latency_s: float = 0.0, latency_sigma_s: float | None = None
    ) -> Tracker:
        """Return the tracker `name`, which publishes objects.

        Args:
            name: of the tracker, unique on the site.
            frame: of the map, in which its positions are. `""`: {W}.
            latency_s: usual time from capture to `Tracker.update`, subtracted from a stamp that is not given.
            latency_sigma_s: 1 sigma of the stamps' error, by which following its objects is judged. None:
                unknown.
        """
        self._check_open()

        def room() -> Environment:
            return self.latest.map.value

        tracker = Tracker(
            self._bus,
            name,
            self._clock.now_ns,
            self._trackers.discard,
            room=room,
            frame=frame,
            latency_s=latency_s,
            latency_sigma_s=latency_sigma_s,
        )
        if frame:
            self.latest.map.get("")  # received from now on
        self._trackers.add(tracker)
        return tracker

    def lamp(self, name: str) -> Lamp[Awaitable[Done], Feed[LampColor]]:
        """Return the lamp `name` of the map."""
        check_name(name, "lamp")
        return Lamp(name, self.leds, functools.partial(self.messages, topics.LAMP_COLOR))

    async def press(self, user: str, gesture: Literal["press", "double", "hold"] = "press") -> Interaction:
        """Press the button of `user`; return the state of the interaction after it.

        Raises:
            NoAnswerError: If `user` is not there, or their supervisor does not reply.
            AccessDeniedError: If this identity may not press it.
        """
        self._check_open()
        if denied := await self._bus.denial_reason("writes", topics.BUTTON, user):
            raise AccessDeniedError(denied)
        return await press(self._bus, self._clock, user, gesture)

    def fail(self, error: Exception) -> None:
        """End all iterators with `error`."""
        # The error comes first: the waiters read it when they wake
        self._failure = error
        self._ended.set()
        for buffer in list(self._buffers):
            buffer.close(error)

    def _close(self) -> None:
        # Trackers end while the site is open, since they publish that all objects have left
        for tracker in list(self._trackers):
            if not self._bus.is_closed:
                tracker.close()
        self._is_closed = True
        self._ended.set()
        for watch in self._watches:
            watch.close()
        for buffer in list(self._buffers):
            buffer.close()

    def _presence(self, presence: Presence) -> Feed[frozenset[str]]:
        self._check_open()
        buffer = ReceiveBuffer[frozenset[str]](Delivery.STATE)
        self._followers[presence].add(buffer)
        self._buffers.add(buffer)
        buffer.put(self._names(presence), "")
        return Feed(buffer, itemgetter(1), self._speed)

    def _names(self, presence: Presence) -> frozenset[str]:
        return self._state.people if presence is topics.USER_ALIVE else self._state.services

    def _publish_names(self, presence: Presence) -> None:
        for buffer in self._followers[presence]:
            buffer.put(self._names(presence), "")

    def _feed(
        self,
        topic: Topic[M],
        name: str,
        fits: Callable[[M], bool] | None,
        check: Coroutine[Any, Any, None] | None = None,
    ) -> Feed[M]:
        """Return the messages that fit. If `check` fails, they end with its error."""
        self._check_open()
        buffer = ReceiveBuffer[M](topic.delivery, one_writer=name != ANY)
        # The subscription must not keep the buffer of a reader that has stopped iterating
        reference = weakref.ref(buffer)

        def on_message(message: M, its_name: str) -> None:
            receiver = reference()
            if receiver is None:
                subscription.close()
            elif fits is None or fits(message):
                receiver.put(message, its_name)

        subscription: Subscription = self._bus.subscribe(topic, on_message, name or ANY)
        buffer.source = subscription
        self._buffers.add(buffer)
        if check is not None:
            checking = self._end_unless(check, buffer)
            self._bus.spawn(checking, f"check of {topic.key}")
        if self._bus.is_restricted:
            access = self._check_access(buffer, topic, name)
            self._bus.spawn(access, f"access to {topic.key}")
        return Feed(buffer, itemgetter(1), self._speed)

    @staticmethod
    async def _end_unless(check: Coroutine[Any, Any, None], buffer: ReceiveBuffer[Any]) -> None:
        try:
            await check
        except PointItError as error:
            buffer.close(error)

    async def _check_access(self, buffer: ReceiveBuffer[Any], topic: Topic[Any], name: str) -> None:
        if denied := await self._bus.denial_reason("reads", topic, name):
            buffer.close(AccessDeniedError(denied))

    def _speed(self) -> float:
        return self._clock.speed

    def _check_open(self) -> None:
        if self._failure is not None:
            raise self._failure
        if self._is_closed or self._bus.is_closed:
            raise closed_error()
