"""Messages that are read field by field: what cannot be understood is left out, and reported by name."""

import datetime as dt
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import (
    AfterValidator,
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    StringConstraints,
    ValidationError,
    model_validator,
)
from pydantic.alias_generators import to_camel

COUNTS = 1 << 32
"""Number of different values of a counter."""
MAX_ERRORS = 1000
"""Maximum number of errors of a message of which the rest is used."""
MAX_ROUNDS = 8
"""Maximum number of times that a message is read: parts are nested less deeply."""
MAX_SHOWN = 40
"""Maximum number of characters of a value in a sentence."""
MAX_NAMES = 4
"""Maximum number of fields in a sentence."""

Json = dict[str, Any] | list[Any] | str | float | None
"""Decoded JSON."""


def _word(value: object) -> str:
    """Return a value of an enumeration in the spelling of version 2: `Auto_Ack` is AUTOACK."""
    if not isinstance(value, str | int | float):
        raise ValueError("is no word")  # noqa: TRY004 - pydantic takes ValueError
    return "".join(each for each in str(value).upper() if each.isalnum())[:MAX_SHOWN]


def _time(value: object) -> object:
    """Return the time of an ISO 8601 timestamp, Unix s, and numbers as they are."""
    if not isinstance(value, str):
        return value
    text = value.strip()
    try:
        return float(text) if text else None
    except ValueError:
        time = dt.datetime.fromisoformat(text)
        return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()


def _seconds(value: float) -> float:
    """Return the s of a time in s, ms, µs or ns."""
    for _ in range(3):
        value = value / 1000.0 if value > 1e11 else value
    return value


def _items(value: object) -> object:
    """Return a list. Lua writes an empty one as an empty object."""
    return [] if value == {} else value


Text = Annotated[str, StringConstraints(max_length=500)]
Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Count = Annotated[int, Field(ge=0, lt=COUNTS)]
Seconds = Annotated[Annotated[float, AfterValidator(_seconds)] | None, BeforeValidator(_time)]
Word = Annotated[str, BeforeValidator(_word)]
"""Value of an enumeration. Unknown ones are kept, for the caller to decide about."""
Items = BeforeValidator(_items)


class TolerantModel(BaseModel):
    """A message, or a part of one, that `read_tolerantly` makes."""

    model_config = ConfigDict(
        frozen=True,
        extra="ignore",
        allow_inf_nan=False,
        alias_generator=to_camel,
        populate_by_name=True,
        coerce_numbers_to_str=True,
    )

    NEEDED: ClassVar[tuple[str, ...]] = ()
    """Fields that are reported if they are missing, since there is no value to assume."""
    KNOWN_WORDS: ClassVar[Mapping[str, frozenset[str]]] = {}
    """Fields of type `Word` of which other values are reported."""

    _unreadable: dict[str, str] = PrivateAttr(default_factory=dict[str, str])

    @model_validator(mode="before")
    @classmethod
    def _without_nulls(cls, data: Json) -> Json:
        if not isinstance(data, dict):
            return data
        return {name: each for name, each in data.items() if each is not None}

    @property
    def unreadable(self) -> Mapping[str, str]:
        """Return the problem of each field of the message that cannot be read, by its name."""
        return self._unreadable

    def model_post_init(self, context: Any, /) -> None:
        """Report missing and unknown values in `context`, the problems of the message by field."""
        if context is None:
            return
        self._unreadable = context
        for name in self.NEEDED:
            if getattr(self, name) in (None, ""):
                context.setdefault(self._label(name), "is missing")
        for name, words in self.KNOWN_WORDS.items():
            word = getattr(self, name)
            if word and word not in words:
                context.setdefault(self._label(name), f"is {word!r}")

    @classmethod
    def _label(cls, name: str) -> str:
        """Return the name of a field in version 2 of the standard."""
        field = cls.model_fields[name]
        if isinstance(field.validation_alias, AliasChoices):
            return str(field.validation_alias.choices[0])
        return field.alias or name


T = TypeVar("T", bound=TolerantModel)


def read_tolerantly(kind: type[T], data: Any, if_unreadable: Mapping[str, object]) -> T | None:
    """Return the message in decoded JSON, or None if it is none.

    Null counts as missing. Unreadable values are removed from `data`, so that their fields have the defaults,
    and unreadable items are removed from lists. A part of which a required field is unreadable is so itself.

    Args:
        kind: the class of the message.
        data: changed.
        if_unreadable: values instead of unreadable ones, by field, where the default must not be assumed.
    """
    problems: dict[str, str] = {}
    for _ in range(MAX_ROUNDS):
        try:
            return kind.model_validate(data, context=problems)
        except ValidationError as error:
            if error.error_count() > MAX_ERRORS or not _remove(data, error, problems, if_unreadable):
                return None
    return None


class UnreadableFields:
    """Unreadable fields of the messages of one topic, each with the value that was seen first."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}

    def describe(self, topic: str, message: TolerantModel) -> str:
        """Return a sentence with a remedy if fields of the newest `message` are unreadable, else `""`."""
        self._first = {name: self._first.get(name, what) for name, what in message.unreadable.items()}
        if not self._first:
            return ""
        listed = ", ".join(f"{name} {what}" for name, what in list(self._first.items())[:MAX_NAMES])
        others = len(self._first) - MAX_NAMES
        more = f" and {others} more" if others > 0 else ""
        return (
            f"{topic[:200]}: {listed}{more}; correct it at the AGV, or update its software to keep VDA 5050"
        )


def _remove(
    data: Any, error: ValidationError, problems: dict[str, str], if_unreadable: Mapping[str, object]
) -> bool:
    """Remove from `data` what is in `error`, and add it to `problems`. Return False if nothing is left."""
    paths: set[tuple[str | int, ...]] = set()
    for each in error.errors(include_url=False):
        path, value = each["loc"], each["input"]
        name = next((str(step) for step in reversed(path) if isinstance(step, str)), "")
        if each["type"] == "missing":
            path, value = path[:-1], "missing"
            problems.setdefault(name, "is missing")
        elif value is not None:
            problems.setdefault(name, f"is {_shorten(repr(value))}")
        if not path:
            return False
        paths.add(path)
    for path in sorted(paths, reverse=True):  # the last items of lists first, which keeps the other indices
        part = data
        for step in path[:-1]:
            part = part[step]
        if path[-1] in if_unreadable:
            part[path[-1]] = if_unreadable[str(path[-1])]
        else:
            del part[path[-1]]
    return True


def _shorten(text: str) -> str:
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."
