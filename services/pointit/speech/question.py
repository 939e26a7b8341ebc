"""Asks a person which one they mean: each candidate blinks in turn; yes is said, or the button pressed."""

import asyncio
import contextlib
from collections.abc import Sequence

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import RequestError
from pointit.schemas import NS_PER_S, ButtonEvent, Referent, SetLamp
from pointit.schemas.base import Rgb
from pointit.schemas.topics import BUTTON, SET_LAMP
from pointit.services.listener.decision import REACTION_S
from pointit.speech.grammar import Answer
from pointit.speech.room import SpokenRoom

TURN_S = 3.0
"""Time for which one candidate is asked about, s."""
LATE_S = 1.5
"""Time for which answers are awaited after the last turn, s: recognisers tell words when they are over."""
ROUNDS = 2
BLINKS = 6
"""Number of times that a lamp blinks in a turn."""
COLOR: Rgb = (255, 255, 255)


class Question:
    """Asks one question at a time."""

    def __init__(self, bus: Bus, clock: Clock, user: str, room: SpokenRoom) -> None:
        self._bus, self._clock, self._room = bus, clock, room
        self._turns: list[tuple[int, Referent]] = []
        """The candidates shown since the question began, each with the time of its first blink, ns."""
        self._left: list[Referent] = []
        """Candidates that may still be confirmed."""
        self._chosen: Referent | None = None
        self._answered = asyncio.Event()
        bus.subscribe(BUTTON, self._on_button, user)

    def answer(self, said: Answer, at_ns: int) -> bool:
        """Answer what was shown at `at_ns`, when the answer began. Return False if nothing was asked then.

        A candidate that was denied is not confirmed, and an answer is not taken back.
        """
        decided_ns = at_ns - round(REACTION_S * NS_PER_S)
        shown = [one for since_ns, one in self._turns if since_ns <= decided_ns]
        if not shown:
            return False
        if said == "no":
            self._left = [one for one in self._left if one != shown[-1]]
        elif shown[-1] in self._left:
            self._left, self._chosen = [], shown[-1]
        if not self._left or len(shown) == len(self._turns):  # else the next one is shown already
            self._answered.set()
        return True

    def stop(self) -> None:
        """Ask no more: nothing is confirmed."""
        self._left, self._chosen = [], None
        self._answered.set()

    def _on_button(self, event: ButtonEvent, _user: str) -> None:
        if event.gesture == "press":
            self.answer("yes", event.stamp_ns)

    async def ask(self, candidates: Sequence[Referent]) -> Referent | None:
        """Return the candidate that is confirmed in its turn, or None if none is."""
        self._left, self._chosen = list(candidates), None
        try:
            for one in [*candidates] * ROUNDS:
                if one in self._left:
                    self._turns.append((self._clock.now_ns(), one))
                    blinking = asyncio.create_task(self._blink(self._room.lamp(one)))
                    try:
                        await self._answer_within(TURN_S)
                    finally:
                        blinking.cancel()
                        await asyncio.wait({blinking})
            if self._left:
                await self._answer_within(LATE_S)
            return self._chosen
        finally:
            self._turns.clear()

    async def _answer_within(self, time_s: float) -> None:
        self._answered.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(time_s / self._clock.speed):
                await self._answered.wait()

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
