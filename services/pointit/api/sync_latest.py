"""The newest message of each topic, for scripts and notebooks."""

from collections.abc import Iterator, Mapping
from typing import Any, Generic, TypeVar, overload

from pointit.api.latest import PATIENCE_S, Latest, Newest, NewestOne
from pointit.api.portal import LoopThread
from pointit.schemas import (
    ConveyorState,
    Cursor,
    Environment,
    Health,
    Hover,
    Interaction,
    LampColor,
    Message,
    PointingRay,
    Selection,
    TrackedObjects,
    UserPose,
)

M = TypeVar("M", bound=Message)
T = TypeVar("T")


class SyncNewest(Mapping[str, M], Generic[M]):
    """The newest message of each person, tracker, service or lamp; kept up to date from the first use on.

    `[name]` waits up to 2 s for the first message. `get`, `in` and iteration do not wait.
    """

    def __init__(self, newest: Newest[M], portal: LoopThread) -> None:
        self._newest = newest
        self._portal = portal

    def __getitem__(self, name: str) -> M:
        """Return the newest message of `name`, as soon as there is one; see `wait`."""
        return self.wait(name)

    def __iter__(self) -> Iterator[str]:
        return self._portal.do(lambda: iter(self._newest))

    def __len__(self) -> int:
        return self._portal.do(lambda: len(self._newest))

    def __contains__(self, name: object) -> bool:
        return self._portal.do(lambda: name in self._newest)

    @overload
    def get(self, key: str, default: None = None, /) -> M | None: ...
    @overload
    def get(self, key: str, default: M | T, /) -> M | T: ...
    def get(self, key: str, default: Any = None, /) -> Any:
        """Return the newest message of `key`, or `default` if nothing has come yet."""
        return self._portal.do(lambda: self._newest.get(key, default))

    def wait(self, name: str, *, patience_s: float = PATIENCE_S) -> M:
        """Return the newest message of `name`, as soon as there is one. Raises what `Newest.wait` raises."""
        return self._portal.call(self._newest.wait(name, patience_s=patience_s))


class SyncNewestOne(Generic[M]):
    """The newest message of a topic that has one writer; kept up to date from the first use on."""

    def __init__(self, newest: NewestOne[M], portal: LoopThread) -> None:
        self._newest = newest
        self._portal = portal

    @property
    def value(self) -> M:
        """The newest message; the first one is waited for, up to 2 s. Raises what `wait` raises."""
        return self.wait()

    def wait(self, *, patience_s: float = PATIENCE_S) -> M:
        """Return the newest message, as soon as there is one. Raises what `Newest.wait` raises."""
        return self._portal.call(self._newest.wait(patience_s=patience_s))


class SyncLatest:
    """The newest messages of a site. Each topic is received from its first use on."""

    def __init__(self, latest: Latest, portal: LoopThread) -> None:
        self._latest = latest
        self._portal = portal

    @property
    def cursor(self) -> SyncNewest[Cursor]:
        """Cursors by person."""
        return SyncNewest(self._portal.do(lambda: self._latest.cursor), self._portal)

    @property
    def ray(self) -> SyncNewest[PointingRay]:
        """Pointing rays by person."""
        return SyncNewest(self._portal.do(lambda: self._latest.ray), self._portal)

    @property
    def hover(self) -> SyncNewest[Hover]:
        """Objects under cursors by person."""
        return SyncNewest(self._portal.do(lambda: self._latest.hover), self._portal)

    @property
    def pose(self) -> SyncNewest[UserPose]:
        """Poses by person."""
        return SyncNewest(self._portal.do(lambda: self._latest.pose), self._portal)

    @property
    def interaction(self) -> SyncNewest[Interaction]:
        """States of the interaction by person."""
        return SyncNewest(self._portal.do(lambda: self._latest.interaction), self._portal)

    @property
    def objects(self) -> SyncNewest[TrackedObjects]:
        """Objects by tracker."""
        return SyncNewest(self._portal.do(lambda: self._latest.objects), self._portal)

    @property
    def health(self) -> SyncNewest[Health]:
        """Reports by service instance."""
        return SyncNewest(self._portal.do(lambda: self._latest.health), self._portal)

    @property
    def lamp(self) -> SyncNewest[LampColor]:
        """Colours by lamp."""
        return SyncNewest(self._portal.do(lambda: self._latest.lamp), self._portal)

    @property
    def selection(self) -> SyncNewestOne[Selection]:
        """All selected objects."""
        return SyncNewestOne(self._portal.do(lambda: self._latest.selection), self._portal)

    @property
    def map(self) -> SyncNewestOne[Environment]:
        """The room."""
        return SyncNewestOne(self._portal.do(lambda: self._latest.map), self._portal)

    @property
    def conveyor(self) -> SyncNewestOne[ConveyorState]:
        """The state of the conveyor."""
        return SyncNewestOne(self._portal.do(lambda: self._latest.conveyor), self._portal)
