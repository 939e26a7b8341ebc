"""Results of tools: models, and names and texts of other people, cut and on one line."""

import json
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from pointit.schemas.base import Vec3
from pointit.schemas.text import hide_secrets

MAX_NAME = 64
"""Limit of characters of a label in a result. Names of people, lamps, things and robots are no longer."""
MAX_SENTENCE = 300
"""Limit of characters of a reason in a result."""
MAX_ITEMS = 300
"""Limit of things in a result."""


def plain(text: str, limit: int = MAX_NAME) -> str:
    """Return `text` on one line, without control and format characters, cut to `limit` characters.

    Anybody may have written labels, ids of objects and reasons. On one line and quoted as JSON, they cannot
    imitate the structure of a result.
    """
    line = " ".join("".join(each if each.isprintable() else " " for each in text).split())
    return line if len(line) <= limit else f"{line[: limit - 1]}…"


def refusal(text: str) -> str:
    """Return the reason of a refusal as quoted data."""
    return json.dumps({"refused": plain(hide_secrets(text), MAX_SENTENCE)}, ensure_ascii=False)


class _Result(BaseModel):
    model_config = ConfigDict(frozen=True)


class Person(_Result):
    """One person who is present."""

    name: str
    state: Annotated[str, Field(description="idle, localizing, pointing or unknown")] = "unknown"
    position_m: Annotated[Vec3 | None, Field(description="feet in the room; null if unknown")] = None
    is_unsure: Annotated[bool, Field(description="their direction has become uncertain")] = False
    steers: Annotated[str, Field(description="the robot that obeys them, or empty")] = ""


class People(_Result):
    """All people who are present."""

    people: tuple[Person, ...]


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
