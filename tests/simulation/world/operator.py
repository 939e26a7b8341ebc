"""An operator who switches, takes back, clears and releases at random."""

import asyncio
from collections.abc import Callable
from random import Random
from typing import Any

from pointit.runtime.errors import RequestError
from pointit.schemas import SetThing, topics
from pointit.schemas.requests import ClearSelection, ReleaseObject, UndoSelection
from pointit.schemas.topics import Request
from tests.simulation.kernel.timeline import Timeline
from tests.simulation.network.simulated_bus import SimulatedBus
from tests.simulation.world.room import THINGS

SWITCHES_BELOW = 0.6
UNDOES_BELOW = 0.8
CLEARS_BELOW = 0.9
"""Shares of requests. The rest releases."""

ReplyObserver = Callable[[float, Request[Any, Any], Any, str, str], object]
"""Called with the time of the request, s, the request, its query, the person, and the reply as text."""


class Operator:
    """Sends requests in the name of people."""

    def __init__(self, timeline: Timeline, people: tuple[str, ...], period_s: float) -> None:
        self.is_active = True
        self.on_reply: list[ReplyObserver] = []
        self._timeline = timeline
        self._people = people
        self._period_s = period_s
        self._starts = 0

    async def run(self, bus: SimulatedBus) -> None:
        """Send requests at random times until it is cancelled. It waits for each reply."""
        self._starts += 1
        random = self._timeline.random(f"operator {self._starts}")
        while True:
            await asyncio.sleep(random.expovariate(1.0 / self._period_s))
            if not self.is_active:
                continue
            user = random.choice(self._people)
            request, query = draw_request(random, random.choice(THINGS))
            await self.ask(bus, request, query, user)

    async def ask(self, bus: SimulatedBus, request: Request[Any, Any], query: Any, user: str) -> str:
        """Send one request, and return `ok: ` and its message, or `no: ` and the error."""
        began_s = self._timeline.now_s
        try:
            reply = await bus.call(request, query, user)
        except RequestError as error:
            answer = f"no: {error}"
        else:
            answer = f"ok: {reply.message}"
        values = query.model_dump()
        text = " ".join(f"{name}={value}" for name, value in values.items() if value not in (None, ""))
        self._timeline.note("reply", f"{request.key} {user} {text} -> {answer[:120]}")
        for observe in self.on_reply:
            observe(began_s, request, query, user, answer)
        return answer


def draw_request(random: Random, thing: str) -> tuple[Request[Any, Any], Any]:
    """Return a request and its query."""
    kind = random.random()
    if kind < SWITCHES_BELOW:
        return topics.SET_THING, SetThing(thing=thing, on=random.choice((None, True, False)))
    if kind < UNDOES_BELOW:
        return topics.UNDO_SELECTION, UndoSelection()
    if kind < CLEARS_BELOW:
        return topics.CLEAR_SELECTION, ClearSelection()
    return topics.RELEASE_OBJECT, ReleaseObject(object_id=thing, take_over=random.random() < 0.5)
