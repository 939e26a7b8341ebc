"""Verbs: what they take, and what they do, with the checks that pointing has."""

import asyncio
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import RefusedError
from pointit.schemas import Referent, SendRobot, SetThing, StopRobot
from pointit.schemas.person import ReferentKind
from pointit.schemas.topics import SEND_ROBOT, SET_THING, STOP_ROBOT
from pointit.speech.grammar import Command
from pointit.speech.packages import Packages
from pointit.speech.room import SpokenRoom


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


@dataclass(frozen=True, kw_only=True)
class Verb:
    """Kinds and things that a verb may be about, and its action."""

    act: Action
    kinds: Sequence[ReferentKind] = ("thing",)
    """Kinds of its objects; any if there are none."""
    things: Collection[str] = ()
    """Things of the map that have this verb; all if there are none. What is not among them is not meant."""


async def _fire(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
    """Fire the thing as if the person had pointed at it, or select the object."""
    if not found:
        verb, word = ("take", "") if command.verb == "take" else ("turn", f" {command.verb}")
        raise RefusedError(f"{verb} what{word}? point at it, and say `{verb} that{word}`")
    one = found[0]
    if one.kind == "object" and command.verb == "take":
        return await site.packages.take(one)
    if one.kind != "thing":
        raise RefusedError(f"{one.name} is no thing of the map: nothing is attached to taking it")
    thing = site.room.thing(one.name)
    if thing is not None and thing.press:
        raise RefusedError(f"{site.room.label(one)} wants a press: point at it, and press the button")
    on = {"on": True, "off": False}.get(command.verb)
    if on is not None and one.name not in site.room.switches:
        raise RefusedError(f"{site.room.label(one)} is no switch: say `take that`")
    if thing is not None and thing.mode == "button":
        on = True  # a button that staying on it has just fired is meant, not a second time
    return (await site.bus.call(SET_THING, SetThing(thing=one.name, on=on), site.user)).message


async def _send(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
    """Send a robot to a place, by the person's service `goal`, which checks it as a place pointed at."""
    if command.to is None:
        raise RefusedError("where to? say `there` while you point at the place")
    place, about = found[-1], found[0] if command.about is not None else None
    if place.place_m is None:
        raise RefusedError(f"the place of {place.name or 'that'} is not known")
    if about is not None and about.kind == "object":
        return await site.packages.to_bay(about, place.place_m)
    if about is not None and about.kind != "robot":
        raise RefusedError(f"{about.name} is no robot, and nothing is attached to moving it")
    robot = about.name if about is not None else next(iter(site.room.robots_of(site.user)), "")
    if not robot and len(site.room.robots) == 1:
        robot = next(iter(site.room.robots))
    query = SendRobot(position_m=place.place_m, robot=robot)
    return (await site.bus.call(SEND_ROBOT, query, site.user)).message


async def _what(site: VerbContext, _command: Command, found: Sequence[Referent]) -> str:
    """Say what it is."""
    if not found:
        raise RefusedError("what is what? point at it, and say `what is this`")
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
    "take": Verb(act=_fire, kinds=("thing", "object", "robot")),
    "on": Verb(act=_fire),
    "off": Verb(act=_fire),
    "put": Verb(act=_send, kinds=("robot", "thing", "object")),
    "send": Verb(act=_send, kinds=("robot", "object")),
    "what": Verb(act=_what, kinds=()),
    "stop": Verb(act=_stop, kinds=("robot",)),
}
"""The verbs of all rooms; `turn on` and `turn off` are of switches only."""


def verb_of_things(
    things: Collection[str], do: Callable[[VerbContext, str, Referent], Awaitable[str]]
) -> Verb:
    """Return a verb of some things of the map. `do` gets verb and thing, and returns a sentence."""

    async def act(site: VerbContext, command: Command, found: Sequence[Referent]) -> str:
        if not found:
            raise RefusedError(f"{command.verb} what? point at it, and say `{command.verb} that`")
        if found[0].name not in things:
            raise RefusedError(f"nothing is attached to `{command.verb}` of {site.room.label(found[0])}")
        return await do(site, command.verb, found[0])

    return Verb(act=act, things=things)
