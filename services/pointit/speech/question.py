"""Asks a person which one they mean: each candidate blinks in turn; yes is said, or the button pressed."""

import asyncio
import contextlib
from collections.abc import Sequence

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import RequestError
from pointit.schemas import ButtonEvent, Referent, SetLamp
from pointit.schemas.base import Rgb
from pointit.schemas.topics import BUTTON, SET_LAMP
from pointit.speech.grammar import Answer
from pointit.speech.room import SpokenRoom

TURN_S = 1.5
"""Time for which one candidate is asked about, s."""
ROUNDS = 2
BLINKS = 3
"""Number of times that a lamp blinks in a turn."""
COLOR: Rgb = (255, 255, 255)


class Question:
    """Asks one question at a time."""

    def __init__(self, bus: Bus, clock: Clock, user: str, room: SpokenRoom) -> None:
        self._bus, self._clock, self._room = bus, clock, room
        self._answer: asyncio.Future[Answer] | None = None
        bus.subscribe(BUTTON, self._on_button, user)

    def answer(self, said: Answer) -> bool:
        """Answer the question that is being asked. Return False if there is none."""
        if self._answer is None or self._answer.done():
            return False
        self._answer.set_result(said)
        return True

    def _on_button(self, event: ButtonEvent, _user: str) -> None:
        if event.gesture == "press":
            self.answer("yes")

    async def ask(self, candidates: Sequence[Referent]) -> Referent | None:
        """Return the candidate that is confirmed in its turn, or None if none is."""
        for index in range(ROUNDS * len(candidates)):
            one = candidates[index % len(candidates)]
            self._answer = asyncio.get_running_loop().create_future()
            blinking = asyncio.create_task(self._blink(self._room.lamp(one)))
            try:
                async with asyncio.timeout(TURN_S / self._clock.speed):
                    said = await self._answer
            except TimeoutError:
                said = None
            finally:
                self._answer = None
                blinking.cancel()
                await asyncio.wait({blinking})
            if said == "yes":
                return one
            if said == "no" and len(candidates) == 1:
                return None
        return None

    async def _blink(self, lamp: str) -> None:
        """Blink a lamp, and give it back to the site. Who may not set lamps still asks in words."""
        if not lamp:
            return
        half_s = TURN_S / (2 * BLINKS) / self._clock.speed
        with contextlib.suppress(RequestError):
            try:
                for _ in range(BLINKS):
                    await self._bus.call(SET_LAMP, SetLamp(color=COLOR), lamp)
                    await asyncio.sleep(half_s)
                    await self._bus.call(SET_LAMP, SetLamp(color=(0, 0, 0)), lamp)
                    await asyncio.sleep(half_s)
            finally:
                await self._bus.call(SET_LAMP, SetLamp(color=None), lamp)
