"""Timer that moves the wrists held by pages."""

import asyncio
from collections.abc import Callable

from pointit.bridges.web.model.people import People
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.clock import Clock


class WristMotion:
    """Publishes samples of wrists; rests while no page holds one."""

    def __init__(
        self, wrists: WristControl, people: People, clock: Clock, *, rate_hz: float, ended: Callable[[], None]
    ) -> None:
        """Create it at rest.

        Args:
            wrists: control of the wrists.
            people: people present, who publish the samples.
            clock: the site's.
            rate_hz: samples a second of wall time.
            ended: called when no page holds a wrist any more.
        """
        self._wrists = wrists
        self._people = people
        self._clock = clock
        self._rate_hz = rate_hz
        self._ended = ended
        self._moving = asyncio.Event()

    def wake(self) -> None:
        """Start if a page holds a wrist."""
        if self._is_needed:
            self._moving.set()

    async def run(self) -> None:
        """Move until cancelled, by wall time."""
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
