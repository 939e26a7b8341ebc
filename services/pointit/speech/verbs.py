"""Verbs: what they take, and what they do, with the checks that pointing has."""

import asyncio
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.config.similar_names import did_you_mean
from pointit.runtime.errors import RefusedError
from pointit.schemas import Referent, SendRobot, SetThing, StopRobot
from pointit.schemas.person import ReferentKind
from pointit.schemas.topics import SEND_ROBOT, SET_THING, STOP_ROBOT
from pointit.speech.grammar import Command
from pointit.speech.packages import Packages
from pointit.speech.room import SpokenRoom

MAX_NAMES = 8
"""Number of names of the room that a message lists."""


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


def _no_problem(_site: VerbContext, _command: Command, _found: Sequence[Referent]) -> str:
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


def _lacking(site: VerbContext, command: Command, question: str, remedy: str) -> str:
    """Return the message that a command lacks its object, with the name that is none of the room."""
    if not command.unknown_name:
        return f"{question} {remedy}"
    names = sorted(set(site.room.names.values()))
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    near = did_you_mean(command.unknown_name, names)
    hint = f"name one of {', '.join(names[:MAX_NAMES])}{more}, or" if names and not near else f"{near} or"
    return f"nothing here is called {command.unknown_name!r}: {hint.strip()} {remedy}"


def _fire_problem(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
    if command.about is None and not found:
        verb, word = ("take", "") if command.verb == "take" else ("turn", f" {command.verb}")
        return _lacking(site, command, f"{verb} what{word}?", f"point at it, and say `{verb} that{word}`")
    if not found:
        return ""
    one, thing = found[0], site.room.thing(found[0].name)
    label = site.room.label(one)
    if one.kind == "object" and command.verb == "take":
        return site.packages.problem(one)
    if one.kind != "thing":
        return f"{one.name} is no thing of the map: nothing is attached to taking it"
    if thing is not None and thing.press:
        return f"{label} wants a press: point at it, and press the button"
    is_switch = one.name in site.room.switches or command.verb == "take"
    return "" if is_switch else f"{label} is no switch: say `take that`"


async def _fire(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
    """Fire the thing as if the person had pointed at it, or select the object."""
    if problem := _fire_problem(site, command, found):
        raise RefusedError(problem)
    one = found[0]
    if one.kind == "object":
        return await site.packages.take(one)
    on = {"on": True, "off": False}.get(command.verb)
    thing = site.room.thing(one.name)
    if thing is not None and thing.mode == "button":
        on = True  # a button that staying on it has just fired is meant, not a second time
    return (await site.bus.call(SET_THING, SetThing(thing=one.name, on=on), site.user)).message


def _send_problem(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
    if command.about is None and command.unknown_name:
        return _lacking(site, command, "", f"point at it, and say `{command.verb} that there`")
    if command.to is None:
        return "where to? say `there` while you point at the place"
    if not found:
        return ""
    place, about = found[-1], found[0] if command.about is not None else None
    if about is not None and about.kind not in ("robot", "object"):
        return f"{site.room.label(about)} is no robot, and nothing is attached to moving it"
    if place.place_m is None:
        return f"the place of {place.name or 'that'} is not known"
    if about is not None and about.kind == "object":
        return site.packages.problem(about, place.place_m)
    state = None if about is None else site.room.robots.get(about.name)
    if state is not None and state.user not in ("", site.user):
        return f"{about.name if about else ''} is steered by {state.user}: wait until it is free"
    return ""


async def _send(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
    """Send a robot to a place, by the person's service `goal`, which checks it as a place pointed at."""
    place_m = found[-1].place_m if found else None
    if (problem := _send_problem(site, command, found)) or place_m is None:
        raise RefusedError(problem)
    about = found[0] if command.about is not None else None
    if about is not None and about.kind == "object":
        return await site.packages.to_bay(about, place_m)
    robot = about.name if about is not None else next(iter(site.room.robots_of(site.user)), "")
    if not robot and len(site.room.robots) == 1:
        robot = next(iter(site.room.robots))
    return (await site.bus.call(SEND_ROBOT, SendRobot(position_m=place_m, robot=robot), site.user)).message


def _what_problem(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
    if command.about is not None or found:
        return ""
    return _lacking(site, command, "what is what?", "point at it, and say `what is this`")


async def _what(site: VerbContext, _command: Command, found: Sequence[Referent]) -> str:
    """Say what it is."""
    one = found[0]
    return f"{one.kind} {site.room.label(one)}, sure by {one.probability:.0%}"


async def _stop(site: VerbContext, _command: Command, found: Sequence[Referent]) -> str:
    """Stop the robot that is meant, those of the person, or all."""
    named = [one.name for one in found if one.kind == "robot"]
    there = sorted(site.room.present_robots.union(site.room.robots))
    robots = named or site.room.robots_of(site.user) or there
    if not robots:
        raise RefusedError("there is no robot to stop")
    query = StopRobot(reason=f"{site.user} said stop")
    calls = (site.bus.call(STOP_ROBOT, query, robot) for robot in robots)
    for done in await asyncio.gather(*calls, return_exceptions=True):  # a refusal leaves no other one driving
        if isinstance(done, BaseException):
            raise done
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

    def problem(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
        verb = command.verb
        if command.about is None and not found:
            return _lacking(site, command, f"{verb} what?", f"point at it, and say `{verb} that`")
        is_attached = not found or found[0].name in things
        return "" if is_attached else f"nothing is attached to `{verb}` of {site.room.label(found[0])}"

    async def act(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
        if reason := problem(site, command, found):
            raise RefusedError(reason)
        return await do(site, command.verb, found[0])

    return Verb(act=act, problem=problem, things=things)
