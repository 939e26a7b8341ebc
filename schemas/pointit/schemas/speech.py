"""Speech as the context of pointing: words with their times, what they refer to, and what was understood."""

from typing import Annotated, Literal

from pydantic import Field

from pointit.schemas.base import Fraction, Id, Many, Message, Ns, SchemaModel, Vec3

MAX_WORDS = 64
"""Limit of words of one message, and of deictic words of one request."""

ReferentKind = Literal["thing", "robot", "object", "person", "place", "direction"]
"""What a word may refer to: a thing of the map, a robot, another tracked object, a person, a place on a
surface, or only a direction."""

Deictic = Literal["", "this", "that", "here", "there", "these"]
"""Word that refers by pointing, or `""` for any. `this` and `these` stand for what is nearer, `here` for the
speaker's own place too, `these` for all that is swept over."""


class Word(SchemaModel):
    """One spoken word."""

    text: Annotated[str, Field(min_length=1, max_length=64)]
    start_ns: Annotated[Ns, Field(description="its onset, Unix ns of the site's time")]
    end_ns: Ns
    confidence: Annotated[Fraction | None, Field(description="of the recogniser; None if unknown")] = None


class Speech(Message):
    """Words of one utterance of a person. `stamp_ns`: end of the last word, or the time of an empty one."""

    words: Annotated[tuple[Word, ...], Field(max_length=MAX_WORDS)] = ()
    is_final: Annotated[
        bool, Field(description="false: the recogniser may still change them; nothing is done yet")
    ] = True
    recogniser: Annotated[Id, Field(description="name of what recognised them")] = ""


class Referent(SchemaModel):
    """Something that a word may refer to."""

    kind: ReferentKind
    name: Annotated[Id, Field(description="of the thing, robot, object or person; of a place its surface")]
    probability: Fraction
    place_m: Annotated[Vec3 | None, Field(description="where it is, {W}; None of a direction")] = None


class Understood(Message):
    """What was understood of an utterance, and what came of it. `stamp_ns`: that of the speech."""

    text: Annotated[str, Field(max_length=4096, description="the words")]
    command: Annotated[Id, Field(description="verb of the command, or empty if it is none")] = ""
    referents: Annotated[Many[Referent], Field(description="of its words, in their order")] = ()
    result: Literal["done", "asked", "refused", "ignored"]
    message: Annotated[str, Field(description="result, in one sentence for a person")] = ""
