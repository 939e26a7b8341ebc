"""Verbs of spoken commands: their objects, their effects, and the checks that pointing has."""

import asyncio
import math
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from pointit.errors import RefusedError
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.schemas import Claim, Referent, SelectionEvent, SendRobot, SetThing, StopRobot, TrackedObject
from pointit.schemas.person import ReferentKind
from pointit.schemas.text import first_of
from pointit.schemas.topics import CLAIM, SELECTION_EVENTS, SEND_ROBOT, SET_THING, STOP_ROBOT
from pointit.speech.grammar import Command, SpokenRoom

DECIDED_S = 2.0
"""Time for the selector to decide, and for the conveyor to choose another bay, s."""
PERIOD_S = 0.05
NEAR_M = 1.5
"""Maximum distance of the place that is meant from a bay, m."""

MAX_NAMES = 8
"""Number of names of the room that a message lists."""


class Packages:
    """Claims objects as a dwell does: the selector decides by the same rules."""

    def __init__(self, bus: Bus, clock: Clock, user: str, room: SpokenRoom) -> None:
        self._bus = bus
        self._clock = clock
        self._user = user
        self._room = room
        self._claims = bus.publisher(CLAIM, user)
        self._decisions: dict[int, asyncio.Future[SelectionEvent]] = {}
        """Decisions that are awaited, by the stamp of their claim, ns."""
        bus.subscribe(SELECTION_EVENTS, self._on_event)

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        """Match decisions with claims: they have their stamps."""
        decision = self._decisions.get(event.stamp_ns)
        if decision is None or decision.done():
            return
        if event.user == self._user:
            decision.set_result(event)

    def problem(self, package: Referent, place_m: Vec3 | None = None) -> str:
        """Return the reason not to take `package`, and not to send it to the bay at `place_m`, or `""`."""
        tracked = self._find(package)
        if tracked is None:
            return f"{package.name} has left"
        bay = None if place_m is None else self._bay(place_m)
        if bay == "":
            return "no bay is near that place: nothing is attached to putting it there"
        is_on_its_way = bay is not None and bay == tracked.bay
        if tracked.press and not is_on_its_way:
            return f"{package.name} wants a press: point at it, and press the button"
        return ""

    async def take(self, package: Referent) -> str:
        """Select `package` for the person.

        Raises:
            RefusedError: If the selector refuses, or does not decide.
        """
        problem = self.problem(package)
        if problem:
            raise RefusedError(problem)

        # The selector's event has the stamp of the claim that it decides.
        stamp_ns = self._clock.now_ns()
        decision: asyncio.Future[SelectionEvent] = asyncio.get_running_loop().create_future()
        self._decisions[stamp_ns] = decision
        self._claims.put(
            Claim(
                stamp_ns=stamp_ns,
                object_id=package.name,
                wish="toggle",
                action="select",
                confidence=package.probability,
            )
        )
        try:
            async with asyncio.timeout(DECIDED_S / self._clock.speed):
                event = await decision
        except TimeoutError as error:
            raise RefusedError(f"nobody decided about {package.name}: is the selector running?") from error
        finally:
            del self._decisions[stamp_ns]

        if event.event == "refused":
            raise RefusedError(event.reason)
        return f"{event.kind or 'object'} {package.name} is {self._user}'s"

    async def to_bay(self, package: Referent, place_m: Vec3) -> str:
        """Send a package to the bay at `place_m`: the conveyor sends what is selected to one bay.

        Raises:
            RefusedError: If no bay is there, or it does not go there. It is the person's in this case, too.
        """
        problem = self.problem(package, place_m)
        if problem:
            raise RefusedError(problem)
        bay = self._bay(place_m)
        if self._object(package).bay == bay:
            return f"{package.name} goes to bay {bay} already"

        # Once it is selected, the conveyor chooses a bay and reports it.
        taken = await self.take(package)
        waited_s = 0.0
        chosen_bay = self._object(package).bay
        while chosen_bay != bay:
            if waited_s > DECIDED_S:
                raise RefusedError(
                    f"{taken}, and goes to bay {chosen_bay}: the conveyor sends it there, not to {bay}"
                )
            await asyncio.sleep(PERIOD_S / self._clock.speed)
            waited_s += PERIOD_S
            chosen_bay = self._object(package).bay
        return f"{taken}, and goes to bay {bay}"

    def _find(self, package: Referent) -> TrackedObject | None:
        for message in self._room.objects.values():
            for tracked in message.objects:
                if tracked.id == package.name:
                    return tracked
        return None

    def _object(self, package: Referent) -> TrackedObject:
        tracked = self._find(package)
        if tracked is None:
            raise RefusedError(f"{package.name} has left")
        return tracked

    def _bay(self, place_m: Vec3) -> str:
        """Return the bay near a place, or `""` if there is none."""
        bays: dict[float, str] = {}
        for bay, bay_m in self._room.bays.items():
            distance_m = vector.norm(vector.subtract(bay_m, place_m))
            bays[distance_m] = bay
        nearest_m = min(bays, default=math.inf)
        return bays[nearest_m] if nearest_m <= NEAR_M else ""


@dataclass(frozen=True)
class VerbContext:
    """Bus, time, person and room for an action."""

    bus: Bus
    clock: Clock
    user: str
    """The person who speaks."""
    room: SpokenRoom
    packages: Packages


Action: TypeAlias = Callable[[VerbContext, Command, Sequence[Referent]], Awaitable[str]]
"""Does a command. The referents are those of its mentions, in order. Returns what was done, in a sentence.

Raises:
    RequestError: If a service refuses, with the reason.
"""


Check: TypeAlias = Callable[[VerbContext, Command, Sequence[Referent]], str]
"""Returns the reason why a command would be refused, or `""`, as far as the room tells it.

The referents are those of its mentions, in order. Empty: before they are known.
"""


def _no_problem(_context: VerbContext, _command: Command, _referents: Sequence[Referent]) -> str:
    return ""


@dataclass(frozen=True, kw_only=True)
class Verb:
    """Kinds and things that a verb may be about, its checks and its action."""

    act: Action
    problem: Check = _no_problem
    kinds: Sequence[ReferentKind] = ("thing",)
    """Kinds of its objects; any if there are none."""
    things: Collection[str] = ()
    """Things of the map that have this verb; all if there are none. What is not among them is not meant."""


def _lacking(context: VerbContext, command: Command, question: str, remedy: str) -> str:
    """Return the message that a command lacks its object, with the name that the room does not have."""
    if not command.unknown_name:
        return f"{question} {remedy}"
    names = sorted(set(context.room.names.values()))
    advice = did_you_mean(command.unknown_name, names)
    hint = f"{advice} or"
    if names and not advice:
        hint = f"name one of {first_of(names, MAX_NAMES)}, or"
    return f"nothing here is called {command.unknown_name!r}: {hint.strip()} {remedy}"


def _fire_problem(context: VerbContext, command: Command, referents: Sequence[Referent]) -> str:
    is_take = command.verb == "take"
    if command.about is None and not referents:
        verb, word = ("take", "") if is_take else ("turn", f" {command.verb}")
        return _lacking(context, command, f"{verb} what{word}?", f"point at it, and say `{verb} that{word}`")
    if not referents:
        return ""
    referent = referents[0]
    thing = context.room.thing(referent.name)
    label = context.room.label(referent)
    if referent.kind == "object" and is_take:
        return context.packages.problem(referent)
    if referent.kind != "thing":
        return f"{referent.name} is no thing of the map: nothing is attached to taking it"
    if thing is not None and thing.press:
        return f"{label} wants a press: point at it, and press the button"
    if is_take or referent.name in context.room.switches:
        return ""
    return f"{label} is no switch: say `take that`"


async def _fire(context: VerbContext, command: Command, referents: Sequence[Referent]) -> str:
    """Fire the thing as if the person had pointed at it, or select the object."""
    problem = _fire_problem(context, command, referents)
    if problem:
        raise RefusedError(problem)
    referent = referents[0]
    if referent.kind == "object":
        return await context.packages.take(referent)
    on = {"on": True, "off": False}.get(command.verb)
    thing = context.room.thing(referent.name)
    if thing is not None and thing.mode == "button":
        on = True  # a button that staying on it has just fired is meant, not a second time
    reply = await context.bus.call(SET_THING, SetThing(thing=referent.name, on=on), context.user)
    return reply.message


def _send_problem(context: VerbContext, command: Command, referents: Sequence[Referent]) -> str:
    if command.about is None and command.unknown_name:
        return _lacking(context, command, "", f"point at it, and say `{command.verb} that there`")
    if command.to is None:
        return "where to? say `there` while you point at the place"
    if not referents:
        return ""
    place = referents[-1]
    about = referents[0] if command.about is not None else None
    if about is not None and about.kind not in ("robot", "object"):
        return f"{context.room.label(about)} is no robot, and nothing is attached to moving it"
    if place.place_m is None:
        return f"the place of {place.name or 'that'} is not known"
    if about is not None and about.kind == "object":
        return context.packages.problem(about, place.place_m)
    if about is None:
        return ""
    state = context.room.robots.get(about.name)
    if state is not None and state.user not in ("", context.user):
        return f"{about.name} is steered by {state.user}: wait until it is free"
    return ""


async def _send(context: VerbContext, command: Command, referents: Sequence[Referent]) -> str:
    """Send a robot to a place, by the person's service `goal`, which checks it as a place pointed at."""
    place_m = referents[-1].place_m if referents else None
    problem = _send_problem(context, command, referents)
    if problem or place_m is None:
        raise RefusedError(problem)
    about = referents[0] if command.about is not None else None
    if about is not None and about.kind == "object":
        return await context.packages.to_bay(about, place_m)

    # The robot that is named, else the one that the person steers, else the only one.
    if about is not None:
        robot = about.name
    else:
        robot = next(iter(context.room.robots_of(context.user)), "")
    if not robot and len(context.room.robots) == 1:
        robot = next(iter(context.room.robots))
    reply = await context.bus.call(SEND_ROBOT, SendRobot(position_m=place_m, robot=robot), context.user)
    return reply.message


def _what_problem(context: VerbContext, command: Command, referents: Sequence[Referent]) -> str:
    if command.about is not None or referents:
        return ""
    return _lacking(context, command, "what is what?", "point at it, and say `what is this`")


async def _what(context: VerbContext, _command: Command, referents: Sequence[Referent]) -> str:
    """Say what it is."""
    referent = referents[0]
    return f"{referent.kind} {context.room.label(referent)}, sure by {referent.probability:.0%}"


async def _stop(context: VerbContext, _command: Command, referents: Sequence[Referent]) -> str:
    """Stop the robot that is meant, those of the person, or all."""
    named = [referent.name for referent in referents if referent.kind == "robot"]
    present = sorted(context.room.present_robots.union(context.room.robots))
    robots = named or context.room.robots_of(context.user) or present
    if not robots:
        raise RefusedError("there is no robot to stop")
    query = StopRobot(reason=f"{context.user} said stop")
    calls = [context.bus.call(STOP_ROBOT, query, robot) for robot in robots]
    # All are asked before a refusal is raised: it leaves no other robot driving.
    replies = await asyncio.gather(*calls, return_exceptions=True)
    for reply in replies:
        if isinstance(reply, BaseException):
            raise reply
    return f"{', '.join(robots)} stopped"


VERBS: Mapping[str, Verb] = {
    "take": Verb(act=_fire, problem=_fire_problem, kinds=("thing", "object", "robot")),
    "on": Verb(act=_fire, problem=_fire_problem),
    "off": Verb(act=_fire, problem=_fire_problem),
    "put": Verb(act=_send, problem=_send_problem, kinds=("robot", "thing", "object")),
    "send": Verb(act=_send, problem=_send_problem, kinds=("robot", "object")),
    "what": Verb(act=_what, problem=_what_problem, kinds=()),
    "stop": Verb(act=_stop, kinds=("robot",)),
}
"""The verbs of all rooms; `turn on` and `turn off` are of switches only."""


def verb_of_things(
    things: Collection[str], do: Callable[[VerbContext, str, Referent], Awaitable[str]]
) -> Verb:
    """Return a verb of some things of the map. `do` gets verb and thing, and returns a sentence."""

    def problem(context: VerbContext, command: Command, referents: Sequence[Referent]) -> str:
        verb = command.verb
        if command.about is None and not referents:
            return _lacking(context, command, f"{verb} what?", f"point at it, and say `{verb} that`")
        if not referents or referents[0].name in things:
            return ""
        return f"nothing is attached to `{verb}` of {context.room.label(referents[0])}"

    async def act(context: VerbContext, command: Command, referents: Sequence[Referent]) -> str:
        reason = problem(context, command, referents)
        if reason:
            raise RefusedError(reason)
        return await do(context, command.verb, referents[0])

    return Verb(act=act, problem=problem, things=things)
