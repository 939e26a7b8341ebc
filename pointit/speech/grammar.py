"""The grammar of spoken commands: words to a command with what it is about, by the names in the room."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from pointit.geometry.vector import Vec3
from pointit.schemas import Environment, Referent, Thing
from pointit.schemas.person import Deictic, Word
from pointit.schemas.system import split_instance
from pointit.schemas.topics import MAP, OBJECTS, ROBOT_STATE, STOP_ROBOT
from pointit.site.site_state import SiteState

Answer = Literal["yes", "no"]
Names: TypeAlias = Mapping[tuple[str, ...], str]
"""Names of things, robots and objects by the words in which they are spoken."""

_VERBS: Mapping[str, str] = {
    "take": "take", "pick": "take", "get": "take", "put": "put", "move": "put", "bring": "put",
    "send": "send", "go": "send", "drive": "send", "what": "what", "stop": "stop", "halt": "stop",
}  # fmt: skip
_DEICTIC: Mapping[str, Deictic] = {
    "this": "this", "that": "that", "here": "here", "there": "there", "these": "these", "those": "these",
}  # fmt: skip
_SWITCH = {"turn", "switch"}
_SMALL = {"on", "off", "the", "is", "one", "robot"}
YES = {"yes", "yeah", "okay"}
NO = {"no", "wrong", "neither"}
_ARTICLES = {"the", "a", "an", "my", "our"}
_PREPOSITIONS = {"to", "at", "in", "into", "onto", "over", "near", "by", "from", "with", "beside", "under"}
_FILLERS = {"it", "them", "him", "her", "me", "please", "now", "right", "just", "up", "down", "back", "and"}
_WITHOUT_OBJECT = {"go", "drive", "what"}
RESERVED = frozenset({*_VERBS, *_DEICTIC, *_SWITCH, *_SMALL, *YES, *NO})
"""Words of all rooms, which no thing's verb may be."""
PLACES: frozenset[Deictic] = frozenset(("here", "there"))
DIGITS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"]
MAX_NAMES = 200
"""Largest number of names in a grammar."""

BAY = "bay"
"""Word before the name of a bay."""


@dataclass(frozen=True, kw_only=True)
class Mention:
    """A part of a command that refers to something: by a deictic word, or by a name."""

    word: Deictic = ""
    at_ns: int = 0
    """Middle of the deictic word."""
    name: str = ""
    """The name, or empty for a deictic word."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """Verb with the things and places that it is about."""

    verb: str
    about: Mention | None = None
    """Object of the verb, or None if there is none."""
    to: Mention | None = None
    """Destination, or None if there is none."""
    unknown_name: str = ""
    """Words in the place of the object that name nothing in the room, or `""`."""

    @property
    def mentions(self) -> tuple[Mention, ...]:
        """Return all that it mentions, in order."""
        return tuple(each for each in (self.about, self.to) if each is not None)


@dataclass(frozen=True, kw_only=True)
class Vocabulary:
    """Words that are said in a room besides those of the grammar. They are data."""

    names: Names
    verbs: Sequence[str] = ()
    """Verbs that its things have besides those of all rooms, each one word."""

    @property
    def words(self) -> set[str]:
        """Return all words of commands, for recognisers that take a list."""
        names = {word for name in self.names for word in name}
        return {*_VERBS, *_DEICTIC, *_SWITCH, *_SMALL, *self.verbs, *YES, *NO, *names}

    def jsgf(self, known: Iterable[str] | None = None) -> str:
        """Return the grammar as JSGF, without names and verbs that have a word that is not `known`.

        Names are data: only letters and apostrophes of them stand in the text.
        """
        words = None if known is None else set(known)
        lines = sorted(" ".join(each) for each in self.names if words is None or words.issuperset(each))
        named = f" | [ the ] ( {' | '.join(lines)} )" if lines else ""
        verbs = " | ".join(["take", "pick", *(each for each in self.verbs if words is None or each in words)])
        return f"""#JSGF V1.0;
grammar pointit;
<thing> = this [ one ] | that [ one ] | these | those | the robot{named};
<place> = here | there;
<switch> = ( turn | switch ) ( <thing> ( on | off ) | ( on | off ) <thing> );
<move> = ( put | move | bring | send ) <thing> <place> | go <place>;
<rest> = ( {verbs} ) <thing> | what is <thing> | stop | yes | no;
public <command> = <switch> | <move> | <rest>;
"""


def spoken(name: str) -> tuple[str, ...]:
    """Return the words in which `name` is spoken: `led_1` is `led one`. Empty if there are none."""
    parts: list[str] = re.findall(r"[a-z']+|[0-9]", name.lower())
    return tuple(DIGITS[int(part)] if part.isdigit() else part for part in parts)


def names_of(names: Iterable[str]) -> Names:
    """Return `names` by their spoken words; the first one of two that sound alike."""
    found: dict[tuple[str, ...], str] = {}
    for name in names:
        if (words := spoken(name)) and len(found) < MAX_NAMES:
            found.setdefault(words, name)
    return found


def answer(words: Sequence[Word]) -> tuple[Answer, int] | None:
    """Return the answer that the words give, and the time of its onset, ns. None if they give none."""
    answers: tuple[tuple[Answer, set[str]], ...] = (("no", NO), ("yes", YES))
    for said, meaning in answers:
        for word in words:
            if _text(word) in meaning:
                return said, word.start_ns
    return None


def parse(words: Sequence[Word], vocabulary: Vocabulary) -> Command | None:
    """Return the command in `words`, or None if there is none. Words that mean nothing here are skipped."""
    names = vocabulary.names
    texts = [_text(word) for word in words]
    verb, begin = _verb(texts, vocabulary.verbs)
    if verb is None:
        return None
    objects: list[Mention] = []
    places: list[Mention] = []
    known = set[int]()
    """Indices of the words of mentions."""
    index = 0
    while index < len(texts):
        name, length = _name_at(texts, index, names)
        if length:
            objects.append(Mention(name=name))
        elif (word := _DEICTIC.get(texts[index])) is not None:
            mention = Mention(word=word, at_ns=(words[index].start_ns + words[index].end_ns) // 2)
            (places if word in PLACES else objects).append(mention)
            length = 1
        known.update(range(index, index + length))
        index += max(length, 1)
    unknown_name = "" if objects else _unknown_name(texts, known, begin)
    if verb == "stop":  # of a robot by its name or of all: stopping waits for no doubt
        return Command(verb=verb, about=next((each for each in objects if each.name), None))
    if verb in ("put", "send"):
        to = places[-1] if places else objects[1] if len(objects) > 1 else None
        about = objects[0] if objects else None
        return Command(verb=verb, about=about, to=to, unknown_name=unknown_name)
    about = next(iter([*objects, *places]), None)
    return Command(verb=verb, about=about, unknown_name=unknown_name)


def _text(word: Word) -> str:
    return word.text.lower().strip(".,;:!?")  # some recognisers write sentences


def _verb(texts: Sequence[str], own: Iterable[str]) -> tuple[str | None, int]:
    """Return the verb, or None if there is none, and the index of its first word."""
    if any(text in ("stop", "halt") for text in texts):
        return "stop", 0
    for index, text in enumerate(texts):
        if text in _SWITCH:
            rest = texts[index + 1 :]
            return "on" if "on" in rest else "off" if "off" in rest else None, index
        if text in own:
            return text, index
        if (verb := _VERBS.get(text)) is not None:
            return verb, index
    return None, 0


def _unknown_name(texts: Sequence[str], known: Collection[int], begin: int) -> str:
    """Return the words that stand where the object of the verb at `begin` would, and name nothing, or `""`.

    Behind a preposition is a destination. Without an article only a verb that needs an object has one.
    """
    kinds = "".join("m" if at in known else _kind(text) for at, text in enumerate(texts))[begin + 1 :]
    needs_object = texts[begin] not in _WITHOUT_OBJECT
    found = re.search(r"(?<!p)a(u+)|^f*(u+)" if needs_object else r"(?<!p)a(u+)", kinds)
    if found is None:
        return ""
    first, end = found.span(found.lastindex or 1)
    return " ".join(texts[begin + 1 + first : begin + 1 + end])


def _kind(text: str) -> str:
    """Return the kind of a word: article, preposition, filler or unknown."""
    if text in _ARTICLES:
        return "a"
    return "p" if text in _PREPOSITIONS else "f" if text in RESERVED | _FILLERS else "u"


def _name_at(texts: Sequence[str], index: int, names: Names) -> tuple[str, int]:
    """Return the name spoken at `index` and the number of its words, the longest one; 0: none."""
    for length in range(min(8, len(texts) - index), 0, -1):
        if (name := names.get(tuple(texts[index : index + length]))) is not None:
            return name, length
    return "", 0


@dataclass
class SpokenRoom:
    """The newest that is known of the room, for commands."""

    site: SiteState = field(default_factory=SiteState)

    def __post_init__(self) -> None:
        self.robots = self.site.all(ROBOT_STATE)
        self.objects = self.site.all(OBJECTS)

    @property
    def map(self) -> Environment | None:
        """Return the room, as soon as it is known."""
        return self.site.get(MAP)

    @property
    def present_robots(self) -> set[str]:
        """Return the robots whose service runs, also those that have not told their state."""
        services = map(split_instance, self.site.services)
        return {name or service for service, name in services if service == STOP_ROBOT.server}

    @property
    def names(self) -> Names:
        """Return the names of things, robots and objects by their spoken words; labels count, too."""
        found = dict(names_of([*(thing.id for thing in self.things), *sorted(self.robots)]))
        for thing in self.things:
            for words in names_of([thing.label]):
                found.setdefault(words, thing.id)
        for bay in self.bays:
            found.setdefault(("bay", *spoken(bay)), f"{BAY} {bay}")
        return found

    @property
    def bays(self) -> dict[str, Vec3]:
        """Return the bays by name with the ends of their belts, {W}, m."""
        if self.map is None:
            return {}
        ends_m = {belt.id: belt.line_m[-1] for belt in self.map.belts}
        return {bay.id: ends_m[bay.belt] for bay in self.map.bays if bay.belt in ends_m}

    @property
    def things(self) -> Sequence[Thing]:
        """Return the things of the map."""
        return () if self.map is None else self.map.things

    @property
    def switches(self) -> list[str]:
        """Return the things that are on or off."""
        return [thing.id for thing in self.things if thing.mode == "switch"]

    def thing(self, name: str) -> Thing | None:
        """Return the thing called `name`, or None if there is none."""
        return next((each for each in self.things if each.id == name), None)

    def named(self, name: str) -> Referent:
        """Return the thing, robot or object called `name`."""
        if name in self.robots:
            return Referent(kind="robot", name=name, probability=1.0, place_m=self.robots[name].position_m)
        if (thing := self.thing(name)) is not None:
            return Referent(kind="thing", name=name, probability=1.0, place_m=thing.center_m)
        bay_m = self.bays.get(name.removeprefix(f"{BAY} "))
        return Referent(
            kind="object" if bay_m is None else "place", name=name, probability=1.0, place_m=bay_m
        )

    def label(self, one: Referent) -> str:
        """Return its name for people: its label in the map, or its own name."""
        thing = self.thing(one.name)
        return one.name if thing is None else thing.label or one.name

    def lamp(self, one: Referent) -> str:
        """Return the single lamp that shows the thing, or empty."""
        thing = self.thing(one.name) if one.kind == "thing" else None
        return "" if thing is None else thing.lamp

    def robots_of(self, user: str) -> Sequence[str]:
        """Return the robots that `user` steers."""
        return [name for name, state in sorted(self.robots.items()) if state.user == user]
