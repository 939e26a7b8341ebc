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

UNKNOWN_OBJECT = re.compile(r"(?<!p)a(u+)")
"""Unknown words behind an article and before no preposition, among the letters of `_kind`."""
UNKNOWN_NEEDED_OBJECT = re.compile(rf"{UNKNOWN_OBJECT.pattern}|^f*(u+)")
"""The same, or unknown words behind the verb and fillers."""

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
        return tuple(mention for mention in (self.about, self.to) if mention is not None)


@dataclass(frozen=True, kw_only=True)
class Vocabulary:
    """Words that are said in a room besides those of the grammar. They are data."""

    names: Names
    verbs: Sequence[str] = ()
    """Verbs that its things have besides those of all rooms, each one word."""

    @property
    def words(self) -> set[str]:
        """Return all words of commands, for recognisers that take a list."""
        names = set[str]().union(*self.names)
        return {*_VERBS, *_DEICTIC, *_SWITCH, *_SMALL, *self.verbs, *YES, *NO, *names}

    def jsgf(self, known: Iterable[str] | None = None) -> str:
        """Return the grammar as JSGF, without names and verbs that have a word that is not `known`.

        Names are data: only letters and apostrophes of them stand in the text.
        """
        names = list(self.names)
        own_verbs = list(self.verbs)
        if known is not None:
            known_words = set(known)
            names = [name for name in names if known_words.issuperset(name)]
            own_verbs = [verb for verb in own_verbs if verb in known_words]
        lines = sorted(" ".join(name) for name in names)
        named = f" | [ the ] ( {' | '.join(lines)} )" if lines else ""
        verbs = " | ".join(["take", "pick", *own_verbs])
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
    by_words: dict[tuple[str, ...], str] = {}
    for name in names:
        words = spoken(name)
        if words and len(by_words) < MAX_NAMES:
            by_words.setdefault(words, name)
    return by_words


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
    texts = [_text(word) for word in words]
    verb, verb_index = _verb(texts, vocabulary.verbs)
    if verb is None:
        return None
    mentions = _mentions(words, texts, vocabulary.names)
    objects = mentions.objects
    places = mentions.places

    # A robot is stopped by its name, or all are: stopping waits for no doubt.
    if verb == "stop":
        named = [mention for mention in objects if mention.name]
        return Command(verb=verb, about=named[0] if named else None)

    unknown_name = "" if objects else _unknown_name(texts, mentions.indices, verb_index)
    if verb in ("put", "send"):
        to = objects[1] if len(objects) > 1 else None
        if places:
            to = places[-1]
        about = objects[0] if objects else None
        return Command(verb=verb, about=about, to=to, unknown_name=unknown_name)
    about = next(iter([*objects, *places]), None)
    return Command(verb=verb, about=about, unknown_name=unknown_name)


@dataclass(kw_only=True)
class _Mentions:
    """Things and places that an utterance refers to, in order."""

    objects: list[Mention] = field(default_factory=list[Mention])
    places: list[Mention] = field(default_factory=list[Mention])
    indices: set[int] = field(default_factory=set[int])
    """Indices of their words."""


def _mentions(words: Sequence[Word], texts: Sequence[str], names: Names) -> _Mentions:
    """Return the things and places that are named, or pointed at with a deictic word."""
    mentions = _Mentions()
    index = 0
    while index < len(texts):
        name, length = _name_at(texts, index, names)
        deictic = _DEICTIC.get(texts[index])
        if length:
            mentions.objects.append(Mention(name=name))
        elif deictic is not None:
            middle_ns = (words[index].start_ns + words[index].end_ns) // 2
            mention = Mention(word=deictic, at_ns=middle_ns)
            if deictic in PLACES:
                mentions.places.append(mention)
            else:
                mentions.objects.append(mention)
            length = 1
        mentions.indices.update(range(index, index + length))
        index += max(length, 1)
    return mentions


def _text(word: Word) -> str:
    return word.text.lower().strip(".,;:!?")  # some recognisers write sentences


def _verb(texts: Sequence[str], own: Iterable[str]) -> tuple[str | None, int]:
    """Return the verb, or None if there is none, and the index of its first word."""
    if any(text in ("stop", "halt") for text in texts):
        return "stop", 0
    for index, text in enumerate(texts):
        if text in _SWITCH:
            rest = texts[index + 1 :]
            for verb in ("on", "off"):
                if verb in rest:
                    return verb, index
            return None, index
        if text in own:
            return text, index
        if text in _VERBS:
            return _VERBS[text], index
    return None, 0


def _unknown_name(texts: Sequence[str], known: Collection[int], begin: int) -> str:
    """Return the words that stand where the object of the verb at `begin` would, and name nothing, or `""`.

    Behind a preposition is a destination. Without an article only a verb that needs an object has one.
    """
    behind = begin + 1
    # One letter a word behind the verb: m of a mention, else as `_kind` says.
    kinds = ""
    for index in range(behind, len(texts)):
        kinds += "m" if index in known else _kind(texts[index])
    pattern = UNKNOWN_OBJECT if texts[begin] in _WITHOUT_OBJECT else UNKNOWN_NEEDED_OBJECT
    match = pattern.search(kinds)
    if match is None:
        return ""
    first, end = match.span(match.lastindex or 1)
    return " ".join(texts[behind + first : behind + end])


def _kind(text: str) -> str:
    """Return the kind of a word: `a`rticle, `p`reposition, `f`iller or `u`nknown."""
    if text in _ARTICLES:
        return "a"
    if text in _PREPOSITIONS:
        return "p"
    return "f" if text in RESERVED | _FILLERS else "u"


def _name_at(texts: Sequence[str], index: int, names: Names) -> tuple[str, int]:
    """Return the name spoken at `index` and the number of its words, the longest one; 0: none."""
    for length in range(min(8, len(texts) - index), 0, -1):
        name = names.get(tuple(texts[index : index + length]))
        if name is not None:
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
        robots: set[str] = set()
        for service, name in map(split_instance, self.site.services):
            if service == STOP_ROBOT.server:
                robots.add(name or service)
        return robots

    @property
    def names(self) -> Names:
        """Return the names of things, robots and objects by their spoken words; labels count, too."""
        things = [thing.id for thing in self.things]
        names = dict(names_of([*things, *sorted(self.robots)]))
        for thing in self.things:
            for words in names_of([thing.label]):
                names.setdefault(words, thing.id)
        for bay in self.bays:
            names.setdefault((BAY, *spoken(bay)), f"{BAY} {bay}")
        return names

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
        return next((thing for thing in self.things if thing.id == name), None)

    def named(self, name: str) -> Referent:
        """Return the thing, robot or object called `name`."""
        if name in self.robots:
            return Referent(kind="robot", name=name, probability=1.0, place_m=self.robots[name].position_m)
        thing = self.thing(name)
        if thing is not None:
            return Referent(kind="thing", name=name, probability=1.0, place_m=thing.center_m)
        bay_m = self.bays.get(name.removeprefix(f"{BAY} "))
        kind = "object" if bay_m is None else "place"
        return Referent(kind=kind, name=name, probability=1.0, place_m=bay_m)

    def label(self, referent: Referent) -> str:
        """Return its name for people: its label in the map, or its own name."""
        thing = self.thing(referent.name)
        if thing is None or not thing.label:
            return referent.name
        return thing.label

    def lamp(self, referent: Referent) -> str:
        """Return the single lamp that shows the thing, or `""` if there is none."""
        if referent.kind != "thing":
            return ""
        thing = self.thing(referent.name)
        return "" if thing is None else thing.lamp

    def robots_of(self, user: str) -> Sequence[str]:
        """Return the robots that `user` steers."""
        return [name for name, state in sorted(self.robots.items()) if state.user == user]
