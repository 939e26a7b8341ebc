"""The newest message of each topic, by name."""

import asyncio
import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Generic, TypeVar

from pointit.api.feed import unreadable
from pointit.runtime.bus.contract import Subscription
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.config.old_names import accept_old_names
from pointit.runtime.errors import AccessDeniedError, NoMessageError, VersionError
from pointit.schemas import Message, topics
from pointit.schemas.topics import ANY, Topic

M = TypeVar("M", bound=Message)

TIMEOUT_S = 2.0
"""Time to wait for the first message, s."""


class Newest(Mapping[str, M], Generic[M]):
    """The newest message of each person, tracker, service or lamp; kept up to date from the first use on.

    Nothing but `wait` waits, so `[name]`, `get` and `value` find nothing yet at the first use. On a secured
    site each name is received from its own first use on, since an identity may read only some.
    """

    def __init__(self, bus: MemoryBus, topic: Topic[M], check_open: Callable[[], None]) -> None:
        self._bus = bus
        self._topic = topic
        self._check_open = check_open
        self._values: dict[str, M] = {}
        self._changed = asyncio.Event()
        self._subscriptions: dict[str, Subscription] = {}

    def __getitem__(self, name: str) -> M:
        """Return the newest message of `name`.

        Raises:
            NoMessageError: If nothing has come yet.
            BusClosedError: If the site is closed.
        """
        self._receive(name)
        if name in self._values:
            return self._values[name]
        raise NoMessageError(f"nothing has come on {self._topic.at(name)} yet; `wait` for it")

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

    @accept_old_names(patience_s="timeout_s")
    async def wait(self, name: str = "", *, timeout_s: float = TIMEOUT_S) -> M:
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
        if denied := await self._bus.denial_reason("reads", self._topic, name):
            raise AccessDeniedError(denied)
        if subscription.traffic.invalid and not self._values:
            raise VersionError(unreadable(subscription.traffic))
        key = self._topic.at(name)
        raise NoMessageError(f"nothing came on {key} within {timeout_s:g} s; see `pointit doctor`")

    def _receive(self, name: str) -> Subscription:
        self._check_open()
        self._topic.at(name)
        which = (self._bus.is_restricted and name) or ANY
        if which not in self._subscriptions:
            self._subscriptions[which] = self._bus.subscribe(self._topic, self._on_message, which)
        return self._subscriptions[which]

    def _on_message(self, message: M, name: str) -> None:
        self._values[name] = message
        self._changed.set()


class Latest:
    """The newest messages of a site. Each topic is received from its first use on."""

    def __init__(self, bus: MemoryBus, check_open: Callable[[], None]) -> None:
        self.cursor = Newest(bus, topics.CURSOR, check_open)
        """Cursors by person."""
        self.ray = Newest(bus, topics.RAY, check_open)
        """Pointing rays by person."""
        self.hover = Newest(bus, topics.HOVER, check_open)
        """Objects under cursors by person."""
        self.pose = Newest(bus, topics.POSE, check_open)
        """Poses by person."""
        self.interaction = Newest(bus, topics.INTERACTION, check_open)
        """States of the interaction by person."""
        self.objects = Newest(bus, topics.OBJECTS, check_open)
        """Objects by tracker."""
        self.robot = Newest(bus, topics.ROBOT_STATE, check_open)
        """States by robot."""
        self.health = Newest(bus, topics.HEALTH, check_open)
        """Reports by service instance."""
        self.lamp = Newest(bus, topics.LAMP_COLOR, check_open)
        """Colours by lamp."""
        self.selection = Newest(bus, topics.SELECTION, check_open)
        """All selected objects."""
        self.map = Newest(bus, topics.MAP, check_open)
        """The room."""
        self.conveyor = Newest(bus, topics.CONVEYOR_STATE, check_open)
        """The state of the conveyor."""
