"""A site as scripts and notebooks see it: plain iterators, and calls that wait."""

import atexit
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractAsyncContextManager
from types import TracebackType
from typing import Generic, Literal, Self, TypeVar

from pointit.api.feed import Feed
from pointit.api.lamp import Lamp
from pointit.api.loop_thread import LoopThread
from pointit.api.requests import (
    ConveyorRequests,
    ImuRequests,
    LedsRequests,
    LocalizerRequests,
    ProfileRequests,
    PuiRequests,
    RunRequests,
    SelectRequests,
)
from pointit.api.site import Site
from pointit.api.sync_latest import SyncLatest
from pointit.api.tracker import Tracker
from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S
from pointit.schemas import (
    AddPackageReply,
    Cursor,
    Done,
    Health,
    Hover,
    Interaction,
    LampColor,
    Message,
    PointingRay,
    Query,
    ReadHistoryReply,
    Reply,
    SelectionEvent,
    SetMethodReply,
    SetMountingReply,
    SetToleranceReply,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.topics import LAMP_COLOR, Request, Topic, check_name

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
T = TypeVar("T")


class SyncFeed(Generic[T]):
    """The messages of a topic from the call that made it on, one per step of `for`. See `Feed`."""

    def __init__(self, feed: Feed[T], thread: LoopThread) -> None:
        self._feed = feed
        self._thread = thread

    @property
    def lost(self) -> int:
        """The number of events that were lost on the way, or because the loop was too slow."""
        return self._feed.lost

    def items(self) -> "SyncFeed[tuple[str, T]]":
        """Return the same with the name of each item: the person, tracker, service or lamp."""
        return SyncFeed(self._feed.items(), self._thread)

    def during(self, seconds: float) -> "SyncFeed[T]":
        """Return the same, ended after so many seconds of the site's time from the first step on.

        `during(0)` gives what has come so far.
        """
        return SyncFeed(self._feed.during(seconds), self._thread)

    def close(self) -> None:
        """Receive nothing more."""
        self._thread.do(self._feed.close)

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        async def step() -> tuple[T] | None:
            async for item in self._feed:
                return (item,)
            return None

        found = self._thread.call(step())
        if found is None:
            raise StopIteration
        return found[0]


class SyncTracker:
    """Publishes the objects of one tracker; see `Tracker`."""

    def __init__(self, tracker: Tracker, thread: LoopThread) -> None:
        self._tracker = tracker
        self._thread = thread

    def update(self, objects: Iterable[TrackedObject], *, stamp_ns: int | None = None) -> None:
        """Publish all objects of this tracker, at least once a second; who is no longer listed has left.

        Args:
            objects: with centres in {W} at `stamp_ns`, m.
            stamp_ns: time of capture, Unix ns. None: now, by the site's clock.

        Raises:
            SchemaError: If an object is wrong.
            BusClosedError: If the tracker or the site is closed.
            AccessDeniedError: If this identity may not write them, which is known after some seconds.
        """
        listed = tuple(objects)  # here: a generator may use the site
        self._thread.do(lambda: self._tracker.update(listed, stamp_ns=stamp_ns))

    def close(self) -> None:
        """Publish that all objects have left, and end."""
        self._thread.do(self._tracker.close)


class SyncSite:
    """A joined site, in its own thread. Close it, or use it in a `with` block. More is said at `Site`.

    In virtual time, which `pointit.run(..., virtual=True)` starts, time passes only while a call waits.
    """

    def __init__(self, joining: AbstractAsyncContextManager[Site], thread: LoopThread) -> None:
        """Join in the loop of `thread`, which is closed with the site."""
        self._joining = joining
        self._thread = thread
        self._is_closed = False
        try:
            self._site = thread.call(joining.__aenter__())
        except BaseException:
            thread.close()
            raise
        atexit.register(self.close)
        self.latest = SyncLatest(self._site.latest, thread)
        """The newest messages by topic and name. The first one of a name is waited for, up to 2 s."""
        ask = self.call
        self.select = SelectRequests[Done, SetMethodReply, ReadHistoryReply](ask)
        self.conveyor = ConveyorRequests[Done, AddPackageReply](ask)
        self.localizer = LocalizerRequests[Done](ask)
        self.profile = ProfileRequests[Done](ask)
        self.pui = PuiRequests[Done, SetToleranceReply](ask)
        self.run = RunRequests[Done](ask)
        self.leds = LedsRequests[Done](ask)
        self.imu = ImuRequests[Done, SetMountingReply](ask)

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
            self._thread.call(self._joining.__aexit__(None, None, None))
        finally:
            self._thread.close()

    @property
    def name(self) -> str:
        """The name of the site."""
        return self._site.name

    @property
    def problem(self) -> str:
        """A message if the connection has a problem, such as a lost router, else `""`."""
        return self._thread.do(lambda: self._site.problem)

    def now_ns(self) -> int:
        """Return the site's time, Unix ns: wall time, simulated or virtual."""
        return self._thread.do(self._site.now_ns)

    def sleep(self, seconds: float) -> None:
        """Wait until so many seconds of the site's time have passed; see `Site.sleep`."""
        self._thread.call(self._site.sleep(seconds))

    def cursors(self, user: str | None = None) -> SyncFeed[Cursor]:
        """Return an iterator over cursors: where the ray meets the room. Newest wins."""
        return self._feed(lambda: self._site.cursors(user))

    def rays(self, user: str | None = None) -> SyncFeed[PointingRay]:
        """Return an iterator over pointing rays in the person's frame {H}. Newest wins."""
        return self._feed(lambda: self._site.rays(user))

    def hovers(self, user: str | None = None) -> SyncFeed[Hover]:
        """Return an iterator over the objects under cursors, and the progress of selecting. Newest wins."""
        return self._feed(lambda: self._site.hovers(user))

    def poses(self, user: str | None = None) -> SyncFeed[UserPose]:
        """Return an iterator over poses, the last one at once. Newest wins."""
        return self._feed(lambda: self._site.poses(user))

    def objects(self, tracker: str | None = None) -> SyncFeed[TrackedObjects]:
        """Return an iterator over the objects of trackers. Newest wins."""
        return self._feed(lambda: self._site.objects(tracker))

    def health(self, service: str | None = None) -> SyncFeed[Health]:
        """Return an iterator over the reports of services, such as `pointing.anna`. Newest wins."""
        return self._feed(lambda: self._site.health(service))

    def selections(self, user: str | None = None) -> SyncFeed[SelectionEvent]:
        """Return an iterator over every event of objects: selected, deselected, refused, left, dispatched."""
        return self._feed(lambda: self._site.selections(user))

    def people(self) -> SyncFeed[frozenset[str]]:
        """Return an iterator over the people who are present: now, and after each change."""
        return self._feed(self._site.people)

    def services(self) -> SyncFeed[frozenset[str]]:
        """Return an iterator over the service instances that are present: now, and after each change."""
        return self._feed(self._site.services)

    def messages(self, topic: Topic[M], name: str | None = None) -> SyncFeed[M]:
        """Return an iterator over the messages of any row of the topic table, or of a plug-in's own."""
        return self._feed(lambda: self._site.messages(topic, name))

    def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply to any row of the request table, or of a plug-in's own; see `Site.call`."""
        return self._thread.call(self._site.call(request, query, name, timeout_s=timeout_s))

    def tracker(self, name: str) -> SyncTracker:
        """Return the tracker `name`, which publishes objects."""
        return SyncTracker(self._thread.do(lambda: self._site.tracker(name)), self._thread)

    def lamp(self, name: str) -> Lamp[Done, SyncFeed[LampColor]]:
        """Return the lamp `name` of the map."""
        check_name(name, "lamp")
        return Lamp(name, self.leds, lambda lamp: self.messages(LAMP_COLOR, lamp))

    def press(self, user: str, gesture: Literal["press", "double", "hold"] = "press") -> Interaction:
        """Press the button of `user`; return the state of the interaction after it; see `Site.press`."""
        return self._thread.call(self._site.press(user, gesture))

    def _feed(self, make: Callable[[], Feed[T]]) -> SyncFeed[T]:
        return SyncFeed(self._thread.do(make), self._thread)
