"""People and things of a site as results of tools, found by name."""

import math
from collections.abc import Iterable

from pointit.api.feed import Feed
from pointit.api.site import Site
from pointit.assistants.results import MAX_ITEMS, Item, Items, People, Person, plain
from pointit.errors import PointItError
from pointit.runtime.config.nearest_name import nearest
from pointit.schemas import Environment
from pointit.schemas.base import Vec3

LAMP_REACH_M = 1.0
"""Distance up to which a lamp stands for a thing that has no light of its own, m."""
OWN_TRACKERS = ("things", "robot.")
"""Beginnings of trackers that list things of the map and robots."""


async def current(feed: Feed[frozenset[str]]) -> frozenset[str]:
    """Return the names of `feed` now, and close it."""
    try:
        return await anext(feed)
    finally:
        feed.close()


async def present(site: Site) -> frozenset[str]:
    """Return the names of the people who are present."""
    return await current(site.people())


async def check_present(site: Site, user: str) -> None:
    """Check that `user` is present.

    Raises:
        PointItError: If not. Says who is.
    """
    people = await present(site)
    if user not in people:
        raise PointItError(f"{user!r} is not there; present: {', '.join(sorted(people)) or 'nobody'}")


async def people(site: Site) -> People:
    """Return all people who are present."""
    steered = {state.user: robot for robot, state in site.latest.robot.items() if state.user}
    people: list[Person] = []
    for name in sorted(await present(site)):
        pose, interaction = site.latest.pose.get(name), site.latest.interaction.get(name)
        people.append(
            Person(
                name=name,
                state="unknown" if interaction is None else interaction.state,
                position_m=None if pose is None else pose.position_m,
                is_unsure=interaction is not None and interaction.is_unsure,
                steers=steered.get(name, ""),
            )
        )
    return People(people=tuple(people))


async def items(site: Site) -> Items:
    """Return the things, lamps and robots of the room, and the objects that trackers see."""
    room = await site.latest.map.wait()
    people = [*_of_map(site, room), *_moving(site, room)]
    return Items(items=tuple(people[:MAX_ITEMS]), left_out=max(0, len(people) - MAX_ITEMS))


async def find(site: Site, name: str, kind: str = "") -> Item:
    """Return the item of this `name`, by its name or else by its label; of `kind` only, if given.

    Raises:
        PointItError: If nothing is, or several are. Names what is similar.
    """
    every = [each for each in (await items(site)).items if kind in ("", each.kind)]
    wanted = plain(name).casefold()
    for matches in (
        [each for each in every if each.name == name],
        [each for each in every if wanted in (each.name.casefold(), each.label.casefold())],
    ):
        if len(matches) == 1:
            return matches[0]
        if matches:
            kinds = ", ".join(f"{each.kind} {each.name!r}" for each in matches[:4])
            raise PointItError(f"{plain(name)!r} may be {kinds}: use a name that only one has")
    known = [each.name for each in every]
    noun = f"no {kind}" if kind else "nothing"
    hint = nearest(name, known) if known else f"{noun} is there"
    raise PointItError(f"{noun} is called {plain(name)!r}; {hint}")


def _of_map(site: Site, room: Environment) -> Iterable[Item]:
    selection = site.latest.selection.get("")
    owners = {} if selection is None else {each.id: each.user for each in selection.objects}
    for thing in room.things:
        owner = owners.get(thing.id, "")
        place_m = None if thing.is_tracked else thing.center_m
        yield Item(
            name=thing.id,
            kind="thing",
            label=plain(thing.label),
            position_m=place_m,
            lamp=thing.lamp or _lamp_near(room, place_m),
            state=f"on, by {owner}" if owner else "",
        )
    feed = {thing.id for thing in room.things}
    for lamp in room.lamps:
        if lamp.id not in feed:
            yield Item(name=lamp.id, kind="lamp", position_m=lamp.position_m, lamp=lamp.id)


def _moving(site: Site, room: Environment) -> Iterable[Item]:
    for robot, state in sorted(site.latest.robot.items()):
        doing = f"{state.phase}, steered by {state.user}" if state.user else state.phase
        place_m = state.position_m
        lamp = _lamp_near(room, place_m)
        yield Item(name=robot, kind="robot", label=state.kind, position_m=place_m, lamp=lamp, state=doing)
    for tracker, message in sorted(site.latest.objects.items()):
        if tracker.startswith(OWN_TRACKERS):
            continue
        for each in message.objects:
            lamp = _lamp_near(room, each.position_m)
            yield Item(
                name=plain(each.id),
                kind="object",
                label=plain(each.kind),
                position_m=each.position_m,
                lamp=lamp,
            )


def _lamp_near(room: Environment, place_m: Vec3 | None) -> str:
    if place_m is None or not room.lamps:
        return ""
    away_m, lamp = min((math.dist(lamp.position_m, place_m), lamp.id) for lamp in room.lamps)
    return lamp if away_m <= LAMP_REACH_M else ""
