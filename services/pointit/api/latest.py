"""The newest message of each topic, by name."""

import asyncio
import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Generic, TypeVar

from pointit.api.feed import unreadable
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import AccessDeniedError, NoMessageError, VersionError
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

PATIENCE_S = 2.0
"""Time to wait for the first message, s."""


class Newest(Mapping[str, M], Generic[M]):
    """The newest message of each person, tracker, service or lamp; kept up to date from the first use on.

    Nothing but `wait` waits, so `[name]` and `get` find nothing yet at the first use.
    """

    def __init__(self, bus: MemoryBus, topic: Topic[M], check_open: Callable[[], None]) -> None:
        self._bus = bus
        self._topic = topic
        self._check_open = check_open
        self._values: dict[str, M] = {}
        self._changed = asyncio.Event()
        self._subscription = bus.subscribe(topic, self._on_message)

    def __getitem__(self, name: str) -> M:
        """Return the newest message of `name`.

        Raises:
            NoMessageError: If nothing has come yet.
            BusClosedError: If the site is closed.
        """
        self._check_open()
        if name in self._values:
            return self._values[name]
        raise NoMessageError(f"nothing has come on {self._topic.at(name)} yet; `wait` for it")

    def __iter__(self) -> Iterator[str]:
        self._check_open()
        return iter(list(self._values))

    def __len__(self) -> int:
        self._check_open()
        return len(self._values)

    async def wait(self, name: str, *, patience_s: float = PATIENCE_S) -> M:
        """Return the newest message of `name`, as soon as there is one.

        Raises:
            NoMessageError: If none has come within `patience_s`.
            AccessDeniedError: If none has come since this identity may not read it.
            VersionError: If none of what came can be read.
            BusClosedError: If the site is closed.
        """
        self._check_open()
        key = self._topic.at(name)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while name not in self._values:
                    self._changed.clear()
                    await self._changed.wait()
        self._check_open()
        if name in self._values:
            return self._values[name]
        if denied := await self._bus.denial_reason("reads", self._topic, ANY):
            raise AccessDeniedError(denied)
        if self._subscription.traffic.invalid and not self._values:
            raise VersionError(unreadable(self._subscription.traffic))
        raise NoMessageError(f"nothing came on {key} within {patience_s:g} s; see `pointit doctor`")

    def _on_message(self, message: M, name: str) -> None:
        self._values[name] = message
        self._changed.set()


class NewestOne(Generic[M]):
    """The newest message of a topic that has one writer; kept up to date from the first use on."""

    def __init__(self, newest: Newest[M]) -> None:
        self._newest = newest

    @property
    def value(self) -> M:
        """The newest message.

        Raises:
            NoMessageError: If nothing has come yet, as always at the first use.
            BusClosedError: If the site is closed.
        """
        return self._newest[""]

    async def wait(self, *, patience_s: float = PATIENCE_S) -> M:
        """Return the newest message, as soon as there is one. Raises what `Newest.wait` raises."""
        return await self._newest.wait("", patience_s=patience_s)


class Latest:
    """The newest messages of a site. Each topic is received from its first use on."""

    def __init__(self, bus: MemoryBus, check_open: Callable[[], None]) -> None:
        self._bus = bus
        self._check_open = check_open
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
    def selection(self) -> NewestOne[Selection]:
        """All selected objects."""
        return NewestOne(self._of(SELECTION))

    @property
    def map(self) -> NewestOne[Environment]:
        """The room."""
        return NewestOne(self._of(MAP))

    @property
    def conveyor(self) -> NewestOne[ConveyorState]:
        """The state of the conveyor."""
        return NewestOne(self._of(CONVEYOR_STATE))

    def _of(self, topic: Topic[M]) -> Newest[M]:
        found = self._followed.get(topic.key)
        if found is None:
            self._check_open()
            found = self._followed[topic.key] = Newest(self._bus, topic, self._check_open)
        return found
