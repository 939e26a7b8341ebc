"""The newest message of each topic, for scripts and notebooks."""

from collections.abc import Iterator, Mapping
from typing import Any, Generic, TypeVar, overload

from pointit.api.latest import PATIENCE_S, Latest, Newest
from pointit.api.loop_thread import LoopThread
from pointit.schemas import Message

M = TypeVar("M", bound=Message)
T = TypeVar("T")


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
        """Return the newest message of `key`, or `default` if nothing has come yet."""
        return self._thread.call(lambda: self._newest.get(key, default))

    @property
    def value(self) -> M:
        """The newest message of a topic with one writer, as soon as there is one; see `wait`."""
        return self.wait()

    def wait(self, name: str = "", *, patience_s: float = PATIENCE_S) -> M:
        """Return the newest message of `name`, as soon as there is one. Raises what `Newest.wait` raises."""
        return self._thread.run(self._newest.wait(name, patience_s=patience_s))


class SyncLatest:
    """The newest messages of a site; see `Latest`."""

    def __init__(self, latest: Latest, thread: LoopThread) -> None:
        self.cursor = SyncNewest(latest.cursor, thread)
        self.ray = SyncNewest(latest.ray, thread)
        self.hover = SyncNewest(latest.hover, thread)
        self.pose = SyncNewest(latest.pose, thread)
        self.interaction = SyncNewest(latest.interaction, thread)
        self.objects = SyncNewest(latest.objects, thread)
        self.health = SyncNewest(latest.health, thread)
        self.lamp = SyncNewest(latest.lamp, thread)
        self.selection = SyncNewest(latest.selection, thread)
        self.map = SyncNewest(latest.map, thread)
        self.conveyor = SyncNewest(latest.conveyor, thread)
