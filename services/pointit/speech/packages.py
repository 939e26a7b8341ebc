"""Objects that nobody has yet, such as packages on belts: taken for a person, and sent to a bay."""

import asyncio

from pointit.errors import RefusedError
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.schemas import Claim, Referent, SelectionEvent, TrackedObject
from pointit.schemas.topics import CLAIM, SELECTION_EVENTS
from pointit.speech.room import SpokenRoom

DECIDED_S = 2.0
"""Time for the selector to decide, and for the conveyor to choose another bay, s."""
PERIOD_S = 0.05
NEAR_M = 1.5
"""Maximum distance of the place that is meant from a bay, m."""


class Packages:
    """Claims objects as a dwell does: the selector decides by the same rules."""

    def __init__(self, bus: Bus, clock: Clock, user: str, room: SpokenRoom) -> None:
        self._bus, self._clock, self._user, self._room = bus, clock, user, room
        self._claims = bus.publisher(CLAIM, user)
        self._awaited: dict[int, asyncio.Future[SelectionEvent]] = {}
        bus.subscribe(SELECTION_EVENTS, self._on_event)

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        """Match decisions with claims: they have their stamps."""
        awaited = self._awaited.get(event.stamp_ns)
        if awaited is not None and not awaited.done() and event.user == self._user:
            awaited.set_result(event)

    def problem(self, one: Referent, place_m: Vec3 | None = None) -> str:
        """Return the reason not to take `one`, and not to send it to the bay at `place_m`, or `""`."""
        tracked = self._find(one)
        if tracked is None:
            return f"{one.name} has left"
        bay = None if place_m is None else self._bay(place_m)
        if bay == "":
            return "no bay is near that place: nothing is attached to putting it there"
        if tracked.press and (bay is None or bay != tracked.bay):
            return f"{one.name} wants a press: point at it, and press the button"
        return ""

    async def take(self, one: Referent) -> str:
        """Select `one` for the person.

        Raises:
            RefusedError: If the selector refuses, or does not decide.
        """
        if problem := self.problem(one):
            raise RefusedError(problem)
        stamp_ns = self._clock.now_ns()
        self._awaited[stamp_ns] = decided = asyncio.get_running_loop().create_future()
        self._claims.put(
            Claim(
                stamp_ns=stamp_ns,
                object_id=one.name,
                wish="toggle",
                action="select",
                confidence=one.probability,
            )
        )
        try:
            async with asyncio.timeout(DECIDED_S / self._clock.speed):
                event = await decided
        except TimeoutError as error:
            raise RefusedError(f"nobody decided about {one.name}: is the selector running?") from error
        finally:
            del self._awaited[stamp_ns]
        if event.event == "refused":
            raise RefusedError(event.reason)
        return f"{event.kind or 'object'} {one.name} is {self._user}'s"

    async def to_bay(self, one: Referent, place_m: Vec3) -> str:
        """Send a package to the bay at `place_m`: the conveyor sends what is selected to one bay.

        Raises:
            RefusedError: If no bay is there, or it does not go there. It is the person's in this case, too.
        """
        if problem := self.problem(one, place_m):
            raise RefusedError(problem)
        bay = self._bay(place_m)
        if self._object(one).bay == bay:
            return f"{one.name} goes to bay {bay} already"
        taken = await self.take(one)
        waited_s = 0.0
        while (goes := self._object(one).bay) != bay:
            if waited_s > DECIDED_S:
                raise RefusedError(
                    f"{taken}, and goes to bay {goes}: the conveyor sends it there, not to {bay}"
                )
            await asyncio.sleep(PERIOD_S / self._clock.speed)
            waited_s += PERIOD_S
        return f"{taken}, and goes to bay {bay}"

    def _find(self, one: Referent) -> TrackedObject | None:
        tracked = (each for listed in self._room.objects.values() for each in listed.objects)
        return next((each for each in tracked if each.id == one.name), None)

    def _object(self, one: Referent) -> TrackedObject:
        if (tracked := self._find(one)) is None:
            raise RefusedError(f"{one.name} has left")
        return tracked

    def _bay(self, place_m: Vec3) -> str:
        """Return the bay near a place, or `""` if there is none."""
        away = {
            vector.norm(vector.subtract(there_m, place_m)): bay for bay, there_m in self._room.bays.items()
        }
        return away[min(away)] if away and min(away) <= NEAR_M else ""
