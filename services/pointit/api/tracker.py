"""Objects from anywhere: a camera, a robot, a script."""

import asyncio
from collections.abc import Callable, Iterable

from pydantic import ValidationError

from pointit.maps.frames import aligned, frame_of
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import AccessDeniedError
from pointit.schemas import (
    NS_PER_S,
    Environment,
    SchemaError,
    TrackedObject,
    TrackedObjects,
    summarize_validation_error,
)
from pointit.schemas.topics import OBJECTS


class Tracker:
    """Publishes the objects of one tracker, which lists its own under its own name."""

    def __init__(
        self,
        bus: MemoryBus,
        name: str,
        now_ns: Callable[[], int],
        on_close: Callable[["Tracker"], None],
        *,
        room: Callable[[], Environment],
        frame: str = "",
        latency_s: float = 0.0,
        latency_sigma_s: float | None = None,
    ) -> None:
        self._bus = bus
        self._room = room
        self._frame = frame
        self._latency_ns = round(latency_s * NS_PER_S)
        self._latency_sigma_s = latency_sigma_s
        self._name = name
        self._publisher = bus.publisher(OBJECTS, name)
        self._key = OBJECTS.at(name)
        self._on_close = on_close
        self._now_ns = now_ns
        self._seq = 0
        self._is_open = True
        self._denial: AccessDeniedError | None = None
        self.checked: asyncio.Task[None] | None = None
        """Done when it is known whether this identity may write them. None if everybody may."""
        if bus.is_restricted:
            self.checked = bus.spawn(self._check_access(), f"access to {self._key}")

    def update(self, objects: Iterable[TrackedObject], *, stamp_ns: int | None = None) -> None:
        """Publish all objects of this tracker, at least once a second; who is no longer listed has left.

        Args:
            objects: with centres at `stamp_ns`, m, in {W} or in the tracker's frame.
            stamp_ns: time of capture, Unix ns. None: now, by the site's clock, less the tracker's latency.

        Raises:
            SchemaError: If an object is wrong.
            ConfigError: If the map has not the tracker's frame.
            NoMessageError: If the tracker has a frame, and the map has not come yet.
            BusClosedError: If the tracker or the site is closed.
            AccessDeniedError: If this identity may not write them, which is known after two seconds. Without
                asyncio the first update waits for that.
        """
        if self._denial is not None:
            raise self._denial
        stamp_ns = self._now_ns() - self._latency_ns if stamp_ns is None else stamp_ns
        listed = tuple(objects)
        try:
            if self._frame and listed:
                listed = aligned(listed, frame_of(self._room(), self._frame))
            message = TrackedObjects(
                stamp_ns=stamp_ns, seq=self._seq + 1, objects=listed, latency_sigma_s=self._latency_sigma_s
            )
        except ValidationError as error:
            raise SchemaError(f"{self._key}: {summarize_validation_error(error)}") from error
        self._seq += 1
        self._publisher.put(message)

    def close(self) -> None:
        """Publish that all objects have left, and end."""
        if self._is_open:
            self._is_open = False
            if self._denial is None:
                self.update(())
            self._publisher.close()
            self._on_close(self)

    async def _check_access(self) -> None:
        if denied := await self._bus.denial_reason("writes", OBJECTS, self._name):
            self._denial = AccessDeniedError(denied)
