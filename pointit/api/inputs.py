"""Inputs from a program: presses of a person's button, and objects that it tracks."""

import asyncio
import contextlib
from collections.abc import Callable, Collection, Iterable

from pydantic import ValidationError

from pointit.maps.frames import aligned, frame_of
from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import Clock
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.errors import AccessDeniedError, NoAnswerError
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Environment,
    Feedback,
    Interaction,
    SchemaError,
    TrackedObject,
    TrackedObjects,
    summarize_validation_error,
)
from pointit.schemas.person import Gesture
from pointit.schemas.system import instance_of, split_instance
from pointit.schemas.topics import BUTTON, FEEDBACK, INTERACTION, OBJECTS
from pointit.site.following import follow_site
from pointit.site.site_state import Change, SiteState

CUE_FIRST_S = 0.2
"""Time an Interaction may arrive after its cue; a refusal may have only a cue."""
TIMEOUT_S = 2.0
"""Time limit of each reply of the supervisor."""


def add_or_similar(user: str, there: Collection[str]) -> str:
    """Return a clause that says how to add `user`, and asks for a similar name among those that are there."""
    add = f"add them with `pointit person add {user}`"
    similar = did_you_mean(user, there)
    if not similar:
        return add
    return f"{similar[:-1]}, or {add}?"


async def press(
    bus: Bus, clock: Clock, user: str, gesture: Gesture, patience_s: float = TIMEOUT_S
) -> Interaction:
    """Return the interaction after the gesture, changed or not.

    Raises:
        NoAnswerError: If `user` has no supervisor, or it does not reply within `patience_s`.
    """
    with contextlib.ExitStack() as declared:
        # Declared before the press: the answer may come at once
        person = _Person(bus, user, declared)
        button = bus.publisher(BUTTON, user)
        declared.callback(button.close)
        await person.first(patience_s)
        button.put(ButtonEvent(stamp_ns=clock.now_ns(), seq=1, gesture=gesture, source="keyboard"))
        after = await person.next(patience_s)
    if after is None:
        raise NoAnswerError(
            f"{person.supervisor} did not answer within {patience_s:g} s; see `pointit doctor`"
        )
    return after


class _Person:
    def __init__(self, bus: Bus, user: str, declared: contextlib.ExitStack) -> None:
        self.supervisor = instance_of("supervisor", user)
        self._user = user
        self._site = SiteState(self._on_change, on_service=lambda *_: self._changed.set())
        self._is_cued = False
        self._changed = asyncio.Event()
        now_s = asyncio.get_running_loop().time
        for watch in follow_site(self._site, bus, now_s, (INTERACTION, FEEDBACK), user):
            declared.callback(watch.close)

    async def first(self, patience_s: float) -> Interaction:
        """Return the interaction as soon as it and the supervisor are known."""

        def is_known() -> bool:
            return self._newest is not None and self.supervisor in self._site.services

        await self._until(is_known, patience_s)
        if self._newest is None or self.supervisor not in self._site.services:
            raise NoAnswerError(f"{self._user} has no supervisor: {self._advice()}")
        return self._newest

    async def next(self, patience_s: float) -> Interaction | None:
        """Return the interaction after the next Interaction or cue, or None if neither arrives."""
        previous = self._newest
        self._is_cued = False

        def has_changed() -> bool:
            return self._newest is not previous

        # A cue may come shortly before the Interaction that it is about
        await self._until(lambda: has_changed() or self._is_cued, patience_s)
        if self._is_cued:
            await self._until(has_changed, CUE_FIRST_S)
        if not self._is_cued and not has_changed():
            return None
        return self._newest

    @property
    def _newest(self) -> Interaction | None:
        return self._site.get(INTERACTION, self._user)

    async def _until(self, condition: Callable[[], bool], patience_s: float) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while not condition():
                    self._changed.clear()
                    await self._changed.wait()

    def _advice(self) -> str:
        services = self._site.services
        instances = map(split_instance, services)
        people = sorted(user for service, user in instances if service == "supervisor")
        if self.supervisor in services:
            return f"{self.supervisor} is present but says nothing, see `pointit doctor`"
        there = f"there is {', '.join(people)}" if people else "there are no other people either"
        return f"{there}; {add_or_similar(self._user, people)}"

    def _on_change(self, change: Change) -> None:
        cue = change.message
        if isinstance(cue, Feedback):
            is_selection = cue.cue in ("selected", "deselected")
            if not is_selection and cue.turn_rad is None:
                self._is_cued = True
        self._changed.set()


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
        """Publish all objects of this tracker, at least once a second. Those no longer listed have left.

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
        if stamp_ns is None:
            stamp_ns = self._now_ns() - self._latency_ns

        # The number of a refused message is used again: a gap would count as a loss
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
