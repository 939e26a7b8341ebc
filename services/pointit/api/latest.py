"""The newest message of each topic, by name."""

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Iterator, Mapping
from typing import Any, Generic, Protocol, TypeVar

from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import NoMessageError
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
from pointit.schemas.topics import (
    ANY,
    CONVEYOR_STATE,
    CURSOR,
    HEALTH,
    HOVER,
    INTERACTION,
    LAMP_COLOR,
    MAP,
    OBJECTS,
    POSE,
    RAY,
    SELECTION,
    Topic,
)

M = TypeVar("M", bound=Message)
T = TypeVar("T")

PATIENCE_S = 2.0
"""Time to wait for the first message, s."""


class Portal(Protocol):
    """Does work in the loop of the site, for callers in other threads."""

    def call(self, work: Coroutine[Any, Any, T]) -> T:
        """Return the result of `work`."""
        ...

    def do(self, work: Callable[[], T]) -> T:
        """Return the result of `work`."""
        ...


class Newest(Mapping[str, M], Generic[M]):
    """The newest message of each person, tracker, service or lamp; kept up to date from the first use on.

    In a `SyncSite`, `[name]` waits up to 2 s for the first message.
    """

    def __init__(self, bus: Bus, topic: Topic[M], portal: Portal | None) -> None:
        self._topic = topic
        self._portal = portal
        self._values: dict[str, M] = {}
        self._changed = asyncio.Event()
        bus.subscribe(topic, self._on_message, ANY if topic.placeholder else "")

    def __getitem__(self, name: str) -> M:
        """Return the newest message of `name`.

        Raises:
            NoMessageError: If nothing has come yet.
        """
        if name in self._values:
            return self._values[name]
        if self._portal is not None:
            return self._portal.call(self.wait(name))
        raise NoMessageError(f"nothing has come on {self._topic.at(name)} yet; see `pointit doctor`")

    def __iter__(self) -> Iterator[str]:
        return iter(list(self._values))

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    async def wait(self, name: str = "", patience_s: float = PATIENCE_S) -> M:
        """Return the newest message of `name`, as soon as there is one.

        Raises:
            NoMessageError: If none has come within `patience_s`.
        """
        key = self._topic.at(name)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while name not in self._values:
                    self._changed.clear()
                    await self._changed.wait()
        if name not in self._values:
            raise NoMessageError(f"nothing came on {key} within {patience_s:g} s; see `pointit doctor`")
        return self._values[name]

    def _on_message(self, message: M, name: str) -> None:
        self._values[name] = message
        self._changed.set()


class Latest:
    """The newest messages of a site. Each topic is received from its first use on."""

    def __init__(self, bus: Bus, portal: Portal | None = None) -> None:
        self._bus = bus
        self._portal = portal
        self._followed: dict[str, Newest[Any]] = {}

    @property
    def cursor(self) -> Newest[Cursor]:
        """Cursors by person."""
        return self._of(CURSOR)

    @property
    def ray(self) -> Newest[PointingRay]:
        """Pointing rays by person."""
        return self._of(RAY)

    @property
    def hover(self) -> Newest[Hover]:
        """Objects under cursors by person."""
        return self._of(HOVER)

    @property
    def pose(self) -> Newest[UserPose]:
        """Poses by person."""
        return self._of(POSE)

    @property
    def interaction(self) -> Newest[Interaction]:
        """States of the interaction by person."""
        return self._of(INTERACTION)

    @property
    def objects(self) -> Newest[TrackedObjects]:
        """Objects by tracker."""
        return self._of(OBJECTS)

    @property
    def health(self) -> Newest[Health]:
        """Reports by service instance."""
        return self._of(HEALTH)

    @property
    def lamp(self) -> Newest[LampColor]:
        """Colours by lamp."""
        return self._of(LAMP_COLOR)

    @property
    def selection(self) -> Selection:
        """All selected objects."""
        return self._of(SELECTION)[""]

    @property
    def map(self) -> Environment:
        """The room."""
        return self._of(MAP)[""]

    @property
    def conveyor(self) -> ConveyorState:
        """The state of the conveyor."""
        return self._of(CONVEYOR_STATE)[""]

    def _of(self, topic: Topic[M]) -> Newest[M]:
        found = self._followed.get(topic.key)
        if found is None:
            portal = self._portal

            def follow() -> Newest[M]:
                return Newest(self._bus, topic, portal)

            found = self._followed[topic.key] = follow() if portal is None else portal.do(follow)
        return found
