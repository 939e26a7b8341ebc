"""Moves the wrists that pages have, for as long as they have any."""

import asyncio
from collections.abc import Callable

from pointit.bridges.web.model.people import People
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.clock import Clock


class WristMotion:
    """Publishes what wrists do; rests while no page has one."""

    def __init__(
        self, wrists: WristControl, people: People, clock: Clock, *, rate_hz: float, ended: Callable[[], None]
    ) -> None:
        """Rest.

        Args:
            wrists: who has whose wrist, and what it does.
            people: who is there; they publish it.
            clock: the site's.
            rate_hz: samples a second, by the wall.
            ended: called when no page has a wrist any more.
        """
        self._wrists = wrists
        self._people = people
        self._clock = clock
        self._rate_hz = rate_hz
        self._ended = ended
        self._moving = asyncio.Event()

    def wake(self) -> None:
        """Move, if a page has a wrist."""
        if self._is_needed:
            self._moving.set()

    async def run(self) -> None:
        """Move until cancelled; people and their mice live by the wall's time."""
        while True:
            await self._moving.wait()
            samples = self._wrists.step(self._clock.now_ns(), self._clock.speed)
            for user, sample in samples:
                self._people.move(user, sample)
            if not self._is_needed:
                self._moving.clear()
                self._ended()
            await asyncio.sleep(1.0 / self._rate_hz)

    @property
    def _is_needed(self) -> bool:
        return any(self._wrists.holder(user)[0] for user in self._people.names)
