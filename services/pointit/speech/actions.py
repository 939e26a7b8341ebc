"""Actions of verbs: requests to things and robots, with the checks that pointing has."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import RefusedError
from pointit.schemas import Referent, SendRobot, SetThing, StopRobot
from pointit.schemas.topics import SEND_ROBOT, SET_THING, STOP_ROBOT
from pointit.speech.grammar import Command, Verb
from pointit.speech.room import SpokenRoom


@dataclass(frozen=True)
class Site:
    """Bus, person and room for an action."""

    bus: Bus
    user: str
    """The person who speaks."""
    room: SpokenRoom


Action: TypeAlias = Callable[[Site, Command, Sequence[Referent]], Awaitable[str]]
"""Does a command. The referents are those of its mentions, in order. Returns what was done, in a sentence.

Raises:
    RequestError: If a service refuses, with the reason.
"""


async def _take(site: Site, command: Command, found: Sequence[Referent]) -> str:
    """Fire the thing, as if the person had pointed at it."""
    if not found:
        raise RefusedError("take what? point at it, and say `take that`")
    if found[0].kind != "thing":
        raise RefusedError(f"{found[0].name} is no thing of the map: nothing is attached to taking it")
    on = {"on": True, "off": False}.get(command.verb)
    return (await site.bus.call(SET_THING, SetThing(thing=found[0].name, on=on), site.user)).message


async def _send(site: Site, command: Command, found: Sequence[Referent]) -> str:
    """Send a robot to a place, by the person's service `goal`, which checks it as a place pointed at."""
    if command.to is None:
        raise RefusedError("where to? say `there` while you point at the place")
    place, about = found[-1], found[0] if command.about is not None else None
    if about is not None and about.kind != "robot":
        raise RefusedError(f"{about.name} is no robot, and nothing is attached to moving it")
    robot = about.name if about is not None else next(iter(site.room.robots_of(site.user)), "")
    if not robot and len(site.room.robots) == 1:
        robot = next(iter(site.room.robots))
    if place.place_m is None:
        raise RefusedError(f"the place of {place.name or 'that'} is not known")
    query = SendRobot(position_m=place.place_m, robot=robot)
    return (await site.bus.call(SEND_ROBOT, query, site.user)).message


async def _what(site: Site, _command: Command, found: Sequence[Referent]) -> str:
    """Say what it is."""
    if not found:
        raise RefusedError("what is what? point at it, and say `what is this`")
    one = found[0]
    return f"{one.kind} {site.room.label(one)}, sure by {one.probability:.0%}"


async def _stop(site: Site, _command: Command, found: Sequence[Referent]) -> str:
    """Stop the robot that is meant, those of the person, or all."""
    robots = [one.name for one in found] or site.room.robots_of(site.user) or sorted(site.room.robots)
    if not robots:
        raise RefusedError("there is no robot to stop")
    for robot in robots:
        await site.bus.call(STOP_ROBOT, StopRobot(reason=f"{site.user} said stop"), robot)
    return f"{', '.join(robots)} stopped"


ACTIONS: Mapping[Verb, Action] = {
    "take": _take,
    "on": _take,
    "off": _take,
    "put": _send,
    "send": _send,
    "what": _what,
    "stop": _stop,
}
"""Actions by verb."""
