"""A site as scripts and notebooks see it: plain iterators, and calls that wait."""

import asyncio
import atexit
import contextlib
import functools
import inspect
import types
import typing
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager
from types import TracebackType
from typing import Any, Concatenate, Generic, ParamSpec, Self, TypeVar, overload

from pointit.api import requests
from pointit.api.feed import MESSAGE_TIMEOUT_S, F, Feed, Latest, Newest
from pointit.api.inputs import Tracker
from pointit.api.loop_thread import LoopThread
from pointit.api.requests import Lamp
from pointit.api.site import Site
from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S
from pointit.runtime.service.carrier import check_things
from pointit.schemas import (
    AddPackageReply,
    Done,
    HomeSetup,
    LampColor,
    Message,
    Query,
    ReadHistoryReply,
    Referents,
    Reply,
    SetMethodReply,
    SetMountingReply,
    SetToleranceReply,
    TrackedObject,
    UseMapReply,
)
from pointit.schemas.topics import LAMP_COLOR, Request, Topic, check_name

P = ParamSpec("P")

T = TypeVar("T")

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)


class SyncFeed(Iterator[T], Generic[T]):
    """The messages of a topic from the call that made it on, one per step of `for`. See `Feed`."""

    def __init__(self, feed: Feed[T], thread: LoopThread) -> None:
        self._feed = feed
        self._thread = thread

    @property
    def lost(self) -> int:
        """The number of events that were lost on the way, or because the loop was too slow."""
        return self._feed.lost

    def items(self) -> "SyncFeed[tuple[str, T]]":
        """Return the same with the name of each item; see `Feed.items`."""
        return SyncFeed(self._feed.items(), self._thread)

    def during(self, seconds: float) -> "SyncFeed[T]":
        """Return this feed with an end after `seconds` of the site's time. See `Feed.during`."""
        return SyncFeed(self._feed.during(seconds), self._thread)

    def close(self) -> None:
        """Receive nothing more."""
        self._thread.call(self._feed.close)

    def __next__(self) -> T:
        # A tuple, since StopAsyncIteration cannot be the result of a task
        async def step() -> tuple[T, ...]:
            async for item in self._feed:
                return (item,)
            return ()

        for item in self._thread.run(step()):
            return item
        raise StopIteration


class SyncTracker:
    """Publishes the objects of one tracker; see `Tracker`."""

    def __init__(self, tracker: Tracker, thread: LoopThread) -> None:
        self._tracker = tracker
        self._thread = thread

    def update(self, objects: Iterable[TrackedObject], *, stamp_ns: int | None = None) -> None:
        """Publish all objects of this tracker, at least once a second; see `Tracker.update`."""
        # Listed in this thread: a generator may use the site, which waits for the loop
        listed = tuple(objects)
        self._thread.call(lambda: self._tracker.update(listed, stamp_ns=stamp_ns))
        checked = self._tracker.checked
        if checked is not None and not checked.done():  # afterwards: these objects are seen now
            self._thread.run(asyncio.wait([checked]))

    def close(self) -> None:
        """Publish that all objects have left, and end."""
        self._thread.call(self._tracker.close)


def _waiting(
    method: Callable[Concatenate[Site, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate["SyncSite", P], T]:
    """Return `method` as one that waits for its result."""

    @functools.wraps(method)
    def waiting(self: "SyncSite", /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._thread.run(method(self._site, *args, **kwargs))

    return waiting


def _iterating(
    method: Callable[Concatenate[Site, P], Feed[T]],
) -> Callable[Concatenate["SyncSite", P], SyncFeed[T]]:
    """Return `method` as one that returns a plain iterator."""

    @functools.wraps(method)
    def iterating(self: "SyncSite", /, *args: P.args, **kwargs: P.kwargs) -> SyncFeed[T]:
        feed = self._thread.call(lambda: method(self._site, *args, **kwargs))
        return SyncFeed(feed, self._thread)

    shown = inspect.signature(method)
    returned = types.GenericAlias(SyncFeed, typing.get_args(shown.return_annotation))
    vars(iterating)["__signature__"] = shown.replace(return_annotation=returned)
    return iterating


class SyncSite:
    """A joined site, in its own thread. Close it, or use it in a `with` block.

    It has the methods of `Site`, with the same parameters: asynchronous iterators are plain ones here, and
    calls that are awaited there return the result.

    In virtual time, which `pointit.run(..., virtual=True)` starts, time passes only while a call waits.
    """

    def __init__(self, site_connection: AbstractAsyncContextManager[Site], thread: LoopThread) -> None:
        """Join in the loop of `thread`, which is closed with the site."""
        self._joining = site_connection
        self._thread = thread
        self._is_closed = False
        try:
            self._site = thread.run(site_connection.__aenter__())
        except BaseException:
            thread.close()
            raise
        # for programs that end without `close`
        atexit.register(self.close)
        self.latest = SyncLatest(self._site.latest, thread)
        """The newest messages by topic and name. The first one of a name is waited for, up to 2 s."""
        send = self.call
        self.select = requests.SelectRequests[Done, SetMethodReply, ReadHistoryReply](send)
        self.conveyor = requests.ConveyorRequests[Done, AddPackageReply](send)
        self.localizer = requests.LocalizerRequests[Done](send)
        self.profile = requests.ProfileRequests[Done](send)
        self.pui = requests.PuiRequests[Done, SetToleranceReply, UseMapReply](send)
        self.robots = requests.RobotsRequests[Done](send)
        self.goal = requests.GoalRequests[Done](send)
        self.listener = requests.ListenerRequests[Done, Referents](send)
        self.run = requests.RunRequests[Done](send)
        self.leds = requests.LedsRequests[Done](send)
        self.imu = requests.ImuRequests[Done, SetMountingReply](send)
        self.feedback = requests.FeedbackRequests[Done](send)
        self.home = requests.HomeRequests[Done, HomeSetup](send)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the site and end its thread. Iterators in other threads end."""
        if self._is_closed:
            return
        self._is_closed = True
        atexit.unregister(self.close)
        try:
            self._thread.run(self._joining.__aexit__(None, None, None))
        finally:
            self._thread.close()

    @property
    def name(self) -> str:
        """The name of the site."""
        return self._site.name

    @property
    def problem(self) -> str:
        """A message if the connection has a problem, such as a lost router, else `""`."""
        return self._thread.call(lambda: self._site.problem)

    def now_ns(self) -> int:
        """Return the site's time, Unix ns: wall time, simulated or virtual."""
        return self._thread.call(self._site.now_ns)

    cursors = _iterating(Site.cursors)
    rays = _iterating(Site.rays)
    hovers = _iterating(Site.hovers)
    poses = _iterating(Site.poses)
    objects = _iterating(Site.objects)
    health = _iterating(Site.health)
    selections = _iterating(Site.selections)
    pointed = _iterating(Site.pointed)
    people = _iterating(Site.people)
    services = _iterating(Site.services)
    sleep = _waiting(Site.sleep)
    press = _waiting(Site.press)
    hear = _waiting(Site.hear)
    referents = _waiting(Site.referents)

    def messages(self, topic: Topic[M], name: str | None = None) -> SyncFeed[M]:
        """Return an iterator over the messages of a row of the topic table; see `Site.messages`."""
        return _iterating(Site.messages)(self, topic, name)

    def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply to a row of the request table; see `Site.call`."""
        return _waiting(Site.call)(self, request, query, name, timeout_s=timeout_s)

    def wait(self) -> None:
        """Wait until Ctrl-C, while functions of `on_pointed` are called; then return. See `Site.wait`."""
        with contextlib.suppress(KeyboardInterrupt):
            self._thread.run(self._site.wait())

    def on_pointed(self, *things: str) -> Callable[[F], F]:
        """Return a decorator: call the function with each event of `pointed(*things)`; see `Site.on_pointed`.

        Raises:
            ConfigError: If the map has no such thing.
            NoMessageError: If the map does not come within 2 s.
        """
        self.latest.map.wait()

        def register(function: F) -> F:
            return self._thread.call(lambda: self._site.on_pointed(*things)(function))

        return register

    def carries(self, *things: str, limit_s: float = 5.0) -> Callable[[F], F]:
        """Return a decorator: the function carries out the acts on these things; see `Site.carries`.

        Raises:
            ConfigError: If the map has no such thing.
            NoMessageError: If the map does not come within 2 s.
        """
        check_things(things, self.latest.map.wait())

        def register(function: F) -> F:
            return self._thread.call(lambda: self._site.carries(*things, limit_s=limit_s)(function))

        return register

    def tracker(
        self, name: str, *, frame: str = "", latency_s: float = 0.0, latency_sigma_s: float | None = None
    ) -> SyncTracker:
        """Return the tracker `name`, which publishes objects; see `Site.tracker`. Waits for a frame's map."""

        def make() -> Tracker:
            return self._site.tracker(name, frame=frame, latency_s=latency_s, latency_sigma_s=latency_sigma_s)

        tracker = self._thread.call(make)
        if frame:
            self._thread.run(self._site.latest.map.wait())
        return SyncTracker(tracker, self._thread)

    def lamp(self, name: str) -> Lamp[Done, SyncFeed[LampColor]]:
        """Return the lamp `name` of the map."""
        check_name(name, "lamp")
        return Lamp(name, self.leds, lambda lamp: self.messages(LAMP_COLOR, lamp))


class SyncNewest(Mapping[str, M], Generic[M]):
    """The newest message of each person, tracker, service or lamp; kept up to date from the first use on.

    `[name]` and `value` wait up to 2 s for the first message. `get`, `in` and iteration do not wait.
    """

    def __init__(self, newest: Newest[M], thread: LoopThread) -> None:
        self._newest = newest
        self._thread = thread

    def __getitem__(self, name: str) -> M:
        """Return the newest message of `name`, as soon as there is one; see `wait`."""
        return self.wait(name)

    def __iter__(self) -> Iterator[str]:
        return self._thread.call(lambda: iter(self._newest))

    def __len__(self) -> int:
        return self._thread.call(lambda: len(self._newest))

    def __contains__(self, name: object) -> bool:
        return self._thread.call(lambda: name in self._newest)

    @overload
    def get(self, key: str, default: None = None, /) -> M | None: ...
    @overload
    def get(self, key: str, default: M | T, /) -> M | T: ...
    def get(self, key: str, default: Any = None, /) -> Any:
        """Return the newest message of `key`, or `default` without one."""
        return self._thread.call(lambda: self._newest.get(key, default))

    @property
    def value(self) -> M:
        """The newest message of a topic with one writer, as soon as there is one; see `wait`."""
        return self.wait()

    def wait(self, name: str = "", *, timeout_s: float = MESSAGE_TIMEOUT_S) -> M:
        """Return the newest message of `name`, as soon as there is one. Raises what `Newest.wait` raises."""
        return self._thread.run(self._newest.wait(name, timeout_s=timeout_s))


class SyncLatest:
    """The newest messages of a site; see `Latest`."""

    def __init__(self, latest: Latest, thread: LoopThread) -> None:
        self.cursor = SyncNewest(latest.cursor, thread)
        self.ray = SyncNewest(latest.ray, thread)
        self.hover = SyncNewest(latest.hover, thread)
        self.pose = SyncNewest(latest.pose, thread)
        self.interaction = SyncNewest(latest.interaction, thread)
        self.objects = SyncNewest(latest.objects, thread)
        self.robot = SyncNewest(latest.robot, thread)
        self.health = SyncNewest(latest.health, thread)
        self.lamp = SyncNewest(latest.lamp, thread)
        self.selection = SyncNewest(latest.selection, thread)
        self.map = SyncNewest(latest.map, thread)
        self.conveyor = SyncNewest(latest.conveyor, thread)
