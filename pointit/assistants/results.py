"""Results of tools: models, people and things by name, texts of other people on one line."""

import json
import math
from collections.abc import Iterable
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from pointit.api.feed import Feed
from pointit.api.site import Site
from pointit.errors import PointItError
from pointit.runtime.config.nearest_name import nearest
from pointit.schemas import Environment
from pointit.schemas.base import Vec3
from pointit.schemas.printable import plain as plain_text
from pointit.schemas.text import hide_secrets

MAX_NAME = 64
"""Limit of characters of a label in a result. Names of people, lamps, things and robots are no longer."""
MAX_SENTENCE = 300
"""Limit of characters of a reason in a result."""
MAX_ITEMS = 300
"""Limit of things in a result."""

LAMP_REACH_M = 1.0
"""Distance up to which a lamp stands for a thing that has no light of its own, m."""
OWN_TRACKERS = ("things", "robot.")
"""Beginnings of trackers that list things of the map and robots."""


def plain(text: str, limit: int = MAX_NAME) -> str:
    """Return `text` on one line, without control and format characters, cut to `limit` characters.

    Anybody may have written labels, ids of objects and reasons. On one line and quoted as JSON, they cannot
    imitate the structure of a result.
    """
    line = " ".join(plain_text(text, " ").split())
    if len(line) <= limit:
        return line
    return f"{line[: limit - 1]}…"


def refusal(text: str) -> str:
    """Return the reason of a refusal as quoted data."""
    return json.dumps({"refused": plain(hide_secrets(text), MAX_SENTENCE)}, ensure_ascii=False)


class _Result(BaseModel):
    model_config = ConfigDict(frozen=True)


class PresentPerson(_Result):
    """One person who is present."""

    name: str
    state: Annotated[str, Field(description="idle, localizing, pointing or unknown")] = "unknown"
    position_m: Annotated[Vec3 | None, Field(description="feet in the room; null if unknown")] = None
    is_unsure: Annotated[bool, Field(description="their direction has become uncertain")] = False
    steers: Annotated[str, Field(description="the robot that obeys them, or empty")] = ""


class PresentPeople(_Result):
    """All people who are present."""

    people: tuple[PresentPerson, ...]


class Item(_Result):
    """Something in the room that has a name."""

    name: str
    kind: Annotated[str, Field(description="thing, lamp, robot or object")]
    label: Annotated[str, Field(description="spoken name, if it differs from the name")] = ""
    position_m: Vec3 | None = None
    lamp: Annotated[str, Field(description="the lamp that `light` uses for it, or empty")] = ""
    state: Annotated[str, Field(description="of a robot its phase, of a thing who has it; or empty")] = ""


class Items(_Result):
    """Things, lamps, robots and objects of the room."""

    items: tuple[Item, ...]
    left_out: Annotated[int, Field(description="further ones, left out for their number")] = 0


class PossibleReferent(_Result):
    """Something that may be meant."""

    kind: Annotated[str, Field(description="thing, robot, object, person, place or direction")]
    name: str
    probability: float
    position_m: Vec3 | None = None


class PossibleReferents(_Result):
    """Candidates for what a person points or pointed at. The probabilities, with `none`, add up to 1."""

    user: str
    seconds_ago: float
    candidates: Annotated[tuple[PossibleReferent, ...], Field(description="the most probable first")] = ()
    none: Annotated[float, Field(description="probability of none of these")] = 1.0
    note: Annotated[str, Field(description="problem of the data, or empty")] = ""


class Waited(_Result):
    """Result of waiting for a person to point."""

    came: Annotated[bool, Field(description="false: not within the timeout")]
    pointed: Annotated[PossibleReferents | None, Field(description="the last that was seen")] = None


class AnswerByLight(_Result):
    """Result of a question by light."""

    chosen: Annotated[str, Field(description="the candidate for which they pressed, or empty")]
    shown: Annotated[dict[str, str], Field(description="colour in which each candidate was lit")]


class ActionResult(_Result):
    """Something was done."""

    message: str


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
    names = await present(site)
    if user not in names:
        shown = ", ".join(sorted(names)) or "nobody"
        raise PointItError(f"{user!r} is not there; present: {shown}")


async def people(site: Site) -> PresentPeople:
    """Return all people who are present."""
    robots = {state.user: robot for robot, state in site.latest.robot.items() if state.user}
    people: list[PresentPerson] = []
    for name in sorted(await present(site)):
        pose = site.latest.pose.get(name)
        interaction = site.latest.interaction.get(name)
        state = "unknown"
        is_unsure = False
        if interaction is not None:
            state = interaction.state
            is_unsure = interaction.is_unsure
        people.append(
            PresentPerson(
                name=name,
                state=state,
                position_m=None if pose is None else pose.position_m,
                is_unsure=is_unsure,
                steers=robots.get(name, ""),
            )
        )
    return PresentPeople(people=tuple(people))


async def items(site: Site) -> Items:
    """Return the things, lamps and robots of the room, and the objects that trackers see."""
    room = await site.latest.map.wait()
    all_items = [*_map_items(site, room), *_moving_items(site, room)]
    left_out = max(0, len(all_items) - MAX_ITEMS)
    return Items(items=tuple(all_items[:MAX_ITEMS]), left_out=left_out)


async def find(site: Site, name: str, kind: str = "") -> Item:
    """Return the item of this `name`, by its name or else by its label; of `kind` only, if given.

    Raises:
        PointItError: If nothing is, or several are. Names what is similar.
    """
    room_items = await items(site)
    candidates = [item for item in room_items.items if kind in ("", item.kind)]

    # The exact name first: another item may have it as its label
    matches = [item for item in candidates if item.name == name]
    if not matches:
        folded = plain(name).casefold()
        matches = [item for item in candidates if folded in (item.name.casefold(), item.label.casefold())]
    if len(matches) == 1:
        return matches[0]
    if matches:
        kinds = ", ".join(f"{item.kind} {item.name!r}" for item in matches[:4])
        raise PointItError(f"{plain(name)!r} may be {kinds}: use a name that only one has")

    noun = f"no {kind}" if kind else "nothing"
    hint = f"{noun} is there"
    if candidates:
        hint = nearest(name, [item.name for item in candidates])
    raise PointItError(f"{noun} is called {plain(name)!r}; {hint}")


def _map_items(site: Site, room: Environment) -> Iterable[Item]:
    owners: dict[str, str] = {}
    under_way: frozenset[str] = frozenset()
    selection = site.latest.selection.get("")
    if selection is not None:
        owners = {selected.id: selected.user for selected in selection.settled}
        under_way = selection.under_way
    for thing in room.things:
        owner = owners.get(thing.id, "")
        state = f"on, by {owner}" if owner else ""
        if thing.id in under_way:
            state = "under way: its result is not told yet"
        position_m = None if thing.is_tracked else thing.center_m
        lamp_id = thing.lamp or _lamp_near(room, position_m)
        yield Item(
            name=thing.id,
            kind="thing",
            label=plain(thing.label),
            position_m=position_m,
            lamp=lamp_id,
            state=state,
        )

    # Lamps that are no things themselves
    things = {thing.id for thing in room.things}
    for lamp in room.lamps:
        if lamp.id not in things:
            yield Item(name=lamp.id, kind="lamp", position_m=lamp.position_m, lamp=lamp.id)


def _moving_items(site: Site, room: Environment) -> Iterable[Item]:
    for robot, state in sorted(site.latest.robot.items()):
        activity = state.phase
        if state.user:
            activity = f"{state.phase}, steered by {state.user}"
        yield Item(
            name=robot,
            kind="robot",
            label=state.kind,
            position_m=state.position_m,
            lamp=_lamp_near(room, state.position_m),
            state=activity,
        )
    for tracker, message in sorted(site.latest.objects.items()):
        if tracker.startswith(OWN_TRACKERS):
            continue
        for tracked_object in message.objects:
            position_m = tracked_object.position_m
            yield Item(
                name=plain(tracked_object.id),
                kind="object",
                label=plain(tracked_object.kind),
                position_m=position_m,
                lamp=_lamp_near(room, position_m),
            )


def _lamp_near(room: Environment, position_m: Vec3 | None) -> str:
    """Return the nearest lamp, or `""` if none is within reach."""
    if position_m is None or not room.lamps:
        return ""
    distances = [(math.dist(lamp.position_m, position_m), lamp.id) for lamp in room.lamps]
    distance_m, lamp_id = min(distances)
    return lamp_id if distance_m <= LAMP_REACH_M else ""
