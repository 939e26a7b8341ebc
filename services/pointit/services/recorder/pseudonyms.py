"""People's names in a recording, replaced by `person-1`, `person-2`, ... in keys and in all texts; pure."""

import functools
import json
import re
from pathlib import PurePath
from typing import Any, Literal, cast, get_args, get_origin

from pydantic import BaseModel

from pointit.recording.entries import Entry, entry
from pointit.schemas import Configuration, Deployment
from pointit.schemas.system import RUN
from pointit.schemas.topics import DEPLOYMENT, USER_ALIVE

SHORT = 3
"""Names of fewer characters, and mere numbers, are replaced only where `-` and `_` do not continue them."""

MAX_NAMES = 10_000
"""Most names that are learnt: anybody can send messages that have some."""


class Pseudonyms:
    """Learns names from keys and messages, and replaces them in those that are written later.

    A name is replaced wherever it is a word of a text, in upper or lower case: `anna` also in `Anna-laptop`.
    Numbers, names of fields and values of enumerations of messages stay. The parameters of services have no
    types here: if somebody is called like one, or like its value, such as `left`, it is replaced, too.
    """

    def __init__(self) -> None:
        self._numbers: dict[str, str] = {}
        self._folded: dict[str, str] = {}
        """Pseudonyms by the name in lower case, for other spellings of it."""
        self._pattern: re.Pattern[str] | None = None

    def learn(self, entry: Entry) -> None:
        """Store the names in `entry`: the user of its key, and the user in its body."""
        _, _, row, name, body = entry
        is_own = row.placeholder == "user" or row is USER_ALIVE
        if is_own or (row is DEPLOYMENT and not name.startswith(RUN)):
            self._learn(name)
        self._learn_in(body)
        if isinstance(body, Configuration):
            self._learn_in(_parsed(body.parameters))

    def replace(self, found: Entry) -> Entry:
        """Return an entry with pseudonyms for the known names, and without command lines of services."""
        time_ns, _, row, name, body = found
        if isinstance(body, Configuration):
            body = body.model_copy(update={"parameters": json.dumps(self._in(_parsed(body.parameters)))})
        elif isinstance(body, Deployment):
            services = tuple(each.model_copy(update={"command": ()}) for each in body.services)
            body = body.model_copy(update={"services": services})
        return entry(time_ns, row, self._in(name), self._in(body))

    def _learn_in(self, value: object) -> None:
        if isinstance(value, BaseModel):
            self._learn_in({name: getattr(value, name) for name in _text_fields(type(value))})
        elif isinstance(value, tuple | list):
            for each in cast("list[object]", value):
                self._learn_in(each)
        elif isinstance(value, dict):
            for field, each in cast("dict[str, object]", value).items():
                if field in ("user", "person") and isinstance(each, str):
                    self._learn(each)
                elif field == "places" and isinstance(each, dict):
                    for name in cast("dict[str, object]", each):
                        self._learn(name)
                else:
                    self._learn_in(each)

    def _learn(self, name: str) -> None:
        if not name or name in self._numbers or len(self._numbers) >= MAX_NAMES:
            return
        self._numbers[name] = f"person-{len(self._numbers) + 1}"
        self._folded.setdefault(name.lower(), self._numbers[name])
        names = sorted(self._numbers, key=len, reverse=True)
        self._pattern = re.compile("|".join(_as_word(each) for each in names), re.IGNORECASE)

    def _in(self, value: Any) -> Any:
        """Return `value` with its texts replaced."""
        if isinstance(value, BaseModel):
            fields = {name: self._in(getattr(value, name)) for name in _text_fields(type(value))}
            return value.model_copy(update=fields) if fields else value
        if type(value) is str:
            return value if self._pattern is None else self._pattern.sub(self._number, value)
        if isinstance(value, PurePath):
            return type(value)(self._in(str(value)))
        if type(value) in (tuple, list, set, frozenset):
            return type(value)(self._in(each) for each in value)
        if isinstance(value, dict):
            items = cast("dict[object, object]", value).items()
            return {self._in(name): self._in(each) for name, each in items}
        return value

    def _number(self, match: re.Match[str]) -> str:
        return self._numbers.get(match[0]) or self._folded[match[0].lower()]


def _as_word(name: str) -> str:
    """Return the pattern of `name` as a word; a number is none within another number."""
    if len(name) < SHORT or name.isdecimal():
        return rf"(?<![\w-])(?<!\d\.){re.escape(name)}(?![\w-])(?!\.\d)"
    return rf"(?<![^\W_]){re.escape(name)}(?![^\W_])"


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


@functools.cache
def _text_fields(kind: type[BaseModel]) -> tuple[str, ...]:
    """Return the fields of `kind` that can hold a text that anybody may choose."""
    return tuple(name for name, field in kind.model_fields.items() if _has_text(field.annotation))


def _has_text(annotation: Any) -> bool:
    if isinstance(annotation, type) and not get_args(annotation):
        if issubclass(annotation, BaseModel):
            return bool(_text_fields(annotation))
        return annotation is str or issubclass(annotation, PurePath)
    if annotation is Any:
        return True
    if get_origin(annotation) is Literal:
        return False
    return any(_has_text(each) for each in get_args(annotation))
